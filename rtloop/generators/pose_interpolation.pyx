"""Interpolation between streamed poses, and the slow move to a single pose.

A pose is shape (7,): x, y, z in m and a quaternion (w, x, y, z); a twist is shape (6,): linear and angular
velocity, m/s and rad/s; both in the base frame.
"""

from libc.string cimport memcpy, memset

import numpy as np

from cobot.arrays cimport doubles
from cobot.robot.quaternion cimport (
    quat_angular_acceleration,
    quat_angular_velocity,
    quat_between,
    quat_exp,
    quat_normalised,
    quat_product,
    quat_rotation_rate,
)
from rtloop.generators.interpolation cimport plain

from rtloop.generators.factory import make_interpolator

cdef double MIN_DURATION_S = 1e-3  # Minimum duration of a move, even if a shorter one or none is requested.


cdef class PoseInterpolator:
    """An `Interpolator` of poses. Real-time safe. See pose_interpolation.pyi.

    It works in a chart: the position, and the rotation vector from the orientation at which the newest
    command arrived. A straight line through the chart's origin is a rotation about a fixed axis at constant
    speed, so `Linear` is a straight line with spherical interpolation. The limits apply to each axis of the
    chart.
    """

    def __init__(
        self,
        kind,
        double period_s,
        double max_linear_velocity,
        double max_linear_acceleration,
        double max_linear_jerk,
        double max_angular_velocity,
        double max_angular_acceleration,
        double max_angular_jerk,
    ):
        self.pose = np.array([0.0, 0, 0, 1, 0, 0, 0])
        self.c_pose = doubles(self.pose, 7)
        self.chart = make_interpolator(
            kind,
            6,
            period_s,
            np.repeat([max_linear_velocity, max_angular_velocity], 3),
            np.repeat([max_linear_acceleration, max_angular_acceleration], 3),
            np.repeat([max_linear_jerk, max_angular_jerk], 3),
        )
        self.last_orientation[0] = self.origin[0] = 1.0

    cdef void c_begin(
        self, const double* pose, const double* twist, const double* acceleration
    ) noexcept nogil:
        """Start from this state without commands, and hold. A moving reference is brought to rest. NULL for
        `twist` or `acceleration` means rest.
        """
        cdef double state[18]
        memcpy(self.c_pose, pose, 7 * sizeof(double))
        memcpy(self.last, pose, 3 * sizeof(double))
        quat_normalised(pose + 3, self.origin)
        memcpy(self.last_orientation, self.origin, sizeof(self.origin))
        self._state_at_origin(twist, acceleration, state)
        self.chart.c_begin(state)

    cdef void c_aim(self, const double* pose, const double* twist, double duration_s) noexcept nogil:
        """Accept a new command, to be reached in `duration_s`. Its twist may be NULL."""
        cdef double state[18]
        cdef double twist_now[6]
        cdef double acceleration_now[6]
        self.c_twist(twist_now)
        self.c_acceleration(acceleration_now)
        self._state_at_origin(twist_now, acceleration_now, state)
        quat_normalised(self.c_pose + 3, self.origin)
        quat_between(self.origin, self.last_orientation, self.last + 3)
        self.chart.c_rebase(state, self.last)
        memcpy(self.target, pose, 3 * sizeof(double))
        quat_between(self.origin, pose + 3, self.target + 3)
        if twist != NULL:
            memcpy(self.velocity, twist, 3 * sizeof(double))
            quat_rotation_rate(self.target + 3, twist + 3, self.velocity + 3)
        self.chart.c_aim(self.target, self.velocity if twist != NULL else NULL, duration_s)
        memcpy(self.last, pose, 3 * sizeof(double))
        memcpy(self.last_orientation, pose + 3, 4 * sizeof(double))
        self._write()

    cdef void c_advance(self) noexcept nogil:
        """Advance by one period."""
        self.chart.c_advance()
        self._write()

    cdef void c_twist(self, double* out) noexcept nogil:
        """Calculate the twist in this cycle, (6,): m/s and rad/s."""
        cdef const double* ref = self.chart.ref
        memcpy(out, ref + 6, 3 * sizeof(double))
        quat_angular_velocity(ref + 3, ref + 9, out + 3)

    cdef void c_acceleration(self, double* out) noexcept nogil:
        """Calculate the acceleration in this cycle, (6,): m/s² and rad/s². The angular part omits terms of
        second order in the rotation since the newest command.
        """
        cdef const double* ref = self.chart.ref
        memcpy(out, ref + 12, 3 * sizeof(double))
        quat_angular_acceleration(ref + 3, ref + 9, ref + 15, out + 3)

    cdef void _state_at_origin(
        self, const double* twist, const double* acceleration, double* out
    ) noexcept nogil:
        """Calculate the state of the reference in a chart whose origin is the reference, where the Jacobian
        is the identity.
        """
        memcpy(out, self.c_pose, 3 * sizeof(double))
        memset(out + 3, 0, 3 * sizeof(double))
        memset(out + 6, 0, 12 * sizeof(double))
        if twist != NULL:
            memcpy(out + 6, twist, 6 * sizeof(double))
        if acceleration != NULL:
            memcpy(out + 12, acceleration, 6 * sizeof(double))

    cdef void _write(self) noexcept nogil:
        cdef double turn[4]
        memcpy(self.c_pose, self.chart.ref, 3 * sizeof(double))
        quat_exp(self.chart.ref + 3, turn)
        quat_product(turn, self.origin, self.c_pose + 3)

    @property
    def twist(self):
        out = np.empty(6)
        self.c_twist(doubles(out, 6))
        return out

    @property
    def acceleration(self):
        out = np.empty(6)
        self.c_acceleration(doubles(out, 6))
        return out

    def begin(self, pose, twist=0.0, acceleration=0.0):
        here, motion, change = plain(pose, (7,)), plain(twist, (6,)), plain(acceleration, (6,))
        self.c_begin(doubles(here, 7), doubles(motion, 6), doubles(change, 6))

    def aim(self, pose, twist, double duration_s):
        there = plain(pose, (7,))
        if twist is None:
            self.c_aim(doubles(there, 7), NULL, duration_s)
            return
        motion = plain(twist, (6,))
        self.c_aim(doubles(there, 7), doubles(motion, 6), duration_s)

    def advance(self):
        self.c_advance()


