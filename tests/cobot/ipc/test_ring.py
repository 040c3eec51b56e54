"""The ring of numbered records in shared memory.

Oracle: what was written, told by a record whose fields must all be equal, while another process writes
without a pause and is killed.
"""

from __future__ import annotations

import mmap
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from cobot_run import HELPER_ENVIRONMENT
from hypothesis import given
from hypothesis import strategies as st
from sample_counts import samples

from cobot.ipc.ring import Ring

RECORD = np.dtype([("number", "u8"), ("values", "f8", (50,)), ("checksum", "u8")])
CAPACITY = 64
READS = samples(20_000)
WAIT_S = 120.0

WRITER = """
import mmap, sys
import numpy as np
from cobot.ipc.ring import Ring
record = np.zeros((), np.dtype([("number", "u8"), ("values", "f8", (50,)), ("checksum", "u8")]))
with open(sys.argv[1], "r+b") as file:
    ring = Ring(mmap.mmap(file.fileno(), 0), 0, record.dtype, 64)
number = ring.newest
while True:
    number += 1
    record["number"], record["values"] = number, number
    ring.put(record)
"""


def ring(capacity: int = CAPACITY) -> Ring:
    return Ring(mmap.mmap(-1, Ring.size(RECORD, capacity)), 0, RECORD, capacity)


def put(ring: Ring, number: int) -> None:
    record = np.zeros((), RECORD)
    record["number"], record["values"] = number, number
    ring.put(record)


def whole(records: np.ndarray) -> bool:
    return bool((records["values"] == records["number"][:, None]).all())


@given(
    capacity=st.integers(1, 20),
    written=st.integers(0, 60),
    first=st.integers(-5, 70),
    count=st.integers(-3, 100),
)
def test_what_is_read_is_what_is_still_there_of_the_numbers_asked_for(
    capacity: int, written: int, first: int, count: int
) -> None:
    made = ring(capacity)
    for number in range(1, written + 1):
        put(made, number)
    assert made.newest == written
    there = range(max(1, written - capacity + 1), written + 1)
    asked = range(max(1, first), min(max(1, first) + capacity, first + count))
    found = made.read(first, count)
    assert found["number"].tolist() == [number for number in asked if number in there]
    assert whole(found)


@given(
    first_capacity=st.integers(1, 20),
    capacity=st.integers(1, 30),
    steps=st.lists(st.integers(0, 25), max_size=8),
)
def test_a_copy_has_everything_or_counts_it_as_lost(
    first_capacity: int, capacity: int, steps: list[int]
) -> None:
    source, copy = ring(first_capacity), ring(capacity)
    written, expected, next_number, lost = 0, [], 1, 0
    for step in steps:
        for _ in range(step):
            written += 1
            put(source, written)
        expected += range(max(next_number, written - first_capacity + 1), written + 1)
        next_number, missing = copy.copy_from(source, next_number)
        lost += missing
    assert next_number == written + 1
    assert lost + len(expected) == written
    newest = copy.read(max(1, written - capacity + 1), capacity)
    assert newest["number"].tolist() == [number for number in expected if number > written - capacity]


@given(place=st.integers(0, RECORD.itemsize - 1), flipped=st.integers(1, 255))
def test_a_record_with_a_wrong_byte_is_not_there(place: int, flipped: int) -> None:
    memory = mmap.mmap(-1, Ring.size(RECORD, 1))
    made = Ring(memory, 0, RECORD, 1)
    put(made, 1)
    memory[64 + place] ^= flipped
    assert len(made.read(1, 1)) == 0


@given(newest=st.integers(0, 2**64 - 1))
def test_a_spoilt_newest_number_loses_nothing_and_leads_nowhere(newest: int) -> None:
    memory = mmap.mmap(-1, Ring.size(RECORD, CAPACITY))
    made, copy = Ring(memory, 0, RECORD, CAPACITY), ring()
    for number in range(1, 11):
        put(made, number)
    memory[:8] = newest.to_bytes(8, sys.byteorder)
    following, lost = copy.copy_from(made, 1)
    assert lost == 0
    assert following == (newest + 1 if 1 <= newest <= 10 else 1)
    put(made, 11)
    assert copy.copy_from(made, following) == (12, 0)
    assert copy.read(1, 20)["number"].tolist() == list(range(1, 12))


def test_a_ring_that_cannot_be_is_refused() -> None:
    memory = mmap.mmap(-1, 4096)
    with pytest.raises(ValueError, match="cannot be at 4"):
        Ring(memory, 4, RECORD, 1)
    with pytest.raises(ValueError, match="at least"):
        Ring(memory, 0, RECORD, 1000)
    with pytest.raises(ValueError, match="number first and its checksum last"):
        Ring(memory, 0, np.dtype([("values", "f8"), ("checksum", "u8")]), 1)


def test_no_torn_record_is_taken_while_another_process_writes_and_is_killed(tmp_path: Path) -> None:
    file = tmp_path / "ring"
    file.write_bytes(bytes(Ring.size(RECORD, CAPACITY)))
    with file.open("r+b") as opened:
        made = Ring(mmap.mmap(opened.fileno(), 0), 0, RECORD, CAPACITY)
    taken, kills = 0, 0
    deadline_s = time.monotonic() + WAIT_S
    while kills < 3:
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(file)], env=HELPER_ENVIRONMENT)
        try:
            goal = taken + READS // 3
            while taken < goal:
                assert time.monotonic() < deadline_s, f"{taken} records were read"
                found = made.read(made.newest - CAPACITY + 1, CAPACITY)
                assert whole(found)
                assert (np.diff(found["number"].astype(np.int64)) > 0).all()
                taken += len(found)
        finally:
            writer.send_signal(signal.SIGKILL)
            writer.wait()
        kills += 1
        left = made.read(made.newest - CAPACITY + 1, CAPACITY + 1)
        assert len(left) >= CAPACITY - 1, "the one that was being written when it died"
        assert whole(left)
