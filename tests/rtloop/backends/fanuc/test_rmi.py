"""The client of the Remote Motion Interface, against a controller that answers anything.

Oracle: what each test has the other side say.
"""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Callable, Iterator
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtloop.backends import BackendError
from rtloop.backends.fanuc import rmi
from rtloop.backends.fanuc.rmi import RmiClient, RmiLines, TcpLines

Say = Callable[[dict[str, object]], bytes | None]


class Told:
    """`RmiLines` whose other end says what it is told to."""

    def __init__(self, say: Say) -> None:
        self._say, self._lines = say, list[bytes]()
        self.closed = False

    def send(self, line: bytes) -> None:
        said = self._say(json.loads(line))
        if said is not None:
            self._lines += said.split(b"\n")

    def receive(self, timeout_s: float) -> bytes:
        if not self._lines:
            raise TimeoutError("timed out")
        return self._lines.pop(0)

    def close(self) -> None:
        self.closed = True


def welcome(request: dict[str, object]) -> bytes:
    return json.dumps({**request, "ErrorID": 0, "PortNumber": 16002, "MajorVersion": 9}).encode()


def client(say: Say, greet: Say = welcome) -> RmiClient:
    def connect(port: int, timeout_s: float) -> RmiLines:
        return Told(greet if port == 16001 else say)

    return RmiClient("robot.test", 16001, 1.0, connect)


def connected(say: Say) -> RmiClient:
    found = client(say)
    found.connect()
    return found


def test_it_is_told_the_port_of_its_session() -> None:
    ports: list[int] = []

    def connect(port: int, timeout_s: float) -> RmiLines:
        ports.append(port)
        return Told(welcome)

    found = RmiClient("robot.test", 16001, 1.0, connect)
    found.connect()
    found.connect()  # it is
    assert ports == [16001, 16002]
    assert found.version == "9.?"


@pytest.mark.parametrize(
    ("reply", "sentence"),
    [
        ({"ErrorID": 2556954}, "another client is in control"),
        ({"ErrorID": 0}, "its reply has no port: is option J519 with R912"),
        ({"ErrorID": 0, "PortNumber": "16002"}, "its reply has no port"),
        ({"ErrorID": 0, "PortNumber": 70000}, "its reply has no port"),
        ({"ErrorID": 5}, "does not connect: ErrorID 5"),
        ({"ErrorID": None}, "does not connect: ErrorID -1"),
    ],
)
def test_a_greeting_that_is_none_is_named(reply: dict[str, object], sentence: str) -> None:
    def greet(request: dict[str, object]) -> bytes:
        return json.dumps({**request, **reply}).encode()

    with pytest.raises(BackendError, match=sentence):
        client(welcome, greet).connect()


def test_a_session_that_is_not_accepted_is_another_clients() -> None:
    """As a real CRX refuses a second one: by silence on the port that it told."""

    def connect(port: int, timeout_s: float) -> RmiLines:
        if port != 16001:
            raise TimeoutError("timed out")
        return Told(welcome)

    with pytest.raises(BackendError, match="TCP port 16002: another client is in control"):
        RmiClient("robot.test", 16001, 1.0, connect).connect()


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        (b"hello", "sends 'hello' instead of a JSON object"),
        (b"[1]", "instead of a JSON object"),
        (b"{" * 5000, "instead of a JSON object"),
        (b"[" * 5000, "instead of a JSON object"),
        (b"\xff\x1b[2J", r"\\x1b\[2J"),
        (None, "does not answer a request to report its status: timed out"),
        (b'{"Command": "Unknown", "ErrorID": 1}', "it does not know FRC_GetStatus"),
        (b'{"Command": "FRC_GetStatus", "ErrorID": 2556935}', "the arm's servos are off"),
        (b'{"Communication": "FRC_SystemFault"}\n' * 200, "but sends other lines"),
    ],
)
def test_a_reply_that_is_none_is_named(said: bytes | None, sentence: str) -> None:
    with pytest.raises(BackendError, match=sentence) as found:
        connected(lambda request: said).status()
    assert len(str(found.value)) < 300
    assert str(found.value).isprintable()


def test_lines_of_its_own_are_skipped() -> None:
    def say(request: dict[str, object]) -> bytes:
        push = b'{"Communication": "FRC_SystemFault", "SequenceID": 3}\n{"Instruction": "FRC_Call"}\n'
        return push + json.dumps({**request, "ServoReady": 1, "Override": 40, "UI[2]": 1}).encode()

    status = connected(say).status()
    assert (status.servo_ready, status.override, status.next_sequence) == (True, 40, None)


def test_alarms_are_in_words_and_hostile_ones_are_cut() -> None:
    def say(request: dict[str, object]) -> bytes:
        texts = {"ErrorData": "SRVO-004 Fence open", "ErrorData2": "\x1b[31m" + 5000 * "x", "ErrorData3": 7}
        return json.dumps({**request, **texts}).encode()

    said = connected(say).alarms()
    assert said.startswith("the fence is open: close it (SRVO-004 Fence open); ")
    assert said.endswith("; 7")
    assert said.isprintable()
    assert len(said) < 500


@pytest.mark.parametrize("angles", [None, {}, [], {"J1": "0"}, {"J2": float("nan")}, {"J3": True}])
def test_joints_that_are_no_numbers_are_named(angles: object) -> None:
    with pytest.raises(BackendError, match="has no joint angles"):
        connected(lambda request: json.dumps({**request, "JointAngle": angles}).encode()).joints()


@given(said=st.binary(max_size=200))
def test_any_reply_is_a_status_or_a_sentence(said: bytes) -> None:
    with contextlib.suppress(BackendError):
        connected(lambda request: said).status()


@contextlib.contextmanager
def listening(serve: Callable[[socket.socket], None]) -> Iterator[int]:
    """A server for one client, in a thread."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def accept() -> None:
            with contextlib.suppress(OSError):
                one, _ = server.accept()
                with one:
                    serve(one)

        thread = threading.Thread(target=accept)
        thread.start()
        yield server.getsockname()[1]
        thread.join()


def test_an_endless_line_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rmi, "REPLY_S", 5.0)

    def serve(one: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                one.sendall(b"x" * 10_000)

    with listening(serve) as port:
        found = RmiClient("127.0.0.1", port, 1.0, partial(TcpLines, "127.0.0.1"))
        with pytest.raises(BackendError, match="a line of more than 65536 bytes"):
            found.connect()


def test_a_half_open_connection_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes everything, and says nothing."""
    monkeypatch.setattr(rmi, "REPLY_S", 0.2)
    done = threading.Event()
    with listening(lambda one: bool(done.wait(10.0)) or None) as port:
        found = RmiClient("127.0.0.1", port, 1.0, partial(TcpLines, "127.0.0.1"))
        with pytest.raises(BackendError, match="does not answer a request to connect: timed out"):
            found.connect()
        done.set()
    assert not found.is_connected


def test_nobody_there_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    found = RmiClient("127.0.0.1", port, 1.0, partial(TcpLines, "127.0.0.1"))
    with pytest.raises(BackendError, match=f"no Remote Motion Interface on TCP 127.0.0.1:{port}: .*refused"):
        found.connect()
