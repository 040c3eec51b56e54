from cobot.arrays cimport MAX_DOF


cdef class ContactMonitor:
    cdef int dof
    cdef tuple names
    cdef double largest[MAX_DOF + 6]
    cdef int worst
    cdef double found

    cdef bint c_check(self, const double* external) noexcept nogil
