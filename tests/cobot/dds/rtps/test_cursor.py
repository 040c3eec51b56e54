"""Reading what came from the network. Oracle: struct on the same bytes."""

from __future__ import annotations

import random
import struct

import pytest

from cobot.dds.rtps.cursor import Cursor, Layout
from cobot.dds.rtps.errors import MalformedError

SEED = 20261122


def cursor(data: bytes, *, little: bool = True) -> Cursor:
    return Cursor(memoryview(data), 0, len(data), little)


@pytest.mark.parametrize("little", [True, False])
def test_numbers_are_read_in_the_byte_order_of_the_part(little: bool) -> None:
    order = "<" if little else ">"
    data = struct.pack(f"{order}IiIHB", 7, -1, 5, 513, 9)
    reading = cursor(data, little=little)
    assert reading.u32() == 7
    assert reading.sequence() == (-1 << 32) | 5
    assert reading.read(Layout("HB")) == (513, 9)
    assert reading.remaining == 0


def test_nothing_beyond_the_end_is_read_whatever_is_asked_for() -> None:
    dice = random.Random(SEED)
    for _ in range(5000):
        data = dice.randbytes(dice.randrange(24))
        reading, left = cursor(data), data
        for _ in range(6):
            count = dice.randrange(12)
            if count > len(left):
                with pytest.raises(MalformedError, match=f"{count} bytes needed, {len(left)} left"):
                    reading.bytes(count)
                assert reading.remaining == len(left)  # a refused read moves nothing
            else:
                assert reading.bytes(count) == left[:count]
                left = left[count:]
        assert reading.rest().tobytes() == left


def test_a_part_ends_where_it_ends_and_the_whole_goes_on_behind_it() -> None:
    reading = cursor(b"abcdef")
    part = reading.part(4)
    assert part.bytes(4) == b"abcd"
    with pytest.raises(MalformedError):
        part.skip(1)
    assert reading.bytes(2) == b"ef"
    with pytest.raises(MalformedError, match=r"the part 4\.\.9 is outside the 6 bytes"):
        Cursor(memoryview(b"abcdef"), 4, 9, True)
