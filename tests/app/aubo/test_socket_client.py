"""Socket.

Oracle: a server on the standard library's blocking sockets, in a thread.
"""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
from collections.abc import Iterator

import pytest
from vendor_calls import Caller, equipped, run

from app.services.devices.channels import BUFFER_BYTES
from cobot.codes import Code

CLASS = "Socket"


class Server:
    """Takes one connection and remembers what comes; the test says what goes back."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._accepted = threading.Event()
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def _accept(self) -> None:
        try:
            self.peer, _ = self._listening.accept()
        except OSError:  # closed before anybody came
            return
        self.peer.settimeout(30.0)
        self._accepted.set()

    def receive(self, count: int) -> bytes:
        assert self._accepted.wait(30.0)
        data = b""
        while len(data) < count:
            more = self.peer.recv(count - len(data))
            assert more
            data += more
        return data

    def send(self, data: bytes) -> None:
        assert self._accepted.wait(30.0)
        self.peer.sendall(data)

    def close(self) -> None:
        if self._accepted.is_set():
            self.peer.close()
        self._listening.close()


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.close()


async def connected(server: Server) -> tuple[Caller, Caller]:
    robot = equipped()
    ask = Caller(robot, CLASS)
    await ask("socketOpen", address="127.0.0.1", port=server.port)
    return ask, robot.equipment


async def apart(equipment: object) -> None:
    equipment.close()  # type: ignore[attr-defined]
    await asyncio.sleep(0)  # the transport closes in the next round of the loop


def test_what_is_sent_arrives_byte_by_byte(server: Server) -> None:
    async def check() -> None:
        ask, equipment = await connected(server)
        await ask("socketSendString", value="grüezi")
        await ask("socketSendLine", value="line")
        await ask("socketSendInt", value=-123456)
        await ask("socketSendByte", value=200)
        await ask("socketSendAllString", value=[0, 255])
        await ask("socketSetVar", name="speed", value=-3)
        wanted = "grüezi".encode() + b"line\n" + struct.pack("!i", -123456) + b"\xc8\x00\xffSET speed -3\n"
        assert await asyncio.to_thread(server.receive, len(wanted)) == wanted
        await apart(equipment)

    run(check())


def test_what_the_server_sends_is_read_in_pieces(server: Server) -> None:
    async def check() -> None:
        ask, equipment = await connected(server)
        numbers = struct.pack("!3i", 1, -2, 2**31 - 1)
        server.send(b"hello\r\n( 1.5, -2, 3e2 ) [x]" + numbers + b"\x07\x08count 41\n\xff")
        assert await ask("socketReadLine") == "hello"
        assert await ask("socketReadAsciiFloat", number=3) == [1.5, -2.0, 300.0]
        assert await ask("socketReadString", prefix="[", suffix="]") == "x"
        assert await ask("socketReadBinaryInteger", number=3) == [1, -2, 2**31 - 1]
        assert await ask("socketReadByte") == 7
        assert await ask("socketReadByteList", number=1) == [8]
        assert await ask("socketGetVar", name="count") == 41
        assert await asyncio.to_thread(server.receive, 10) == b"GET count\n"
        assert await ask("socketReadString") == "\N{REPLACEMENT CHARACTER}"
        await apart(equipment)

    run(check())


def test_an_answer_that_makes_no_sense_is_an_error_that_shows_it(server: Server) -> None:
    async def check() -> None:
        ask, equipment = await connected(server)
        server.send(b"(1, two)(1, 2)other 5\nspeed fast\n")
        assert "'1, two' is not a list" in await ask.fails("socketReadAsciiFloat", Code.DEVICE, number=2)
        assert "3 numbers, received 2" in await ask.fails("socketReadAsciiFloat", Code.DEVICE, number=3)
        assert "received 'other 5' as" in await ask.fails("socketGetVar", Code.DEVICE, name="speed")
        assert "received 'speed fast' as" in await ask.fails("socketGetVar", Code.DEVICE, name="speed")
        await ask.fails("socketGetVar", Code.INPUT, name="two words")
        await ask.fails("socketReadBinaryInteger", Code.INPUT, number=0)
        await apart(equipment)

    run(check())


def test_what_comes_too_late_stays_for_the_next_reader(server: Server) -> None:
    async def check() -> None:
        ask, equipment = await connected(server)
        server.send(b"half")
        await ask.fails("socketReadLine", Code.DEVICE_TIMEOUT, timeout=0.05)
        server.send(b" and half\n")
        assert await ask("socketReadLine") == "half and half"
        await apart(equipment)

    run(check())


def test_a_line_without_an_end_is_dropped_and_does_not_fill_the_memory(server: Server) -> None:
    async def check() -> None:
        ask, equipment = await connected(server)
        await asyncio.to_thread(server.send, b"x" * (BUFFER_BYTES + 5000))
        message = await ask.fails("socketReadLine", Code.DEVICE, timeout=30.0)
        assert "which are dropped" in message
        await apart(equipment)

    run(check())


def test_what_a_server_does_not_take_fails_and_does_not_pile_up(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def check() -> None:
        monkeypatch.setattr("app.services.devices.channels.Channel.send.__defaults__", (0.1,))
        ask, equipment = await connected(server)
        piece, sent = "x" * 4_000_000, 0
        while (answer := await ask.answer("socketSendString", value=piece)).code == Code.OK:
            sent += 1
            assert sent < 50
        assert "not all of 4000000 bytes were sent within" in answer.message
        for _ in range(3):
            await ask.fails("socketSendString", Code.DEVICE_TIMEOUT, value=piece)
        begun = (sent + 1) * len(piece)  # and nothing of the later ones
        assert await asyncio.to_thread(server.receive, begun) == b"x" * begun
        await ask("socketSendString", value="!")
        assert await asyncio.to_thread(server.receive, 1) == b"!"
        await apart(equipment)

    run(check())


def test_a_server_that_hangs_up_is_an_error_and_no_wait(server: Server) -> None:
    async def check() -> None:
        ask, equipment = await connected(server)
        server.send(b"last words\n")
        server.close()
        assert await ask("socketReadLine") == "last words"
        assert "has ended" in await ask.fails("socketReadLine", Code.DEVICE, timeout=30.0)
        await apart(equipment)

    run(check())


def test_several_sockets_have_names(server: Server) -> None:
    async def check() -> None:
        ask, equipment = await connected(server)
        other = Server()
        await ask.fails("socketOpen", Code.CONFLICT, address="127.0.0.1", port=other.port)
        await ask("socketOpen", address="127.0.0.1", port=other.port, socket_name="camera")
        other.send(b"from the camera\n")
        server.send(b"from the first\n")
        assert await ask("socketReadLine", socket_name="camera") == "from the camera"
        assert await ask("socketReadLine") == "from the first"
        await ask("socketClose", socket_name="camera")
        message = await ask.fails("socketReadLine", Code.NOT_FOUND, socket_name="camera")
        assert "open sockets: socket_0" in message
        other.close()
        await apart(equipment)

    run(check())


def test_where_nobody_listens_nothing_opens() -> None:
    async def check() -> None:
        ask = Caller(equipped(), CLASS)
        with socket.socket() as bound:  # taken, but not listening
            bound.bind(("127.0.0.1", 0))
            port = bound.getsockname()[1]
            await ask.fails("socketOpen", Code.DEVICE, address="127.0.0.1", port=port)
        for port in (0, 65536):
            await ask.fails("socketOpen", Code.INPUT, address="127.0.0.1", port=port)
        await ask.fails("socketOpen", Code.DEVICE, address="no such host.invalid", port=1)
        await ask.fails("socketReadLine", Code.NOT_FOUND)

    run(check())
