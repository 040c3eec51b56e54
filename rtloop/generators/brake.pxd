"""Declarations for other compiled modules: braking a reference. See brake.pyx."""

from cobot.arrays cimport MAX_DOF
from rtloop.generators.otg cimport Profile

cdef class Brake:
    cdef int n
    cdef double period_s, time_s
    cdef double[MAX_DOF] max_acceleration, max_jerk
    cdef Profile[MAX_DOF] profiles
    cdef bint planned

    cdef void c_begin(self, const double* reference) noexcept nogil
    cdef bint c_advance(self, double* reference) noexcept nogil
