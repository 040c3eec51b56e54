"""The protocol of openpi's servers. Oracle: the published client's own encoding, where it is installed."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from learning_peers import answering, need

msgpack = need("msgpack")

from cobot.errors import ExecutionError, InputError, UnavailableError  # noqa: E402
from cobot.learning import openpi  # noqa: E402
from cobot.learning.chunks import actions_of  # noqa: E402
from cobot.learning.openpi import PolicyConnection, pack, unpack  # noqa: E402

MESSAGE: dict[str, Any] = {
    "prompt": "pick up the cube",
    "observation/state": np.linspace(-1.0, 1.0, 7, dtype=np.float32),
    "observation/image": np.arange(24, dtype=np.uint8).reshape(2, 4, 3),
    "nested": {"one": np.float32(0.5), "done": np.bool_(True), "list": [1, 2.5, None]},
}


def same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and bool((one == other).all())
    return bool(one == other) and type(one) is type(other)


def test_what_is_packed_is_unpacked() -> None:
    assert same(unpack(pack(MESSAGE)), MESSAGE)


def test_both_directions_are_the_published_client_s() -> None:
    theirs = pytest.importorskip("openpi_client.msgpack_numpy", reason="openpi-client is not installed")
    assert same(theirs.unpackb(pack(MESSAGE)), MESSAGE)
    assert same(unpack(theirs.packb(MESSAGE)), MESSAGE)
    assert pack(MESSAGE) == theirs.packb(MESSAGE)


@pytest.mark.parametrize("value", [object(), np.array([object()]), np.array([1j]), 2**70])
def test_what_has_no_form_is_refused(value: object) -> None:
    with pytest.raises(InputError, match="the observation cannot be sent"):
        pack({"value": value})


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xc1",
        msgpack.packb({b"__ndarray__": True, b"data": b"\0", b"dtype": "<f8", b"shape": (2,)}),
        msgpack.packb({b"__ndarray__": True, b"data": b"\0" * 8, b"dtype": "|O", b"shape": (1,)}),
        msgpack.packb({b"__ndarray__": True, b"data": b"", b"dtype": "<f8", b"shape": [2**63]}),
        msgpack.packb({b"__ndarray__": True, b"data": b"", b"dtype": "f4,(", b"shape": [0]}),
        msgpack.packb({b"__npgeneric__": True}),
        msgpack.packb({b"__npgeneric__": True, b"data": 300, b"dtype": "|i1"}),
        msgpack.packb({b"__npgeneric__": True, b"data": 2**40, b"dtype": "|S1"}),
    ],
)
def test_what_is_no_message_is_said_to_be_none(content: bytes) -> None:
    with pytest.raises(ExecutionError, match="invalid message of openpi's protocol"):
        unpack(content)


SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-(2**63), 2**64 - 1), st.floats(), st.text(max_size=4)
)
TYPES = st.one_of(
    SCALARS,
    st.sampled_from(["<f8", "|b1", "<U2", "|S3", "<f3", "|O", "V8", "M8[s]", "f4,(", "f4,i4", "(9,)f8"]),
    st.from_regex(r"[<>|=]?[biufSU]\d{1,10}", fullmatch=True),
)
ARRAYS = st.fixed_dictionaries(
    {},
    optional={
        b"__ndarray__": st.just(True),
        b"__npgeneric__": st.just(True),
        b"data": st.one_of(SCALARS, st.binary(max_size=24), st.lists(SCALARS, max_size=2)),
        b"dtype": st.one_of(TYPES, st.lists(TYPES, max_size=2)),
        b"shape": st.one_of(SCALARS, st.lists(SCALARS, max_size=3)),
    },
)


def is_a_message_or_refused(content: bytes) -> None:
    with contextlib.suppress(ExecutionError):
        unpack(content)


@settings(max_examples=500)
@given(ARRAYS)
def test_whatever_calls_itself_an_array_is_one_or_no_message(value: dict[bytes, Any]) -> None:
    is_a_message_or_refused(msgpack.packb(value))


@settings(max_examples=500)
@given(st.lists(st.tuples(st.integers(0, 400), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_message_with_other_bytes_in_it_is_one_or_none(changes: list[tuple[int, int]]) -> None:
    content = bytearray(pack(MESSAGE))
    for place, byte in changes:
        content[place % len(content)] = byte
    is_a_message_or_refused(bytes(content))


def test_a_server_is_asked_and_answers() -> None:
    async def serve(socket: Any) -> None:
        await socket.send(pack({"model": "still"}))
        async for content in socket:
            seen = unpack(content)
            await socket.send(pack({"actions": np.tile(seen["observation/state"], (5, 1))}))

    with answering(serve) as address, PolicyConnection(address) as policy:
        assert policy.metadata == {"model": "still"}
        answer = policy.infer(MESSAGE)
        assert answer["actions"].shape == (5, 7)


def test_a_server_that_fails_gives_its_reason_in_one_line() -> None:
    async def serve(socket: Any) -> None:
        await socket.send(pack({}))
        await socket.recv()
        await socket.send("Traceback (most recent call last):\n  File \"x.py\"\nKeyError: 'state'\n")

    with (
        answering(serve) as address,
        PolicyConnection(address) as policy,
        pytest.raises(ExecutionError, match=r"the policy has failed: KeyError: 'state'$"),
    ):
        policy.infer({})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("\x1b[2J\x00gone", r"has failed: \\x1b\[2J\\x00gone$"),
        ("x" * 1_000_000, r"has failed: x{2000}\.\.\. \(1000000 characters\)$"),
        ("\n" * 1_000_000, "has failed: no reason$"),
    ],
)
def test_a_server_s_reason_is_printable_and_bounded(text: str, words: str) -> None:
    async def serve(socket: Any) -> None:
        await socket.send(pack({}))
        await socket.recv()
        await socket.send(text)

    with (
        answering(serve) as address,
        PolicyConnection(address) as policy,
        pytest.raises(ExecutionError, match=words),
    ):
        policy.infer({})


def test_an_answer_beyond_the_limit_is_named_and_the_next_one_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(openpi, "MAX_ANSWER_BYTES", 10_000)
    sizes = iter((20_000, 1))

    async def serve(socket: Any) -> None:
        await socket.send(pack({}))
        async for _ in socket:
            await socket.send(pack({"actions": bytes(next(sizes))}))

    with answering(serve) as address, PolicyConnection(address) as policy:
        with pytest.raises(ExecutionError, match=f"{address}: the policy's answer has more than 10000 bytes"):
            policy.infer({})
        assert policy.infer({}) == {"actions": b"\0"}


def test_an_answer_without_actions_is_described_in_few_words() -> None:
    """Its keys are the server's."""
    answer = {f"\x1b{number}" + "k" * 100_000: 0 for number in range(1000)}
    with pytest.raises(ExecutionError, match="has no 'actions'") as caught:
        actions_of(answer, 7)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 5_000


