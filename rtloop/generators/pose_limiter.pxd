"""Declarations for other compiled modules: the TCP limits. See pose_limiter.pyx."""

from rtloop.generators.otg cimport Profile
from rtloop.generators.target_range cimport PoseRange

cdef class PoseLimiter:
    cdef readonly object pose, twist, acceleration, speed
    cdef readonly bint limited
    cdef double* c_pose  # (7,): x, y, z, w, x, y, z.
    cdef double* c_twist
    cdef double* c_acceleration
    cdef double* c_speed  # Velocity at the end of the period; the twist is the mean over the period.
    cdef double period_s
    cdef double[3][2] bounds  # Velocity, acceleration and jerk; linear and angular.
    cdef double[7] last  # request
    cdef double[6] own  # velocity of the requests
    cdef int differing  # number of cycles in which this velocity may still differ from the twist

    cdef PoseRange targets
    cdef bint ranged
    cdef bint[2] square  # whether the axes are the base frame's, with equal shares; linear, angular
    cdef bint[2] aligned  # whether a pursuit keeps its axes; linear, angular
    cdef double[2][9] axes  # three axes for each part, one per row
    cdef double[2][3] shares  # share of each axis in the limits of acceleration and jerk
    cdef double[2][3] expected  # velocity of the request when the axes were chosen
    # deviation of the last request from the place to which that velocity would have led
    cdef double[2][3] strayed
    cdef double[2] scale  # remaining distance at that time

    cdef void c_stay_within(self, PoseRange targets) noexcept
    cdef void c_begin(self, const double* pose, const double* twist) noexcept nogil
    cdef void c_step(self, const double* pose) noexcept nogil
    cdef void _follow(self, const double* step, const double* own, const double* own_rate) noexcept nogil
    cdef void _align(
        self, int part, const double* step, const double* own, const double* moving, const double* moving_rate
    ) noexcept nogil
    cdef bint _pursue(self, const double* step, const double* own, const double* own_rate) noexcept nogil
    cdef bint _pursue_part(
        self, int part, const double* step, const double* own, const double* own_rate,
        double* move, double* speed, double* rate,
    ) noexcept nogil
    cdef void _share(self, int part, const double* gap, const double* moving_rate) noexcept nogil
    cdef void _share_velocity(self, int part, const double* own, double* velocities) noexcept nogil
    cdef bint _pursue_axis(
        self, const double* axis, double share, double max_velocity, int part,
        const double* step, const double* own, const double* own_rate, double* ahead,
    ) noexcept nogil
    cdef void _move(self, const double* move) noexcept nogil
    cdef bint _within(self, const double* row, int order, double factor, double more) noexcept nogil
    cdef bint _overruns(self, const double* pose, const double* velocity, const double* rate) noexcept nogil
    cdef double _stop_way(self, int part, double share, double speed, double rate) noexcept nogil
    cdef bint _brake(
        self, int part, double share, double speed, double rate, double time_s, double* there, Profile* stop
    ) noexcept nogil
    cdef void _stay_within(self, int part, double* move, double* speed, double* rate) noexcept nogil
    cdef double _load(
        self, int part, const double* ahead, const double* low, const double* high, double* needs
    ) noexcept nogil
    cdef void _find_brake(self, int part, const double* weights, double* ahead) noexcept nogil
    cdef void _from_axes(
        self, int part, const double* ahead, double* move, double* speed, double* rate
    ) noexcept nogil
