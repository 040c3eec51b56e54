cdef class ClientWatch:
    cdef int descriptor

    cdef bint c_gone(self) noexcept nogil
