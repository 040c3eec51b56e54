"""A ring of numbered records in shared memory: one writer, any number of readers, and no lock.

The record of number n stands at place n modulo the capacity. Its first word is its number and its last one
the checksum of all before it, so a reader copies a place and looks at the copy alone: another number is a
record that is not there yet or not any more, a wrong checksum one that is being written. The writer neither
waits nor allocates, and knows nothing of its readers; a reader that comes too late finds newer numbers.

The number that was written last stands before the places. It is a hint: what it leads to is looked at.
"""

from cobot.arrays cimport bytes_of
from cobot.ipc.atomics cimport ACQUIRE, RELAXED, RELEASE, atomic_add, atomic_load, atomic_store
from cobot.ipc.seqlock cimport xxh64
from libc.stdint cimport uint64_t
from libc.string cimport memcpy

import numpy as np

cdef enum:
    HEAD_BYTES = 64  # the newest number, in a cache line of its own
    PAGE = 4096


cdef class Ring:
    """
    Attributes:
        dtype: of a record: its first field is the number, its last one the checksum, both u8.
        capacity: so many records it holds.
    """

    def __init__(self, memory, Py_ssize_t offset, dtype, long long capacity):
        """
        Raises:
            ValueError: beyond the mapping, not at a multiple of 8 bytes, or records of another kind.
        """
        if offset < 0 or offset % 8 or dtype.itemsize % 8 or capacity < 1:
            raise ValueError(f"a ring of {capacity} records of {dtype.itemsize} bytes cannot be at {offset}")
        first, *_, last = [(name, dtype[name]) for name in dtype.names]
        if (first, last) != (("number", np.dtype("u8")), ("checksum", np.dtype("u8"))):
            raise ValueError("a record of a ring has its number first and its checksum last, each a u8")
        self.dtype, self.capacity, self._size = dtype, capacity, dtype.itemsize
        # The view keeps the mapping alive.
        self._shared = memoryview(memory)[offset : offset + Ring.size(dtype, capacity)]
        cdef char* address = bytes_of(self._shared, Ring.size(dtype, capacity))
        self._head = <uint64_t*>address
        self._places = address + HEAD_BYTES

    @staticmethod
    def size(dtype, capacity):
        """Bytes that a ring takes in the file."""
        return HEAD_BYTES + capacity * dtype.itemsize

    @property
    def newest(self):
        """The number of the record that was written last, 0 for none."""
        return self.c_newest()

    def touch(self):
        """Have every page in memory, so that no write waits for one; what stands there stays."""
        cdef Py_ssize_t at
        cdef char* first = <char*>self._head
        for at in range(0, HEAD_BYTES + self.capacity * <Py_ssize_t>self._size, PAGE):
            atomic_add(<uint64_t*>(first + at), 0, RELAXED)

    def put(self, record):
        """Write a record, which has its number, as the newest one; its checksum is filled in."""
        self.c_put(bytes_of(record, self._size))

    def read(self, first, count):
        """Copies of the records from number `first` on, `count` numbers, without those that are not there.

        Returns:
            An array of `dtype`, in the order of the numbers.
        """
        cdef uint64_t begin = max(1, first)
        cdef long long wanted = min(max(0, first + count - <long long>begin), self.capacity)
        found = np.empty(wanted, self.dtype)
        if wanted == 0:
            return found
        cdef char* into = bytes_of(found, wanted * self._size)
        cdef long long index, taken = 0
        with nogil:
            for index in range(wanted):
                if self.c_take(begin + index, into + taken * self._size):
                    taken += 1
        return found[:taken]

    def copy_from(self, Ring other not None, first):
        """Write all that another ring of such records has, from number `first` on.

        Returns:
            The number to go on with, and how many before it were not there any more.
        """
        if other.dtype != self.dtype:
            raise ValueError("the rings have records of different kinds")
        one = np.empty(1, self.dtype)
        cdef char* record = bytes_of(one, self._size)
        cdef uint64_t number = max(1, first), newest = other.c_newest(), lost = 0
        if newest < number or not other.c_take(newest, record):  # nothing new, or a spoilt hint
            return number, 0
        if newest - number >= <uint64_t>other.capacity:
            lost = newest - other.capacity + 1 - number
            number += lost
        with nogil:
            while number <= newest:
                if other.c_take(number, record):
                    self.c_put(record)
                else:
                    lost += 1
                number += 1
        return number, lost

    cdef uint64_t c_newest(self) noexcept nogil:
        return atomic_load(self._head, ACQUIRE)

    cdef void c_put(self, char* record) noexcept nogil:
        cdef uint64_t* words = <uint64_t*>record
        words[self._size // 8 - 1] = xxh64(record, self._size - 8)
        memcpy(self._places + words[0] % <uint64_t>self.capacity * self._size, record, self._size)
        atomic_store(self._head, words[0], RELEASE)

    cdef bint c_take(self, uint64_t number, char* record) noexcept nogil:
        cdef const uint64_t* words = <uint64_t*>record
        memcpy(record, self._places + number % <uint64_t>self.capacity * self._size, self._size)
        return words[0] == number and words[self._size // 8 - 1] == xxh64(record, self._size - 8)
