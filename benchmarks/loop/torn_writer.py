"""A writer that never pauses: records of the state's size, all words of one alike.

python -m benchmarks.loop.torn_writer FILE
"""

from __future__ import annotations

import mmap
import os
import sys

import numpy as np

from cobot.ipc.seqlock import Block
from cobot.ipc.state_fields import state_dtype

RECORD = np.dtype([("words", "u8", (state_dtype(7).itemsize // 8,))])


def mapped(path: str) -> Block:
    """The block in a file, which is created with the required size."""
    descriptor = os.open(path, os.O_RDWR)
    try:
        os.ftruncate(descriptor, Block.size(RECORD))
        return Block(mmap.mmap(descriptor, Block.size(RECORD)), 0, RECORD, "record")
    finally:
        os.close(descriptor)


if __name__ == "__main__":
    block = mapped(sys.argv[1])
    words = block.data["words"]
    while True:
        words += 1
        block.publish()
