"""The floor for a command through shared memory: a bare loop at 1 kHz that answers one block in another.

    python -m benchmarks.loop.bare_echo FILE

The answer is the number that it was asked for, and when.
"""

from __future__ import annotations

import mmap
import os
import sys
import time

import numpy as np

from cobot.config import load_settings
from cobot.ipc.seqlock import Block
from rtloop.clock import RealtimeClock
from rtloop.realtime import freeze_garbage, prepare

RECORD = np.dtype([("number", "u8"), ("monotonic_ns", "i8")])
PAGE = 4096


def mapped(path: str) -> tuple[Block, Block]:
    """The question and the answer in a file, which is created with the required size."""
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.ftruncate(descriptor, 2 * PAGE)
        memory = mmap.mmap(descriptor, 2 * PAGE)
        return Block(memory, 0, RECORD, "question"), Block(memory, PAGE, RECORD, "answer")
    finally:
        os.close(descriptor)


def main(path: str) -> None:
    question, answer = mapped(path)
    settings = load_settings(None)
    prepare(settings.rt.priority, settings.rt.cpu, settings.rt.cpu_latency_us)
    freeze_garbage()
    clock = RealtimeClock(settings.rt.period_s)
    while True:
        clock.wait(moving=True)
        if question.try_read() and question.data["number"] != answer.data["number"]:
            answer.data["number"] = question.data["number"]
            answer.data["monotonic_ns"] = time.monotonic_ns()
            answer.publish()


if __name__ == "__main__":
    main(sys.argv[1])
