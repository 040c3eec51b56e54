"""Sets of numbers in acknowledgements. Oracle: Python's sets; one bitmap of the RTPS 2.2 specification."""

from __future__ import annotations

import random
import struct

import pytest

from cobot.dds.rtps.cursor import Cursor
from cobot.dds.rtps.errors import MalformedError
from cobot.dds.rtps.number_sets import (
    MAX_BITS,
    pack_fragments,
    pack_sequences,
    read_fragments,
    read_sequences,
)

SEED = 20261122


def cursor(data: bytes) -> Cursor:
    return Cursor(memoryview(data), 0, len(data), True)


def test_the_specifications_example() -> None:
    """9.4.2.6: 1234:/12:00110 are 1236 and 1237 of the twelve from 1234 on."""
    packed = pack_sequences(1234, [1236, 1237])
    assert packed == struct.pack("<iIII", 0, 1234, 4, 0b0011 << 28)
    wider = struct.pack("<iIII", 0, 1234, 12, 0b0011 << 28)
    assert read_sequences(cursor(wider)) == (1234, [1236, 1237])


def test_random_sets_come_back() -> None:
    dice = random.Random(SEED)
    for _ in range(2000):
        base = dice.choice([1, 2**31, 2**40, 2**62]) + dice.randrange(1000)
        members = {base + dice.randrange(-20, MAX_BITS + 40) for _ in range(dice.randrange(60))}
        inside = sorted(each for each in members if base <= each < base + MAX_BITS)
        assert read_sequences(cursor(pack_sequences(base, members))) == (base, inside)
        low = base % 2**31
        moved = [each - base + low for each in members]
        expected = sorted(each for each in moved if low <= each < low + MAX_BITS)
        assert read_fragments(cursor(pack_fragments(low, moved))) == (low, expected)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (struct.pack("<iII", 0, 1, 257), "a set has 257 bits, allowed: 256"),
        (struct.pack("<iII", 0, 1, 2**32 - 1), "allowed: 256"),
        (struct.pack("<iII", -1, 1, 0), "a set of sequence numbers from -"),
        (struct.pack("<iIII", 0, 1, 64, 0), "4 bytes needed, 0 left"),
    ],
)
def test_what_cannot_be_a_set_is_malformed(data: bytes, sentence: str) -> None:
    with pytest.raises(MalformedError, match=sentence):
        read_sequences(cursor(data))
