"""A record in shared memory with one writer, any number of readers, and no lock.

The writer makes the sequence counter odd, copies the record, writes a checksum, and makes the counter even. A
reader accepts its copy only if the counter was even, did not change meanwhile, and the checksum fits. So a
torn read is found on any memory model, and the incomplete record of a writer that has died is never accepted.

Bytes in shared memory may be anything, so they are copied once, and only the copy is used.

The checksum is XXH64 with seed 0 (Y. Collet, "xxHash fast digest algorithm", specification 0.1.1), on words
in the order of the machine. It needs no table, which would often be outside the caches after a cycle has
slept, and processes 32 bytes in the time of two multiplications.
"""

import time

from cobot.arrays cimport bytes_of
from cobot.ipc.atomics cimport ACQUIRE, RELAXED, RELEASE, atomic_add, atomic_load, atomic_store, fence
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t
from libc.string cimport memcpy

import numpy as np

from cobot.errors import TornReadError

READ_TRIES = 100
"""Maximum number of consecutive failed reads. A write takes some microseconds, so more failures mean that the
writer has died during a write."""

cdef enum:
    HEAD_BYTES = 16  # counter and checksum

cdef extern from * nogil:
    """
    #define COBOT_P1 0x9E3779B185EBCA87ULL
    #define COBOT_P2 0xC2B2AE3D27D4EB4FULL
    #define COBOT_P3 0x165667B19E3779F9ULL
    #define COBOT_P4 0x85EBCA77C2B2AE63ULL
    #define COBOT_P5 0x27D4EB2F165667C5ULL
    """
    # The primes of XXH64, as constants of C, so that they are in the code and not in memory.
    const uint64_t P1 "COBOT_P1"
    const uint64_t P2 "COBOT_P2"
    const uint64_t P3 "COBOT_P3"
    const uint64_t P4 "COBOT_P4"
    const uint64_t P5 "COBOT_P5"


cdef class Block:
    def __init__(self, memory, Py_ssize_t offset, dtype, str name, str writer="its writer"):
        """
        Raises:
            ValueError: the record is beyond the mapping, or not at a multiple of 8 bytes.
        """
        if offset < 0 or offset % 8:
            raise ValueError(f"a block begins at a multiple of 8 bytes, not at {offset}")
        self.name = name
        self.writer = writer
        self.data = np.zeros((), dtype)
        self.buffer = np.ndarray(self.data.dtype.itemsize, np.uint8, self.data)
        # The view keeps the mapping alive.
        view = memoryview(memory)[offset : offset + Block.size(dtype)]
        self._head = view[:HEAD_BYTES].cast("Q")
        self._shared = view[HEAD_BYTES:]
        cdef char* address = bytes_of(view, Block.size(dtype))
        self.c_data = bytes_of(self.buffer, len(self.buffer))
        self.mapped.counter = <uint64_t*>address
        self.mapped.checksum = self.mapped.counter + 1
        self.mapped.shared = address + HEAD_BYTES
        self.mapped.copy = self.c_data
        self.mapped.size = len(self.buffer)

    @staticmethod
    def size(dtype):
        """Number of bytes of a block in the file."""
        return HEAD_BYTES + dtype.itemsize

    @property
    def sequence(self):
        """Twice the number of publications; odd during a publication."""
        return self.c_sequence()

    def publish(self):
        """Make `data` visible to readers. Real-time safe. Only the block's one writer may call it."""
        self.c_publish()

    def try_read(self):
        """Copy the record into `data` if it is consistent. Makes one try; real-time safe.

        If the result is False, the content of `data` is undefined.
        """
        return self.c_try_read()

    def salvage(self):
        """The record (`data`), consistent or not, for a writer that replaces a dead one."""
        memcpy(self.c_data, self.mapped.shared, self.mapped.size)
        return self.data

    def read(self):
        """The latest consistent record (`data`, which the next read overwrites).

        Raises:
            TornReadError: none of `READ_TRIES` tries was consistent.
        """
        for attempt in range(READ_TRIES):
            if self.c_try_read():
                return self.data
            time.sleep(0.0 if attempt < 10 else 0.0001)
        raise TornReadError(
            f"shared memory: no consistent {self.name} in {READ_TRIES} reads; {self.writer} may have died"
        )

    cdef unsigned long long c_sequence(self) noexcept nogil:
        return sequence_of(&self.mapped)

    cdef bint c_try_read(self) noexcept nogil:
        return try_read(&self.mapped)

    cdef void c_publish(self) noexcept nogil:
        publish(&self.mapped)

    cdef char* c_field(self, str name) except NULL:
        return self.c_data + <Py_ssize_t>self.data.dtype.fields[name][1]

    cdef uint64_t* c_unsigned(self, str name) except NULL:
        return <uint64_t*>_of_kind(self, name, "u8")

    cdef int64_t* c_signed(self, str name) except NULL:
        return <int64_t*>_of_kind(self, name, "i8")

    cdef double* c_doubles(self, str name) except NULL:
        return <double*>_of_kind(self, name, "f8")


