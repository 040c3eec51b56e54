"""Frames of Modbus RTU and of Modbus TCP, and a master that reads and writes registers and coils.

Sources: MODBUS over Serial Line V1.02, MODBUS Messaging on TCP/IP V1.0b and MODBUS Application Protocol
V1.1b3, modbus.org. An answer that violates these standards is an error. A late answer must not be mistaken
for the answer to the next request. So after an error, the master waits until the line has been quiet for as
long as an answer takes.
"""

from __future__ import annotations

import contextlib
import struct
import termios
from collections.abc import Callable, Sequence
from typing import Any

import serial

from cobot.grippers.protocol import GripperError
from cobot.modbus import COIL_ON, REFUSALS, REFUSED, ModbusFunction

MIN_FRAME = 5
"""Number of bytes of the shortest answer, which is an exception."""
HEAD = 6
"""Number of bytes before the unit in a Modbus TCP frame."""
SOCKET = "socket://"
MAX_DRAINS = 8
"""Maximum number of reads to wait until the line is quiet."""
LOST = (OSError, termios.error)
"""Errors that pyserial raises if the line is gone. The error classes of pyserial itself are OSErrors."""


def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ 0xA001 if byte & 1 else byte >> 1
        table.append(byte)
    return table


_TABLE = _crc_table()


def crc(data: bytes) -> int:
    """Compute the checksum of a frame (CRC-16/MODBUS)."""
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _TABLE[(value ^ byte) & 0xFF]
    return value


def framed(data: bytes) -> bytes:
    """The frame with its checksum appended."""
    return data + struct.pack("<H", crc(data))


def is_whole(frame: bytes) -> bool:
    """Whether the checksum of a frame is correct."""
    return len(frame) > 2 and framed(frame[:-2]) == frame


