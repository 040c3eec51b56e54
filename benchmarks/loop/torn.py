"""Reads of a block while another process writes it without a pause."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator

from benchmarks.loop.torn_writer import RECORD, mapped
from benchmarks.service import background
from benchmarks.table import Row, row
from cobot.ipc.memory_file import FOLDER
from cobot.ipc.seqlock import Block

WORD = 8


def torn_reads(reads: int) -> Iterator[Row]:
    """The number of records whose words differ, among those that the block accepts, and among plain
    copies.
    """
    with tempfile.NamedTemporaryFile(dir=FOLDER, prefix="bench-torn-") as file:
        block = mapped(file.name)
        with background("benchmarks.loop.torn_writer", file.name):
            while block.sequence < 1000:
                time.sleep(0.01)
            ours = _accepted(block, reads)
            bare = _copied(block, reads)
    yield row(
        f"{reads:,} reads of {RECORD.itemsize} bytes while they are written without a pause",
        "",
        ours,
        "as many copies without a check",
        bare,
        columns=("torn and accepted", "tries a read", "reads/s"),
        aim="0 torn",
    )


def _accepted(block: Block, reads: int) -> tuple[float, float, float]:
    try_read, record = block.try_read, block.buffer.data
    torn = tries = accepted = 0
    begun_s = time.perf_counter()
    while accepted < reads:
        tries += 1
        if try_read():
            accepted += 1
            copy = bytes(record)
            torn += copy[WORD:] != copy[:-WORD]
    return torn, tries / reads, reads / (time.perf_counter() - begun_s)


def _copied(block: Block, reads: int) -> tuple[float, float, float]:
    torn = 0
    record, salvage = block.buffer.data, block.salvage
    begun_s = time.perf_counter()
    for _ in range(reads):
        salvage()
        copy = bytes(record)
        torn += copy[WORD:] != copy[:-WORD]
    return torn, 1.0, reads / (time.perf_counter() - begun_s)
