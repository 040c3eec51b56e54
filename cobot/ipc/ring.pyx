"""A ring of numbered records in shared memory: one writer, any number of readers, and no lock.

The record with number n is at index n modulo the capacity. Its first word is its number, and its last word is
the checksum of all words before it. A reader copies an entry and checks only the copy. Another number means
that the record does not exist yet or has been overwritten; a wrong checksum means that it is being written.
The writer neither waits nor allocates, and does not depend on its readers. A reader that is too slow finds
higher numbers.

The last written number is stored before the entries. It is only a hint: the record with this number is
checked.
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
        dtype: type of a record. Its first field is the number, its last field the checksum, both u8.
                capacity: number of records in the ring.
    """

    def __init__(self, memory, Py_ssize_t offset, dtype, long long capacity):
        """
        Raises:
            ValueError: the ring is beyond the mapping or not at a multiple of 8 bytes, or its records have
                another form.
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
        """Number of bytes of a ring in the file."""
        return HEAD_BYTES + capacity * dtype.itemsize

    @property
    def newest(self):
        """The number of the last written record, 0 for none."""
        return self.c_newest()

    def touch(self):
        """Load every page into memory, so that no write waits for a page. The content does not change."""
        cdef Py_ssize_t at
        cdef char* first = <char*>self._head
        for at in range(0, HEAD_BYTES + self.capacity * <Py_ssize_t>self._size, PAGE):
            atomic_add(<uint64_t*>(first + at), 0, RELAXED)

    def put(self, record):
        """Write a record as the latest one. It must have its number; the checksum is filled in."""
        self.c_put(bytes_of(record, self._size))

    def read(self, first, count):
        """Return copies of the `count` records from number `first` on, except those that do not exist.

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
        """Copy all records of another ring of the same kind, from number `first` on.

        Returns:
            The number with which to continue, and the number of records that had already been overwritten.
        """
        if other.dtype != self.dtype:
            raise ValueError("the rings have records of different kinds")
        one = np.empty(1, self.dtype)
        cdef char* record = bytes_of(one, self._size)
        cdef uint64_t number = max(1, first), newest = other.c_newest(), lost = 0
        if newest < number or not other.c_take(newest, record):  # nothing is new, or the hint is damaged
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