def test_a_server_that_goes_away_or_says_nothing_is_named() -> None:
    async def serve(socket: Any) -> None:
        await socket.send(pack({}))
        await socket.recv()

    with answering(serve) as address, PolicyConnection(address) as policy:
        with pytest.raises(UnavailableError, match=f"{address}: the connection is lost"):
            policy.infer({})
        with pytest.raises(UnavailableError, match="the connection is lost"):
            policy.infer({})

    async def silent(socket: Any) -> None:
        await socket.recv()

    with (
        answering(silent) as address,
        pytest.raises(UnavailableError, match=r"did not describe itself within 0\.1 s"),
    ):
        PolicyConnection(address, timeout_s=0.1)


def test_an_answer_that_comes_too_late_is_no_later_question_s() -> None:
    asked = itertools.count(1)
    late = asyncio.Event()

    async def serve(socket: Any) -> None:
        await socket.send(pack({}))
        async for _ in socket:
            number = next(asked)
            if number == 1:
                await late.wait()
            await socket.send(pack({"actions": number}))
            late.set()

    with answering(serve) as address, PolicyConnection(address) as policy:
        policy._timeout_s, patient_s = 0.1, policy._timeout_s
        with pytest.raises(UnavailableError, match=r"did not answer within 0\.1 s"):
            policy.infer(MESSAGE)
        policy._timeout_s = patient_s
        assert [policy.infer(MESSAGE)["actions"] for _ in range(2)] == [2, 3]


def test_nobody_there_and_no_address() -> None:
    with pytest.raises(UnavailableError, match=r"ws://127\.0\.0\.1:1: "):
        PolicyConnection("127.0.0.1:1")
    with pytest.raises((InputError, UnavailableError), match="nonsense"):
        PolicyConnection("ws://non sense:port nonsense")
