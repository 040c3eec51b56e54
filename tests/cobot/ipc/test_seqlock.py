"""Records in shared memory.

Oracles: what was written; a record whose fields must all be equal; XXH64 as its specification states it, in
numpy, and the values that are published for it.
"""

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
from cobot.ipc.layout import STATISTICS
from cobot.ipc.seqlock import Block, checksum
from cobot.ipc.state_fields import state_dtype

RECORD = np.dtype([("number", "u8"), ("values", "f8", (200,)), ("text", "S24")])
READS = 20_000
WAIT_S = 120.0
MIXTURES = 1_000_000
CACHE_LINE = 64

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


@settings(max_examples=200)
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


def test_a_block_beyond_the_mapping_or_beside_a_word_is_refused() -> None:
    memory = mmap.mmap(-1, 4096)
    with pytest.raises(ValueError, match="multiple of 8 bytes, not at 4"):
        Block(memory, 4, RECORD, "record")
    with pytest.raises(ValueError, match="at least"):
        Block(memory, 4096 - RECORD.itemsize, RECORD, "record")


P1, P2, P3, P4, P5 = (
    np.uint64(prime)
    for prime in (
        0x9E3779B185EBCA87,
        0xC2B2AE3D27D4EB4F,
        0x165667B19E3779F9,
        0x85EBCA77C2B2AE63,
        0x27D4EB2F165667C5,
    )
)


def turned(words: np.ndarray, bits: int) -> np.ndarray:
    return (words << np.uint64(bits)) | (words >> np.uint64(64 - bits))


def entered(lane: np.ndarray, word: np.ndarray) -> np.ndarray:
    return turned(lane + word * P2, 31) * P1


def xxh64(records: np.ndarray) -> np.ndarray:
    """Of each row of bytes, shape (n, size); seed 0."""
    n, size = records.shape
    with np.errstate(over="ignore"):
        digest = np.full(n, P5)
        stripes = size // 32
        if stripes:
            words = records[:, : 32 * stripes].copy().view(np.uint64).reshape(n, stripes, 4)
            lanes = np.tile([P1 + P2, P2, np.uint64(0), np.uint64(0) - P1], (n, 1))
            for stripe in range(stripes):
                lanes = entered(lanes, words[:, stripe])
            digest = sum(turned(lanes[:, lane], bits) for lane, bits in enumerate((1, 7, 12, 18)))
            for lane in range(4):
                digest = (digest ^ entered(np.zeros(n, np.uint64), lanes[:, lane])) * P1 + P4
        digest += np.uint64(size)
        at = 32 * stripes
        while size - at >= 8:
            word = records[:, at : at + 8].copy().view(np.uint64)[:, 0]
            digest = turned(digest ^ entered(np.zeros(n, np.uint64), word), 27) * P1 + P4
            at += 8
        if size - at >= 4:
            word = records[:, at : at + 4].copy().view(np.uint32)[:, 0].astype(np.uint64)
            digest = turned(digest ^ word * P1, 23) * P2 + P3
            at += 4
        for place in range(at, size):
            digest = turned(digest ^ records[:, place].astype(np.uint64) * P5, 11) * P1
        digest = (digest ^ (digest >> np.uint64(33))) * P2
        digest = (digest ^ (digest >> np.uint64(29))) * P3
        return digest ^ (digest >> np.uint64(32))


@pytest.mark.parametrize(
    ("record", "expected"),
    [(b"", 0xEF46DB3751D8E999), (b"a", 0xD24EC4F1A98C6E5B), (b"abc", 0x44BC2CF5AD770999)],
)
def test_the_checksum_is_what_is_published_for_xxh64(record: bytes, expected: int) -> None:
    assert checksum(bytearray(record)) == expected
    assert int(xxh64(np.frombuffer(record, np.uint8).reshape(1, -1))[0]) == expected


def test_the_checksum_of_records_of_every_length_is_that_of_the_specification() -> None:
    random = np.random.default_rng(11)
    for size in (*range(1, 131), 1352, 1357, STATISTICS.itemsize):
        records = random.integers(0, 256, (800 if size < 200 else 20, size), np.uint8)
        assert [checksum(record) for record in records] == xxh64(records).tolist(), size


def test_the_checksum_does_not_depend_on_where_a_record_lies() -> None:
    record = np.random.default_rng(12).integers(0, 256, 1001, np.uint8)
    place = np.zeros(1100, np.uint8)
    for at in range(17):
        place[at : at + 1001] = record
        assert checksum(place[at : at + 1001]) == checksum(record)


def test_every_single_flipped_bit_of_a_state_changes_the_checksum() -> None:
    record = np.random.default_rng(13).integers(0, 256, state_dtype(7).itemsize, np.uint8)
    right, found = checksum(record), set()
    for bit in range(8 * len(record)):
        record[bit // 8] ^= 1 << bit % 8
        found.add(checksum(record))
        record[bit // 8] ^= 1 << bit % 8
    assert right not in found
    assert len(found) == 8 * len(record)


def test_a_mixture_of_two_states_never_has_the_checksum_of_one() -> None:
    """Cache lines of one cycle and of the next: as alike as records are, and as a torn read mixes them."""
    random = np.random.default_rng(14)
    dtype = state_dtype(2)
    lines = -(-dtype.itemsize // CACHE_LINE)
    checked = 0
    while checked < MIXTURES:
        first, second = state(dtype, random), np.zeros((), dtype)
        second[()] = first
        second["cycle"] += 1
        for name in ("monotonic_ns", "measured_monotonic_ns"):
            second[name] += 1_000_000
        for name in ("position", "velocity", "effort", "commanded_position", "tcp"):
            second[name] += random.normal(size=second[name].shape) * 1e-6
        one, other = (np.frombuffer(record.tobytes(), np.uint64) for record in (first, second))
        from_other = np.repeat(random.random((2000, lines)) < 0.5, CACHE_LINE // 8, axis=1)[:, : len(one)]
        mixed = np.where(from_other, other, one)
        mixed = mixed[(mixed != one).any(axis=1) & (mixed != other).any(axis=1)]
        taken = {checksum(one.copy()), checksum(other.copy())}
        assert len(taken) == 2
        assert taken.isdisjoint(map(checksum, mixed))
        checked += len(mixed)


def state(dtype: np.dtype, random: np.random.Generator) -> np.ndarray:
    record = np.zeros((), dtype)
    for name in dtype.names or ():
        field = dtype[name]
        if field.base.kind == "f":
            record[name] = random.normal(size=field.shape)
        elif field.base.kind in "ui":
            record[name] = random.integers(0, 2**40, field.shape)
    record["reason"] = b"stop requested"
    return record
