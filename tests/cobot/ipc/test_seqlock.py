"""Records in shared memory. Oracles: what was written; a record whose fields must all be equal."""

from __future__ import annotations

import mmap
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cobot.errors import TornReadError
from cobot.ipc.seqlock import Block

RECORD = np.dtype([("number", "u8"), ("values", "f8", (200,)), ("text", "S24")])
READS = 20_000
WAIT_S = 120.0

WRITER = """
import mmap, sys
import numpy as np
from cobot.ipc.seqlock import Block
with open(sys.argv[1], "r+b") as file:
    memory = mmap.mmap(file.fileno(), 0)
block = Block(memory, 64, np.dtype([("number", "u8"), ("values", "f8", (200,)), ("text", "S24")]), "record")
number = 0
while True:
    number += 1
    block.data["number"] = number
    block.data["values"] = number
    block.data["text"] = str(number).encode()
    block.publish()
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "memory"
    path.write_bytes(bytes(64 + Block.size(RECORD) + 64))
    return path


@pytest.fixture
def memory(file: Path) -> Iterator[mmap.mmap]:
    with file.open("r+b") as opened:
        yield mmap.mmap(opened.fileno(), 0)


def block(memory: mmap.mmap) -> Block:
    return Block(memory, 64, RECORD, "record")


def filled(block: Block, number: int) -> Block:
    block.data["number"], block.data["values"], block.data["text"] = number, number, str(number).encode()
    return block


def test_what_is_published_is_read_and_nothing_beside_it_is_touched(memory: mmap.mmap) -> None:
    writer, reader = block(memory), block(memory)
    assert reader.read()["number"] == 0
    for number in (1, 7, 2**64 - 1):
        filled(writer, number).publish()
        record = reader.read()
        assert record["number"] == number
        assert (record["values"] == float(number)).all()
        assert record["text"] == str(number).encode()
    assert reader.sequence == 6
    assert memory[:64] == memory[-64:] == bytes(64)


def test_what_is_not_published_is_not_seen(memory: mmap.mmap) -> None:
    writer, reader = block(memory), block(memory)
    filled(writer, 1).publish()
    filled(writer, 2)
    assert reader.read()["number"] == 1


def test_no_torn_record_is_accepted_while_another_process_writes_without_pause(
    file: Path, memory: mmap.mmap
) -> None:
    reader = filled(block(memory), 0)
    reader.publish()
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(file)])
    try:
        deadline_s = time.monotonic() + WAIT_S
        accepted, numbers = 0, set()
        while accepted < READS or len(numbers) < 100:
            assert time.monotonic() < deadline_s
            if not reader.try_read():
                continue
            record = reader.data
            number = int(record["number"])
            accepted += 1
            numbers.add(number)
            assert (record["values"] == float(number)).all()
            assert record["text"] == str(number).encode()
    finally:
        writer.kill()
        writer.wait()


def test_a_record_whose_writer_was_killed_is_refused_or_whole_and_the_next_writer_recovers(
    file: Path, memory: mmap.mmap
) -> None:
    for _ in range(5):
        reader, before = block(memory), block(memory).sequence
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(file)])
        deadline_s = time.monotonic() + WAIT_S
        while reader.sequence < before + 1000:
            assert time.monotonic() < deadline_s
        writer.kill()
        writer.wait()
        if reader.sequence % 2:
            with pytest.raises(TornReadError, match="no consistent record in 100 reads"):
                reader.read()
        else:
            record = reader.read()
            assert (record["values"] == float(record["number"])).all()
        filled(block(memory), 5).publish()
        assert reader.read()["number"] == 5
        assert reader.sequence % 2 == 0


def test_a_writer_that_died_in_the_middle_cannot_pass_off_its_half(memory: mmap.mmap) -> None:
    writer, reader = block(memory), block(memory)
    filled(writer, 1).publish()
    memory[64:72] = (reader.sequence + 1).to_bytes(8, sys.byteorder)
    memory[80:88] = (99).to_bytes(8, sys.byteorder)
    with pytest.raises(TornReadError, match="no consistent record in 100 reads; its writer may have died"):
        reader.read()
    assert reader.salvage()["number"] == 99
    filled(writer, 2).publish()
    assert reader.read()["number"] == 2


@settings(max_examples=200, deadline=None, derandomize=True, database=None)
@given(place=st.integers(0, RECORD.itemsize - 1), flipped=st.integers(1, 255))
def test_a_changed_byte_anywhere_in_a_record_is_found(place: int, flipped: int) -> None:
    memory = mmap.mmap(-1, 64 + Block.size(RECORD))
    writer, reader = block(memory), block(memory)
    filled(writer, 3).publish()
    at = 64 + Block.size(RECORD) - RECORD.itemsize + place
    memory[at] ^= flipped
    assert not reader.try_read()
    memory[at] ^= flipped
    assert reader.try_read()
