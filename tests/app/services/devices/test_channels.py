"""Bytes to and from devices. Oracle: what the test itself feeds in; Python's bytes methods.

Waits that have to end without data are some milliseconds long, and nothing depends on how long they take.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from app.services.clients import CLIENT, RequestClient
from app.services.devices.channels import BUFFER_BYTES, MAX_OPEN, Channel, Channels
from cobot.errors import ConflictError, DeviceError, DeviceTimeout, InputError, LimitError, NotFoundError

LONG_S = 30.0
SHORT_S = 0.005


class Line:
    """A channel whose other end is the test."""

    def __init__(self, error: OSError | None = None) -> None:
        self.reader = asyncio.StreamReader(limit=BUFFER_BYTES)
        self.sent = bytearray()
        self.closed = 0
        self._error = error
        self.channel = Channel("a device", self.reader, self._write, self._close)

    async def _write(self, data: bytes) -> None:
        if self._error is not None:
            raise self._error
        self.sent += data

    def _close(self) -> None:
        self.closed += 1


def run(test: Callable[[], Awaitable[None]]) -> None:
    async def within() -> None:
        await asyncio.wait_for(test(), 60.0)

    asyncio.run(within())


def test_bytes_come_as_they_were_asked_for() -> None:
    async def test() -> None:
        line = Line()
        line.reader.feed_data(b"one\r\ntwo\n12345<a>b</a>rest")
        channel = line.channel
        assert await channel.read_line(LONG_S) == b"one"
        assert await channel.read_line(LONG_S) == b"two"
        assert await channel.read_exactly(5, LONG_S) == b"12345"
        assert await channel.read_between(b"<a>", b"</a>", LONG_S) == b"b"
        assert await channel.read_some(LONG_S) == b"rest"
        await channel.send(b"there")
        assert line.sent == b"there"

    run(test)


def test_what_a_program_leaves_open_is_closed_when_it_ends_and_nothing_else() -> None:
    async def test() -> None:
        channels, lines = Channels("socket"), [Line() for _ in range(5)]
        channels.add("by hand", lines[0].channel)
        own = CLIENT.set(RequestClient("anonymous", sequence="first"))
        for name, line in zip(("left open", "closed", "passed on"), lines[1:], strict=False):
            channels.add(name, line.channel)
        channels.close("closed")
        channels.close("passed on")
        CLIENT.reset(own)
        channels.add("passed on", lines[3].channel)
        channels.close_left_open("another")
        channels.close_left_open("first")
        assert [line.closed for line in lines] == [0, 1, 1, 1, 0]
        assert channels.get("by hand") is lines[0].channel
        assert channels.get("passed on") is lines[3].channel
        with pytest.raises(NotFoundError, match="open sockets: by hand, passed on"):
            channels.get("left open")
        late = CLIENT.set(RequestClient("anonymous", sequence="first"))
        with pytest.raises(ConflictError, match="program that this request belongs to has ended"):
            channels.add("late", lines[4].channel)
        CLIENT.reset(late)
        assert lines[4].closed == 1

    run(test)


def test_readers_take_turns() -> None:
    async def test() -> None:
        line = Line()
        reads = [asyncio.ensure_future(line.channel.read_exactly(3, LONG_S)) for _ in range(3)]
        await asyncio.sleep(0)
        line.reader.feed_data(b"aaabbbccc")
        assert await asyncio.gather(*reads) == [b"aaa", b"bbb", b"ccc"]

    run(test)


def test_what_does_not_come_is_told_with_the_time_and_what_has_come_stays() -> None:
    async def test() -> None:
        line = Line()
        line.reader.feed_data(b"half")
        with pytest.raises(DeviceTimeout, match=r"a device: b'\\n' did not arrive within 0.005 s"):
            await line.channel.read_line(SHORT_S)
        with pytest.raises(DeviceTimeout, match=r"a device: 9 bytes did not arrive within 0\.005 s"):
            await line.channel.read_exactly(9, SHORT_S)
        assert await line.channel.read_some(LONG_S) == b"half"
        with pytest.raises(DeviceTimeout, match="no byte arrived within"):
            await line.channel.read_some(SHORT_S)

    run(test)


def test_a_device_that_is_gone_and_one_without_line_ends_are_errors() -> None:
    async def test() -> None:
        flood = Line()
        flood.reader.feed_data(b"x" * (BUFFER_BYTES + 1) + b"\n")
        with pytest.raises(DeviceError, match="bytes, which are dropped"):
            await flood.channel.read_line(LONG_S)
        gone = Line(OSError(5, "Input/output error"))
        gone.reader.feed_eof()
        with pytest.raises(DeviceError, match="a device: the connection has ended"):
            await gone.channel.read_some(LONG_S)
        with pytest.raises(DeviceError, match="a device: Input/output error"):
            await gone.channel.send(b"x")

    run(test)


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, 61.0, float("nan"), float("inf")])
def test_a_timeout_has_bounds(timeout_s: float) -> None:
    async def test() -> None:
        with pytest.raises(LimitError, match=r"a timeout must be from 0\.001 to 60 s"):
            await Line().channel.read_some(timeout_s)
        with pytest.raises(InputError, match="number must be from 1 to"):
            await Line().channel.read_exactly(0, LONG_S)

    run(test)


def test_channels_are_found_by_name_and_closed_once() -> None:
    async def test() -> None:
        channels, lines = Channels("socket"), {name: Line() for name in ("b", "a")}
        for name, line in lines.items():
            channels.add(name, line.channel)
        assert channels.get("a") is lines["a"].channel
        with pytest.raises(NotFoundError, match="there is no open socket 'c'; open sockets: a, b"):
            channels.get("c")
        late = Line()
        with pytest.raises(ConflictError, match="the socket 'a' is already open"):
            channels.add("a", late.channel)
        assert late.closed == 1  # nobody else will
        channels.close("a")
        channels.close_all()
        assert [line.closed for line in lines.values()] == [1, 1]
        for number in range(MAX_OPEN):
            channels.add(str(number), Line().channel)
        with pytest.raises(ConflictError, match=f"{MAX_OPEN} of the kind socket are already open"):
            channels.require_place("one more")
        for name in ("", "x" * 201):
            with pytest.raises(InputError, match="a name must be 1 to 200 characters long"):
                channels.require_place(name)

    run(test)
