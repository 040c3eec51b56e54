"""Atomic operations of gcc and clang for memory that several processes share."""

from libc.stdint cimport uint64_t


cdef extern from * nogil:
    int RELAXED "__ATOMIC_RELAXED"
    int ACQUIRE "__ATOMIC_ACQUIRE"
    int RELEASE "__ATOMIC_RELEASE"
    uint64_t atomic_load "__atomic_load_n" (const uint64_t* place, int order)
    void atomic_store "__atomic_store_n" (uint64_t* place, uint64_t value, int order)
    uint64_t atomic_add "__atomic_add_fetch" (uint64_t* place, uint64_t value, int order)
    void fence "__atomic_thread_fence" (int order)
