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

_HEAD = np.dtype([("sequence", "<u8"), ("checksum", "<u8")])
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
        self._head = np.ndarray((), _HEAD, memory, offset)
        self._shared = np.ndarray(dtype.itemsize, np.uint8, memory, offset + _HEAD.itemsize)
        self._private = np.ndarray(dtype.itemsize, np.uint8, self.data)
        self._sequence = self._head["sequence"]
        self._checksum = self._head["checksum"]

    @property
    def buffer(self) -> np.ndarray:
        """The bytes of `data`, shape (size,), writable."""
        return self._private

    @staticmethod
    def size(dtype: np.dtype) -> int:
        """Bytes that a block takes in the file."""
        return _HEAD.itemsize + dtype.itemsize

    @property
    def sequence(self) -> int:
        """Twice the number of publications; odd while one is under way."""
        return int(self._sequence)

    def publish(self) -> None:
        """Make `data` visible to readers. Real-time safe. Only the block's one writer may call it."""
        begun = (int(self._sequence) | 1) if self._sequence % 2 else int(self._sequence) + 1
        self._sequence[...] = begun
        self._shared[:] = self._private
        self._checksum[...] = zlib.crc32(self._private.data)
        self._sequence[...] = begun + 1

    def try_read(self) -> bool:
        """Copy the record into `data` if it is consistent; one try, real-time safe.

        On False `data` holds garbage.
        """
        before = int(self._sequence)
        if before % 2:
            return False
        self._private[:] = self._shared
        checksum = int(self._checksum)
        return int(self._sequence) == before and (before == 0 or zlib.crc32(self._private.data) == checksum)

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
