"""Reads bytes from the network. All reading in this package uses it."""

from __future__ import annotations

from struct import Struct
from typing import Any

from cobot.dds.rtps.errors import MalformedError


class Layout:
    """A fixed sequence of fields in either byte order. `fields` is a format of `struct`."""

    __slots__ = ("big", "little", "size")

    def __init__(self, fields: str) -> None:
        self.big = Struct(f">{fields}")
        self.little = Struct(f"<{fields}")
        self.size = self.big.size


_U32 = Layout("I")
_SEQUENCE = Layout("iI")


class Cursor:
    """Reads forward through a part of a datagram. Reading beyond its end raises a MalformedError."""

    __slots__ = ("_data", "end", "little", "position")

    def __init__(self, data: memoryview, position: int, end: int, little: bool) -> None:
        if not 0 <= position <= end <= len(data):
            raise MalformedError(f"the part {position}..{end} is outside the {len(data)} bytes")
        self._data = data
        self.position = position
        self.end = end
        self.little = little

    @property
    def remaining(self) -> int:
        return self.end - self.position

    def skip(self, count: int) -> int:
        """Skip bytes. Returns the position of the first skipped byte."""
        start = self.position
        if count > self.end - start:
            raise MalformedError(f"{count} bytes needed, {self.remaining} left")
        self.position = start + count
        return start

    def read(self, layout: Layout) -> tuple[Any, ...]:
        start = self.skip(layout.size)
        return (layout.little if self.little else layout.big).unpack_from(self._data, start)

    def take(self, count: int) -> memoryview:
        """A view of the next bytes. It is valid only until the datagram has been processed."""
        start = self.skip(count)
        return self._data[start : start + count]

    def rest(self) -> memoryview:
        return self.take(self.remaining)

    def part(self, count: int) -> Cursor:
        """A cursor over the next bytes. This cursor skips them."""
        start = self.skip(count)
        return Cursor(self._data, start, start + count, self.little)

    def bytes(self, count: int) -> bytes:
        return self.take(count).tobytes()

    def u32(self) -> int:
        number: int = self.read(_U32)[0]
        return number

    def sequence(self) -> int:
        high, low = self.read(_SEQUENCE)
        number: int = (high << 32) | low
        return number
