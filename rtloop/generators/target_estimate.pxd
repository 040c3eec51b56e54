"""Declarations for other compiled modules: the estimated motion of a stream at its newest target. See
target_estimate.pyx.
"""

from cobot.arrays cimport MAX_DOF

cdef enum:
    MAX_TARGETS = 64

cdef class Estimate:
    cdef int n
    cdef int known  # Number of known targets of this stream, at most the number that the fit uses.
    cdef double window_s
    cdef double[MAX_TARGETS][MAX_DOF] targets  # The newest last.
    cdef double* newest
    cdef double[MAX_DOF] max_velocity, max_acceleration, c_velocity, c_acceleration

    cdef void c_forget(self) noexcept nogil
    cdef void c_rebase(self, const double* target) noexcept nogil
    cdef void c_update(self, const double* target, const double* velocity, double duration_s) noexcept nogil
    cdef void c_extrapolate(self, double ahead_s, double* out) noexcept nogil
    cdef bint c_moves(self) noexcept nogil