class Master:
    """A master on a serial port, or on a TCP connection that carries the same frames.

    Args:
        device: path of the serial port, such as /dev/ttyUSB0, or HOST:PORT.
        unit: address of the slave.
        timeout_s: timeout for each answer.
        line: creates a port that tests use instead of pyserial's.
        slave: description of the slave, for errors.
    """

    def __init__(
        self,
        device: str,
        unit: int,
        baud: int,
        timeout_s: float,
        line: Callable[[], Any] | None = None,
        slave: str = "the gripper",
    ) -> None:
        self._line, self._slave = line, slave
        self._device, self._unit, self._baud, self._timeout_s = device, unit, baud, timeout_s
        self._port: Any = None
        self._expects_late = False

    def open(self) -> None:
        """Open the port. Raises GripperError if it does not exist or cannot be opened."""
        self.close()
        if self._line is not None:
            self._port = self._line()
            return
        url = self._device if self._device.startswith("/") else SOCKET + self._device.removeprefix(SOCKET)
        exclusive = {} if url.startswith(SOCKET) else {"exclusive": True}
        try:
            self._port = serial.serial_for_url(url, self._baud, timeout=self._timeout_s, **exclusive)
        except (*LOST, ValueError) as exc:
            raise GripperError(
                f"{self._device} cannot be opened: {exc}; check its plug, its name, and whether "
                "another program uses it"
            ) from exc

    def close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            connection = getattr(port, "_socket", None)  # not closed by pyserial if it has ended
            with contextlib.suppress(*LOST):  # a line that is gone needs no closing
                port.close()
            if connection is not None:
                connection.close()

    def read(
        self, address: int, count: int, function: ModbusFunction = ModbusFunction.READ_HOLDING_REGISTERS
    ) -> list[int]:
        """Read holding registers or input registers.

        Raises:
            GripperError: there is no answer, or the answer is wrong; the message then contains the answer.
        """
        data = self._ask(function, struct.pack(">HH", address, count), 1 + 2 * count)
        if data[0] != 2 * count:
            raise self._error("has sent an answer that does not match the request")
        return list(struct.unpack(f">{count}H", data[1:]))

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write holding registers. Raises the same errors as `read`."""
        head = struct.pack(">HH", address, len(values))
        body = struct.pack(f">B{len(values)}H", 2 * len(values), *values)
        if self._ask(ModbusFunction.WRITE_REGISTERS, head + body, len(head)) != head:
            raise self._error("has sent an answer that does not match the request")

    def read_bit(self, address: int, function: ModbusFunction = ModbusFunction.READ_COILS) -> bool:
        """Read a coil or a discrete input. Raises the same errors as `read`."""
        data = self._ask(function, struct.pack(">HH", address, 1), 2)
        if data[0] != 1:
            raise self._error("has sent an answer that does not match the request")
        return bool(data[1] & 1)

    def write_coil(self, address: int, on: bool) -> None:
        """Set a coil. Raises the same errors as `read`."""
        request = struct.pack(">HH", address, COIL_ON if on else 0)
        if self._ask(ModbusFunction.WRITE_COIL, request, len(request)) != request:
            raise self._error("has sent an answer that does not match the request")

    def _ask(self, function: ModbusFunction, data: bytes, length: int) -> bytes:
        """Send a request. Returns the answer's data, which is between its function code and its checksum and
        must have this length.
        """
        if self._port is None:
            raise self._error("is not connected")
        try:
            self._await_quiet()
            self._port.reset_input_buffer()
            frame = self._exchange(bytes((self._unit, function)) + data, length)
        except LOST as exc:
            raise self._error(f"has lost its connection: {exc}") from exc
        self._expects_late = True
        refuses = len(frame) == MIN_FRAME and frame[1] == function | REFUSED
        if not frame or len(frame) < (MIN_FRAME if refuses else length + 4):
            got = f"; it sent {len(frame)} bytes" if frame else ""
            raise self._error(f"has not answered within {self._timeout_s:g} s{got}")
        if not is_whole(frame) or frame[0] != self._unit or frame[1] & ~REFUSED != function:
            raise self._error(
                f"has sent an invalid answer ({frame[:16].hex(' ')}): check baud rate and wiring"
            )
        self._expects_late = False
        if refuses:
            raise self._error(
                f"rejects the request: {REFUSALS.get(frame[2], 'unknown')} (exception {frame[2]})"
            )
        return bytes(frame[2:-2])

    def _exchange(self, request: bytes, length: int) -> bytes:
        """Send a request, and return the bytes of the answer. They are fewer than expected if the answer is
        cut off.
        """
        self._port.write(framed(request))
        frame: bytes = self._port.read(MIN_FRAME)
        if len(frame) == MIN_FRAME and not frame[1] & REFUSED:
            frame += self._port.read(length + 4 - MIN_FRAME)
        return frame

    def _await_quiet(self) -> None:
        """After an error, wait until no more bytes arrive."""
        if self._expects_late:
            for _ in range(MAX_DRAINS):
                if not self._port.read(256):
                    break
            else:
                raise self._error("does not stop sending: check baud rate and wiring")
        self._expects_late = False

    def _error(self, what: str) -> GripperError:
        return GripperError(f"{self._device}, unit {self._unit}: {self._slave} {what}")


class TcpMaster(Master):
    """A master on a TCP connection that uses Modbus TCP frames."""

    _transaction = 0

    def _exchange(self, request: bytes, length: int) -> bytes:
        self._transaction = (self._transaction + 1) % 0x10000
        self._port.write(struct.pack(">HHH", self._transaction, 0, len(request)) + request)
        head = self._port.read(HEAD)
        if len(head) < HEAD:
            return bytes(head)
        transaction, protocol, count = struct.unpack(">HHH", head)
        if (transaction, protocol) != (self._transaction, 0) or not 3 <= count <= length + 2:
            self._expects_late = True
            raise self._error(f"has sent an invalid answer ({head.hex(' ')}): it may not speak Modbus TCP")
        body: bytes = self._port.read(count)
        return framed(body) if len(body) == count else body