cdef class MinJerkMove:
    """A motion from rest to rest along a straight line, with the shortest rotation about a fixed axis.
    Real-time safe.

    With s = 10 t³ - 15 t⁴ + 6 t⁵, where t is the share of the duration, velocity and acceleration are zero at
    both ends (T. Flash, N. Hogan, "The coordination of arm movements", 1985). See pose_interpolation.pyi.
    """

    def __init__(self, start, goal, double duration_s, double period_s):
        self.pose, self.twist, self.acceleration = np.zeros(7), np.zeros(6), np.zeros(6)
        self.c_pose, self.c_twist = doubles(self.pose, 7), doubles(self.twist, 6)
        self.c_acceleration = doubles(self.acceleration, 6)
        self.period_s = period_s
        here, there = plain(start, (7,)), plain(goal, (7,))
        self.c_begin(doubles(here, 7), doubles(there, 7), duration_s)

    cdef void c_begin(self, const double* start, const double* goal, double duration_s) noexcept nogil:
        """Begin a move that takes at least `MIN_DURATION_S`. Quaternions need not be normalized, but must not
        be zero.
        """
        cdef double product = 0.0
        cdef int i
        memcpy(self.c_pose, start, 7 * sizeof(double))
        memset(self.c_twist, 0, 6 * sizeof(double))
        memset(self.c_acceleration, 0, 6 * sizeof(double))
        memcpy(self.start, start, 3 * sizeof(double))
        memcpy(self.goal, goal, 3 * sizeof(double))
        quat_normalised(start + 3, self.origin)
        quat_normalised(goal + 3, self.goal + 3)
        for i in range(4):
            product += self.origin[i] * self.goal[3 + i]
        for i in range(3, 7):
            self.goal[i] = -self.goal[i] if product < 0.0 else self.goal[i]
        for i in range(3):
            self.way[i] = self.goal[i] - self.start[i]
        quat_between(self.origin, self.goal + 3, self.way + 3)
        self.duration_s = duration_s if duration_s > MIN_DURATION_S else MIN_DURATION_S
        self.cycle, self.done = 0, False

    cdef void c_advance(self) noexcept nogil:
        """Advance by one period."""
        cdef double t, share, rate, second
        cdef double turn[3]
        cdef double turned[4]
        cdef int i
        self.cycle += 1
        t = self.cycle * self.period_s / self.duration_s
        if t >= 1.0:
            memcpy(self.c_pose, self.goal, 7 * sizeof(double))
            memset(self.c_twist, 0, 6 * sizeof(double))
            memset(self.c_acceleration, 0, 6 * sizeof(double))
            self.done = True
            return
        share = t * t * t * (10.0 + t * (6.0 * t - 15.0))
        rate = 30.0 * t * t * (1.0 - t) * (1.0 - t) / self.duration_s
        second = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / (self.duration_s * self.duration_s)
        for i in range(3):
            turn[i] = share * self.way[3 + i]
            self.c_pose[i] = self.start[i] + share * self.way[i]
        quat_exp(turn, turned)
        quat_product(turned, self.origin, self.c_pose + 3)
        for i in range(6):
            self.c_twist[i], self.c_acceleration[i] = rate * self.way[i], second * self.way[i]

    def advance(self):
        self.c_advance()
