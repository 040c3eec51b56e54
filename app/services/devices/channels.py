"""Byte channels to devices. This is the common part of sockets and serial ports."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from app.services.clients import CLIENT
from cobot.errors import ConflictError, DeviceError, DeviceTimeout, InputError, LimitError, NotFoundError
from cobot.strict import shown

BUFFER_BYTES = 65_536
"""Maximum number of received bytes that have not been read. When it is reached, the sender must wait."""
MAX_OPEN = 32
MAX_NAME = 200
TIMEOUT_S = 2.0
TIMEOUTS_S = (0.001, 60.0)
ENDS = b"\r\n"
Result = TypeVar("Result")


def checked_timeout(timeout_s: float) -> float:
    """Return the timeout, s. Raises LimitError if it is out of bounds."""
    shortest, longest = TIMEOUTS_S
    if not shortest <= timeout_s <= longest:
        raise LimitError(f"a timeout must be from {shortest} to {longest:g} s, got {timeout_s:g}")
    return timeout_s


class Channel:
    """An open connection to a device.

    Args:
        name: displayed name.
        reader: stream that the receiving task fills. Its limit is `BUFFER_BYTES`.
        write: function that sends all of the given bytes, or raises OSError.
        close: function that closes the device.
    """

    def __init__(
        self,
        name: str,
        reader: asyncio.StreamReader,
        write: Callable[[bytes], Awaitable[Any]],
        close: Callable[[], Any],
    ) -> None:
        self.name = name
        self.close = close
        self._reader = reader
        self._write = write
        self._reading = asyncio.Lock()
        self._writing = asyncio.Lock()

    async def send(self, data: bytes, timeout_s: float = TIMEOUT_S) -> None:
        """Send bytes.

        Raises:
            DeviceError: the connection has ended, or the device reads too slowly.
        """

        async def send() -> None:
            async with self._writing:
                await self._write(data)

        await self._with_timeout(timeout_s, send, f"not all of {len(data)} bytes were sent")

    async def read_some(self, timeout_s: float) -> bytes:
        """Wait for the first byte, and return all bytes that have arrived."""
        return await self._read(timeout_s, lambda: self._read_available(), "no byte arrived")

    async def read_exactly(self, count: int, timeout_s: float) -> bytes:
        """Read exactly `count` bytes, from 1 to `BUFFER_BYTES`."""
        if not 1 <= count <= BUFFER_BYTES:
            raise InputError(f"number must be from 1 to {BUFFER_BYTES}, got {count}")
        return await self._read(
            timeout_s, lambda: self._reader.readexactly(count), f"{count} bytes did not arrive"
        )

    async def read_until(self, end: bytes, timeout_s: float) -> bytes:
        """Read all bytes up to and including `end`."""
        data = await self._read(timeout_s, lambda: self._until(end), f"{end!r} did not arrive")
        return data.removesuffix(end)

    async def read_between(self, prefix: bytes, suffix: bytes, timeout_s: float) -> bytes:
        """Read the bytes between a prefix and a suffix. If both are empty, return the bytes that have
        arrived.
        """
        if prefix:
            await self.read_until(prefix, timeout_s)
        return await (self.read_until(suffix, timeout_s) if suffix else self.read_some(timeout_s))

    async def read_line(self, timeout_s: float) -> bytes:
        """Read a line. It is returned without its line ending."""
        return (await self.read_until(b"\n", timeout_s)).rstrip(ENDS)

    async def _read_available(self) -> bytes:
        data = await self._reader.read(BUFFER_BYTES)
        if not data:
            raise asyncio.IncompleteReadError(b"", None)
        return data

    async def _until(self, end: bytes) -> bytes:
        try:
            return await self._reader.readuntil(end)
        except asyncio.LimitOverrunError as exc:  # otherwise the buffer would stay full
            await self._reader.readexactly(exc.consumed)
            raise DeviceError(f"{self.name}: no {end!r} in {exc.consumed} bytes, which are dropped") from exc

    async def _read(self, timeout_s: float, read: Callable[[], Awaitable[bytes]], missing: str) -> bytes:
        async def take_turn() -> bytes:
            async with self._reading:  # a StreamReader has one reader at a time
                return await read()

        return await self._with_timeout(timeout_s, take_turn, missing)

    async def _with_timeout(
        self, timeout_s: float, work: Callable[[], Awaitable[Result]], missing: str
    ) -> Result:
        checked_timeout(timeout_s)
        try:
            return await asyncio.wait_for(work(), timeout_s)
        except TimeoutError as exc:
            raise DeviceTimeout(f"{self.name}: {missing} within {timeout_s:g} s") from exc
        except asyncio.IncompleteReadError as exc:
            raise DeviceError(f"{self.name}: the connection has ended") from exc
        except OSError as exc:
            raise DeviceError(f"{self.name}: {exc.strerror or exc}") from exc


class Channels:
    """The open connections to devices, by name."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self._open: dict[str, Channel] = {}
        # for each channel that a program has opened: the program's token
        self._opened_by: dict[str, str] = {}
        self._ended: deque[str] = deque(
            maxlen=MAX_OPEN
        )  # programs that have ended, but whose last request may still be in progress

    def get(self, name: str) -> Channel:
        """Return the channel with the given name.

        Raises:
            NotFoundError: there is no such channel. The error lists the open ones.
        """
        if name not in self._open:
            there = ", ".join(sorted(self._open)) or "none"
            raise NotFoundError(f"there is no open {self._kind} {shown(name)}; open {self._kind}s: {there}")
        return self._open[name]

    def require_place(self, name: str) -> None:
        """Check that a further channel may be opened with this name.

        Raises:
            ConflictError: the name is taken, or too many channels are open.
            InputError: the name is empty or too long.
        """
        if not 1 <= len(name) <= MAX_NAME:
            raise InputError(f"a name must be 1 to {MAX_NAME} characters long, got {shown(name)}")
        if name in self._open:
            raise ConflictError(f"the {self._kind} {shown(name)} is already open; close it first")
        if len(self._open) >= MAX_OPEN:
            raise ConflictError(f"{MAX_OPEN} of the kind {self._kind} are already open, which is the maximum")

    def add(self, name: str, channel: Channel) -> None:
        """Add the channel, unless the name has been taken in the meantime."""
        try:
            self.require_place(name)
            program = CLIENT.get().sequence
            if program in self._ended:
                raise ConflictError("the program that this request belongs to has ended")
        except ConflictError:
            channel.close()
            raise
        self._open[name] = channel
        if program is not None:
            self._opened_by[name] = program

    def close(self, name: str) -> None:
        """Close a channel and forget it."""
        self.get(name).close()
        del self._open[name]
        self._opened_by.pop(name, None)

    def close_left_open(self, token: str) -> None:
        """Close the channels that a program has left open, regardless of how it ended."""
        self._ended.append(token)
        for name in [name for name, program in self._opened_by.items() if program == token]:
            self.close(name)

    def close_all(self) -> None:
        self._opened_by.clear()
        for channel in self._open.values():
            channel.close()
        self._open.clear()
