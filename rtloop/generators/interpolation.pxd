"""Declarations for other compiled modules: a reference for every cycle. See interpolation.pyx."""

from cobot.arrays cimport MAX_DOF


cdef class Interpolator:
    cdef readonly object reference  # (3, n): position, velocity, acceleration.
    cdef double* ref  # The numbers of `reference`.
    cdef int n
    cdef double period_s

    cdef void c_begin(self, const double* state) noexcept nogil
    cdef void c_rebase(self, const double* state, const double* target) noexcept nogil
    cdef void c_aim(self, const double* target, const double* velocity, double duration_s) noexcept nogil
    cdef void c_advance(self) noexcept nogil

cdef class Hold(Interpolator):
    cdef double left_s

cdef class Linear(Interpolator):
    cdef double[MAX_DOF] start, way, target, velocity
    cdef long long cycle
    cdef double cycles

cdef double EARLY
cdef double grace_s(double duration_s) noexcept nogil

cdef inline double clipped(double value, double bound) noexcept nogil:
    """Return the value, clipped to [-bound, bound]. NaN stays NaN."""
    if value > bound:
        return bound
    return -bound if value < -bound else value

cdef void copy_row(double* into, object values, Py_ssize_t size) except *
cdef object plain(object values, tuple shape)