cdef class SharedCounter:
    """A number that any process may increment at any time. It has no single writer that could die during a
    write."""

    def __init__(self, memory, Py_ssize_t offset):
        """
        Raises:
            ValueError: the counter is beyond the mapping, or not at a multiple of 8 bytes.
        """
        if offset < 0 or offset % 8:
            raise ValueError(f"a counter begins at a multiple of 8 bytes, not at {offset}")
        # The view keeps the mapping alive.
        self._shared = memoryview(memory)[offset : offset + 8]
        self.place = <uint64_t*>bytes_of(self._shared, 8)

    @property
    def value(self):
        return self.c_value()

    def add(self):
        """Increment the number. Real-time safe."""
        atomic_add(self.place, 1, RELEASE)

    cdef uint64_t c_value(self) noexcept nogil:
        return atomic_load(self.place, ACQUIRE)


cdef char* _of_kind(Block block, str name, str kind) except NULL:
    """The address of a field that consists of words of 8 bytes, correctly aligned."""
    cdef char* address = block.c_field(name)
    found = block.data.dtype.fields[name][0].base
    if found != np.dtype(kind) or <size_t>address % 8:
        raise TypeError(f"{block.name}: {name} is {found}, not an aligned {kind}")
    return address


cdef uint64_t sequence_of(const Mapped* record) noexcept nogil:
    return atomic_load(record.counter, ACQUIRE)


cdef bint try_read(const Mapped* record) noexcept nogil:
    cdef uint64_t before = atomic_load(record.counter, ACQUIRE)
    cdef uint64_t found
    if before & 1:
        return False
    # A plain copy between two fences is the most that C can express for a record that may be torn.
    memcpy(record.copy, record.shared, record.size)
    found = atomic_load(record.checksum, RELAXED)
    fence(ACQUIRE)  # the copy is complete before the counter is looked at again
    if atomic_load(record.counter, RELAXED) != before:
        return False
    return before == 0 or found == xxh64(record.copy, record.size)


cdef void publish(const Mapped* record) noexcept nogil:
    cdef uint64_t found = xxh64(record.copy, record.size)
    cdef uint64_t begun = atomic_load(record.counter, RELAXED) | 1
    atomic_store(record.counter, begun, RELAXED)
    fence(RELEASE)  # the counter is odd before anything is written
    memcpy(record.shared, record.copy, record.size)
    atomic_store(record.checksum, found, RELAXED)
    atomic_store(record.counter, begun + 1, RELEASE)


def checksum(record):
    """The checksum of a writable buffer."""
    cdef Py_ssize_t size = memoryview(record).nbytes
    return xxh64(bytes_of(record, size), size) if size else xxh64(NULL, 0)


cdef uint64_t xxh64(const char* at, size_t size) noexcept nogil:
    cdef const char* end = at + size
    cdef uint64_t digest = P5
    if size >= 32:
        digest = _lanes(at, size // 32)
        at += size // 32 * 32
    digest += size
    while end - at >= 8:
        digest = _turned(digest ^ _round(0, _word(at)), 27) * P1 + P4
        at += 8
    if end - at >= 4:
        digest = _turned(digest ^ _half_word(at) * P1, 23) * P2 + P3
        at += 4
    while at < end:
        digest = _turned(digest ^ <uint8_t>at[0] * P5, 11) * P1
        at += 1
    digest = (digest ^ (digest >> 33)) * P2
    digest = (digest ^ (digest >> 29)) * P3
    return digest ^ (digest >> 32)


cdef inline uint64_t _lanes(const char* at, size_t stripes) noexcept nogil:
    """The combination of four lanes; each processes every fourth word."""
    cdef uint64_t a = P1 + P2, b = P2, c = 0, d = 0 - P1, digest
    for _ in range(stripes):
        a = _round(a, _word(at))
        b = _round(b, _word(at + 8))
        c = _round(c, _word(at + 16))
        d = _round(d, _word(at + 24))
        at += 32
    digest = _turned(a, 1) + _turned(b, 7) + _turned(c, 12) + _turned(d, 18)
    digest = (digest ^ _round(0, a)) * P1 + P4
    digest = (digest ^ _round(0, b)) * P1 + P4
    digest = (digest ^ _round(0, c)) * P1 + P4
    return (digest ^ _round(0, d)) * P1 + P4


cdef inline uint64_t _round(uint64_t lane, uint64_t word) noexcept nogil:
    return _turned(lane + word * P2, 31) * P1


cdef inline uint64_t _turned(uint64_t word, int bits) noexcept nogil:
    return (word << bits) | (word >> (64 - bits))


cdef inline uint64_t _word(const char* at) noexcept nogil:
    cdef uint64_t word
    memcpy(&word, at, 8)
    return word


cdef inline uint64_t _half_word(const char* at) noexcept nogil:
    cdef uint32_t word
    memcpy(&word, at, 4)
    return word
