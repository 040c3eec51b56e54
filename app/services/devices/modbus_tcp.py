"""Sends Modbus TCP requests, one at a time, and checks the answers strictly.

Sources: MODBUS Application Protocol V1.1b3 and MODBUS Messaging on TCP/IP V1.0b, modbus.org. An answer that
violates these specifications is an error. If the start of the next answer is then unknown, the connection is
closed.
"""

from __future__ import annotations

import asyncio
import struct

from cobot.errors import DeviceError
from cobot.modbus import COIL_ON, REFUSALS, REFUSED, ModbusFunction

TIMEOUT_S = 1.0
MAX_LENGTH = 254
"""Maximum length of a message in bytes, counted from its unit identifier. A longer message is invalid."""
_HEAD = struct.Struct(">HHH")  # number of the transaction, 0 for Modbus, length of the rest
_REQUEST = struct.Struct(">BBHH")  # unit, function, address, count or value
_BYTES = {
    ModbusFunction.READ_COILS: 1,
    ModbusFunction.READ_DISCRETE_INPUTS: 1,
    ModbusFunction.READ_HOLDING_REGISTERS: 2,
    ModbusFunction.READ_INPUT_REGISTERS: 2,
}
"""Number of bytes of a single value, by function."""


class ModbusConnection:
    """A connection to one device."""

    def __init__(self, host: str, port: int) -> None:
        self._host = host
        self._port = port
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._number = 0

    @property
    def connected(self) -> bool:
        return self._streams is not None

    async def connect(self) -> None:
        """Connect. Raises OSError (such as TimeoutError) if this fails, or ValueError if the host name is
        invalid.
        """
        async with asyncio.timeout(TIMEOUT_S):
            self._streams = await asyncio.open_connection(self._host, self._port, limit=4 * MAX_LENGTH)

    def close(self) -> None:
        if self._streams is not None:
            self._streams[1].close()
            self._streams = None

    async def read(self, unit: int, function: ModbusFunction, address: int) -> int:
        """Read one value. Raises the same errors as `write`."""
        size = _BYTES[function]
        data = await self._ask(unit, function, address, 1)
        if len(data) != 1 + size or data[0] != size:
            raise _wrong_answer(unit)
        value = int.from_bytes(data[1:], "big")
        return value & 1 if size == 1 else value

    async def write(self, unit: int, function: ModbusFunction, address: int, value: int) -> None:
        """Set a coil (0 or 1) or a register. Returns when the device has confirmed it.

        Raises:
            DeviceError: the device rejects the request, does not answer, or sends a wrong answer; the error
                gives the details.
        """
        sent = COIL_ON * value if function is ModbusFunction.WRITE_COIL else value
        if await self._ask(unit, function, address, sent) != struct.pack(">HH", address, sent):
            raise _wrong_answer(unit)

    async def _ask(self, unit: int, function: ModbusFunction, address: int, value: int) -> bytes:
        """Send a request. Return the part of the answer after the function code."""
        if self._streams is None:
            raise DeviceError(f"unit {unit} is not connected")
        reader, writer = self._streams
        self._number = self._number % 0xFFFF + 1
        request = _REQUEST.pack(unit, function, address, value)
        try:
            async with asyncio.timeout(TIMEOUT_S):
                writer.write(_HEAD.pack(self._number, 0, len(request)) + request)
                number, protocol, length = _HEAD.unpack(await reader.readexactly(_HEAD.size))
                if (number, protocol) != (self._number, 0) or not 3 <= length <= MAX_LENGTH:
                    self.close()
                    raise _wrong_answer(unit)
                body = await reader.readexactly(length)
        except TimeoutError:
            self.close()  # a late answer must not be taken for the answer to the next request
            raise DeviceError(f"unit {unit} has not answered within {TIMEOUT_S:g} s") from None
        except asyncio.IncompleteReadError:
            self.close()
            raise DeviceError(f"unit {unit} has closed the connection instead of answering") from None
        except OSError as exc:
            self.close()
            raise DeviceError(f"unit {unit}: {exc.strerror or exc}") from exc
        except asyncio.CancelledError:
            self.close()
            raise
        if body[0] != unit or body[1] & ~REFUSED != function:
            raise _wrong_answer(unit)
        if body[1] & REFUSED:
            why = REFUSALS.get(body[2], "unknown")
            raise DeviceError(f"unit {unit} rejects address {address}: {why} (exception {body[2]})")
        return body[2:]


def _wrong_answer(unit: int) -> DeviceError:
    return DeviceError(f"the answer of unit {unit} does not match the request")
