"""A record in shared memory with one writer, any number of readers, and no lock.

The writer makes the sequence counter odd, copies, writes a checksum, makes the counter even. A
reader copies and accepts the copy only if the counter was even and the same before and after, and
the checksum fits; so a torn read is found on any memory model, and a writer that died half way
cannot pass off its half.
"""

from __future__ import annotations

import time
import zlib
from mmap import mmap

import numpy as np

from cobot.errors import TornReadError

_HEAD_BYTES = 16
_SEQUENCE, _CHECKSUM = 0, 1
_MASK = 2**64 - 1
READ_TRIES = 100
"""A write takes some microseconds; so many failures in a row mean that the writer died in one."""


class Block:
    """One record of the given dtype at an offset of a mapped file.

    `data` is this process's private copy: a writer fills it and calls `publish`, a reader calls
    `read` and finds the newest consistent record in it.
    """

    def __init__(self, memory: mmap, offset: int, dtype: np.dtype, name: str) -> None:
        self.name = name
        self.data = np.zeros((), dtype)
        # memoryviews: to read or write a number in one costs a fifth of what it costs in an array
        view = memoryview(memory)[offset : offset + self.size(dtype)]
        self._head = view[:_HEAD_BYTES].cast("Q")
        self._shared = view[_HEAD_BYTES:]
        self._private = self.buffer.data

    @property
    def buffer(self) -> np.ndarray:
        """The bytes of `data`, shape (size,), writable."""
        return np.ndarray(self.data.dtype.itemsize, np.uint8, self.data)

    @staticmethod
    def size(dtype: np.dtype) -> int:
        """Bytes that a block takes in the file."""
        return _HEAD_BYTES + dtype.itemsize

    @property
    def sequence(self) -> int:
        """Twice the number of publications; odd while one is under way."""
        return self._head[_SEQUENCE]

    def publish(self) -> None:
        """Make `data` visible to readers. Real-time safe. Only the block's one writer may call it."""
        head = self._head
        begun = head[_SEQUENCE] | 1
        head[_SEQUENCE] = begun
        self._shared[:] = self._private
        head[_CHECKSUM] = zlib.crc32(self._private)
        head[_SEQUENCE] = (begun + 1) & _MASK

    def try_read(self) -> bool:
        """Copy the record into `data` if it is consistent; one try, real-time safe.

        On False `data` holds garbage.
        """
        head = self._head
        before = head[_SEQUENCE]
        if before % 2:
            return False
        self._private[:] = self._shared
        checksum = head[_CHECKSUM]
        return head[_SEQUENCE] == before and (before == 0 or zlib.crc32(self._private) == checksum)

    def salvage(self) -> np.ndarray:
        """What lies there (`data`), consistent or not: for a writer that takes over from a dead one."""
        self._private[:] = self._shared
        return self.data

    def read(self) -> np.ndarray:
        """The newest consistent record (`data`, overwritten by the next read).

        Raises:
            TornReadError: none in `READ_TRIES` tries.
        """
        for attempt in range(READ_TRIES):
            if self.try_read():
                return self.data
            time.sleep(0.0 if attempt < 10 else 0.0001)
        raise TornReadError(
            f"shared memory: no consistent {self.name} in {READ_TRIES} reads; its writer may have died"
        )
