from libc.stdint cimport uint64_t


cdef class Ring:
    cdef readonly object dtype
    cdef readonly long long capacity
    cdef object _shared
    cdef uint64_t* _head
    cdef char* _places
    cdef size_t _size

    # Seal a record of this ring's kind, which has its number, and make it the newest one. Real-time safe.
    cdef void c_put(self, char* record) noexcept nogil
    # Copy a record if it is there, whole.
    cdef bint c_take(self, uint64_t number, char* record) noexcept nogil
    cdef uint64_t c_newest(self) noexcept nogil
