"""Sets of numbers within a range of 256, as used in acknowledgements and gaps (RTPS 2.2, 9.4.2.6)."""

from __future__ import annotations

from collections.abc import Iterable
from struct import Struct

from cobot.dds.rtps.cursor import Cursor
from cobot.dds.rtps.errors import MalformedError

MAX_BITS = 256
_SEQUENCE_BASE = Struct("<iII")
_FRAGMENT_BASE = Struct("<II")


def _bitmap(base: int, members: Iterable[int]) -> tuple[int, bytes]:
    """A set as a bitmap: its number of bits, and its words. Members outside base..base+255 are omitted."""
    words = [0] * (MAX_BITS // 32)
    count = 0
    for member in members:
        offset = member - base
        if 0 <= offset < MAX_BITS:
            words[offset >> 5] |= 1 << (31 - (offset & 31))
            count = max(count, offset + 1)
    return count, b"".join(word.to_bytes(4, "little") for word in words[: (count + 31) // 32])


def pack_sequences(base: int, members: Iterable[int]) -> bytes:
    count, words = _bitmap(base, members)
    return _SEQUENCE_BASE.pack(base >> 32, base & 0xFFFFFFFF, count) + words


def pack_fragments(base: int, members: Iterable[int]) -> bytes:
    count, words = _bitmap(base, members)
    return _FRAGMENT_BASE.pack(base, count) + words


def _members(cursor: Cursor, base: int) -> list[int]:
    count = cursor.u32()
    if count > MAX_BITS:
        raise MalformedError(f"a set has {count} bits, allowed: {MAX_BITS}")
    members = []
    for first in range(0, count, 32):
        word = cursor.u32()
        if word:
            members += [base + first + i for i in range(min(32, count - first)) if word & (1 << (31 - i))]
    return members


def read_sequences(cursor: Cursor) -> tuple[int, list[int]]:
    """Read a set. Returns its base and its members in ascending order. All numbers below the base also belong
    to the set.
    """
    base = cursor.sequence()
    if base < 0:
        raise MalformedError(f"a set of sequence numbers from {base} is invalid")
    return base, _members(cursor, base)


def read_fragments(cursor: Cursor) -> tuple[int, list[int]]:
    base = cursor.u32()
    return base, _members(cursor, base)
