"""Declarations for other compiled modules: interpolation of poses. See pose_interpolation.pyx."""

from rtloop.generators.interpolation cimport Interpolator

cdef class PoseInterpolator:
    cdef readonly object pose  # (7,): x, y, z, w, x, y, z.
    cdef double* c_pose
    cdef Interpolator chart
    cdef double[6] last, target, velocity  # in the chart
    cdef double[4] last_orientation, origin

    cdef void c_begin(
        self, const double* pose, const double* twist, const double* acceleration
    ) noexcept nogil
    cdef void c_aim(self, const double* pose, const double* twist, double duration_s) noexcept nogil
    cdef void c_advance(self) noexcept nogil
    cdef void c_twist(self, double* out) noexcept nogil
    cdef void c_acceleration(self, double* out) noexcept nogil
    cdef void _state_at_origin(
        self, const double* twist, const double* acceleration, double* out
    ) noexcept nogil
    cdef void _write(self) noexcept nogil

cdef class MinJerkMove:
    cdef readonly object pose, twist, acceleration
    cdef readonly bint done
    cdef double* c_pose
    cdef double* c_twist
    cdef double* c_acceleration
    cdef double[3] start
    cdef double[4] origin
    cdef double[7] goal
    cdef double[6] way
    cdef double duration_s, period_s
    cdef long long cycle

    cdef void c_begin(self, const double* start, const double* goal, double duration_s) noexcept nogil
    cdef void c_advance(self) noexcept nogil
