from cobot.arrays cimport MAX_DOF


cdef class ServoLaw:
    cdef readonly object reference
    cdef readonly bint active
    cdef int n
    cdef double* ref
    cdef double period_s, lookahead_s, gain
    cdef double step[4]

    cdef void c_begin(self, const double* state) noexcept nogil
    cdef void c_tune(self, double lookahead_s, double gain) noexcept nogil
    cdef void c_follow(self, const double* target) noexcept nogil
