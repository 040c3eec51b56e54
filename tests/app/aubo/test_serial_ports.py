"""Serial.

Oracle: the other end of a pair of pseudo terminals, read and written by the operating system.
"""

from __future__ import annotations

import asyncio
import os
import tempfile
import tty
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import serial
from vendor_calls import Caller, equipped, run

from app.services.devices import serial_ports
from app.services.devices.channels import BUFFER_BYTES
from cobot.codes import Code

CLASS = "Serial"


@dataclass
class Device:
    """The far end of an open port."""

    ask: Caller
    end: int
    path: str

    async def read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            data += await asyncio.to_thread(os.read, self.end, count - len(data))
        return data

    def write(self, data: bytes) -> None:
        os.write(self.end, data)

    def hang_up(self) -> None:
        os.close(self.end)
        self.end = -1


@asynccontextmanager
async def device() -> AsyncIterator[Device]:
    robot = equipped()
    far, near = os.openpty()
    tty.setraw(near)
    found = Device(Caller(robot, CLASS), far, os.ttyname(near))
    try:
        await found.ask("serialOpen", device=found.path, baud=9600)
        yield found
    finally:
        robot.equipment.close()
        os.close(near)
        if found.end >= 0:
            os.close(found.end)


def test_what_is_sent_arrives_byte_by_byte() -> None:
    async def check() -> None:
        async with device() as there:
            await there.ask("serialSendString", value="naïve")
            await there.ask("serialSendLine", value="line")
            await there.ask("serialSendInt", value=-2)
            await there.ask("serialSendByte", value=255)
            await there.ask("serialSendAllString", value=[0, 17, 128])
            wanted = "naïve".encode() + b"line\n" + (-2).to_bytes(4, "big", signed=True) + b"\xff\x00\x11\x80"
            assert await there.read(len(wanted)) == wanted
            await there.ask.fails("serialSendByte", Code.INPUT, value=256)
            await there.ask.fails("serialSendAllString", Code.INPUT, value=[-1])

    run(check())


def test_what_the_device_sends_is_read_in_pieces() -> None:
    async def check() -> None:
        async with device() as there:
            there.write(b"first\r\nsecond\n<<value 7>>\x00\x01\x02rest")
            assert await there.ask("serialReadLine") == "first"
            assert await there.ask("serialReadLine") == "second"
            assert await there.ask("serialReadString", prefix="<<", suffix=">>") == "value 7"
            assert await there.ask("serialReadByte") == 0
            assert await there.ask("serialReadByteList", number=2) == [1, 2]
            assert await there.ask("serialReadString") == "rest"

    run(check())


def test_what_comes_too_late_stays_for_the_next_reader() -> None:
    async def check() -> None:
        async with device() as there:
            there.write(b"half a li")
            message = await there.ask.fails("serialReadLine", Code.DEVICE_TIMEOUT, timeout=0.05)
            assert "did not arrive within 0.05 s" in message
            there.write(b"ne\n")
            assert await there.ask("serialReadLine") == "half a line"
            await there.ask.fails("serialReadByteList", Code.DEVICE_TIMEOUT, number=3, timeout=0.01)
            await there.ask.fails("serialReadByteList", Code.INPUT, number=0)
            await there.ask.fails("serialReadLine", Code.LIMIT, timeout=61.0)

    run(check())


def test_a_flood_is_held_back_and_nothing_of_it_is_lost() -> None:
    async def check() -> None:
        async with device() as there:
            flood = bytes(range(256)) * (4 * BUFFER_BYTES // 256)
            writing = asyncio.create_task(asyncio.to_thread(_write_all, there.end, flood))
            got: list[int] = []
            while len(got) < len(flood):
                got += await there.ask("serialReadByteList", number=4096, timeout=30.0)
            await writing
            assert bytes(got) == flood

    run(check())


def _write_all(end: int, data: bytes) -> None:
    while data:
        data = data[os.write(end, data) :]


def test_a_device_that_goes_away_is_an_error_and_no_wait() -> None:
    async def check() -> None:
        async with device() as there:
            there.hang_up()
            assert "ended" in await there.ask.fails("serialReadLine", Code.DEVICE, timeout=30.0)
            await there.ask.fails("serialSendString", Code.DEVICE, value="x")
            await there.ask("serialClose")
            assert "open serial ports: none" in await there.ask.fails("serialReadLine", Code.NOT_FOUND)

    run(check())


def test_a_port_has_one_name_and_one_user() -> None:
    async def check() -> None:
        async with device() as there:
            await there.ask.fails("serialOpen", Code.CONFLICT, device=there.path)
            await there.ask.fails("serialOpen", Code.DEVICE, device=there.path, serial_name="again")
            await there.ask("serialClose")
            await there.ask("serialOpen", device=there.path, serial_name="again")
            await there.ask("serialSendString", value="ok", serial_name="again")
            assert await there.read(2) == b"ok"

    run(check())


@pytest.mark.parametrize(
    "wrong",
    [
        {"device": "/dev/null/nothing"},
        {"device": "/etc/passwd"},
        {"device": "../etc/passwd"},
        {"device": "/dev/\x00"},
        {"stop_bits": 3.0},
        {"even": 3},
        {"serial_name": "x" * 300},
    ],
)
def test_what_cannot_be_opened_is_refused(wrong: dict[str, Any]) -> None:
    async def check() -> None:
        await Caller(equipped(), CLASS).fails("serialOpen", Code.INPUT, **{"device": "/dev/null", **wrong})

    run(check())


def test_a_device_that_is_no_serial_port_says_so() -> None:
    async def check() -> None:
        message = await Caller(equipped(), CLASS).fails("serialOpen", Code.DEVICE, device="/dev/null")
        assert message.startswith("/dev/null: ")

    run(check())


@pytest.mark.parametrize("kind", ["FIFO", "regular file", "directory"])
def test_what_is_no_device_is_refused_at_once(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """To open a FIFO that nobody writes to would wait for ever."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        path = Path(folder) / "port"
        match kind:
            case "FIFO":
                os.mkfifo(path)
            case "regular file":
                path.touch()
            case "directory":
                path.mkdir()
        monkeypatch.setattr(serial, "Serial", never)

        async def check() -> None:
            message = await Caller(equipped(), CLASS).fails("serialOpen", Code.INPUT, device=str(path))
            assert "not a character device" in message

        run(check())


@pytest.mark.parametrize("drivers", [serial_ports.DRIVERS, Path("/nothing")])
@pytest.mark.parametrize("path", ["/dev/null", "/dev/tty", "/dev/ptmx", "/dev/urandom"])
def test_a_device_of_another_kind_is_not_even_opened(
    path: str, drivers: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To open one may act on it: a watchdog begins to run, a tape is wound back."""
    monkeypatch.setattr(serial, "Serial", never)
    monkeypatch.setattr(serial_ports, "DRIVERS", drivers)

    async def check() -> None:
        message = await Caller(equipped(), CLASS).fails("serialOpen", Code.DEVICE, device=path)
        assert message == f"{path}: is not a serial port"

    run(check())


def never(*_: object, **__: object) -> None:
    raise AssertionError("it was opened")
