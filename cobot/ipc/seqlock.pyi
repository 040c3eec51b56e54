from mmap import mmap

import numpy as np

READ_TRIES: int

def checksum(record: object) -> int: ...

class SharedCounter:
    """A number that any process may increment at any time. It has no single writer that could die during a
    write."""

    def __init__(self, memory: mmap, offset: int) -> None: ...
    @property
    def value(self) -> int: ...
    def add(self) -> None: ...

class Block:
    """One record of the given dtype at an offset of a mapped file.

    `data` is this process's private copy: a writer fills it and calls `publish`; after a reader calls `read`,
    it has the latest consistent record. `buffer` is its bytes, shape (size,), writable. `name` and `writer`
    (the process that publishes) are names for errors.
    """

    name: str
    writer: str
    data: np.ndarray
    buffer: np.ndarray
    _head: memoryview
    _shared: memoryview
    def __init__(
        self, memory: mmap, offset: int, dtype: np.dtype, name: str, writer: str = "its writer"
    ) -> None: ...
    @staticmethod
    def size(dtype: np.dtype) -> int: ...
    @property
    def sequence(self) -> int: ...
    def publish(self) -> None: ...
    def try_read(self) -> bool: ...
    def salvage(self) -> np.ndarray: ...
    def read(self) -> np.ndarray: ...
