cdef enum:
    ORDER = 6  # Coefficients of a quintic.
    # Maximum number of breakpoints that are checked for a stop. If there are more, they are so close together
    # that the path is smooth between them.
    MAX_BREAKPOINTS = 24


cdef class Path:
    cdef readonly double duration_s
    cdef readonly Py_ssize_t segments
    cdef readonly object breakpoints_s, coefficients
    cdef double* c_breakpoints_s  # (capacity + 1,)
    cdef double* c_coefficients  # (capacity, dof, ORDER)
    cdef Py_ssize_t capacity, index  # index of the segment that was evaluated last
    cdef int dof

    cdef void c_evaluate(self, double path_time_s, double rate, double slope, double* out) noexcept nogil
    cdef void c_sample(self, double path_time_s, double* out) noexcept nogil
    cdef bint c_continues(self, Path old, double offset_s, double from_s, double until_s) noexcept nogil
    cdef int c_breakpoints(self, double from_s, double to_s, double* out) noexcept nogil
    cdef Py_ssize_t _breakpoints_before(self, double path_time_s, bint including) noexcept nogil
    cdef int _require(self, Py_ssize_t begin, Py_ssize_t end) except -1
