"""Checks of streamed commands.

A pose is shape (7,): x, y, z in m and a quaternion (w, x, y, z) of any sign.
"""

from libc.math cimport INFINITY, fabs, sqrt

from cobot.arrays cimport doubles
from cobot.robot.quaternion cimport quat_between

import numpy as np

from rtloop.results import ACCEPTED, Rejected

# Maximum plausible speeds, rad/s, m/s and rad/s. A command that needs a higher speed is a jump.
JOINT_VELOCITY = 10.0
LINEAR_VELOCITY = 10.0
ANGULAR_VELOCITY = 50.0
# The interval that is assumed before there are two commands, and the bounds of a measured interval.
DEFAULT_INTERVAL_S = 0.01
MIN_INTERVAL_S = 0.001
MAX_INTERVAL_S = 0.1
# Maximum difference between the intended interval of two commands and the interval at which they arrived.
cdef double SLACK_S = 0.01

cdef double _JOINT_VELOCITY = JOINT_VELOCITY
cdef double _MIN_INTERVAL_S = MIN_INTERVAL_S
cdef double _MAX_INTERVAL_S = MAX_INTERVAL_S


cdef double c_clamped_interval(double interval_s) noexcept nogil:
    """The interval from which thresholds are calculated. It is limited, so that bursts and pauses give no
    extreme thresholds.
    """
    return min(max(interval_s, _MIN_INTERVAL_S), _MAX_INTERVAL_S)


cdef double joint_threshold(double interval_s, double max_velocity) noexcept nogil:
    return min(_JOINT_VELOCITY * interval_s, max_velocity * (interval_s + SLACK_S))


cdef int c_joint_jump(
    const double* target, const double* last, int dof, double interval_s, const double* max_velocity
) noexcept nogil:
    """Return the first joint that would have to jump from the last target to this one; -1 if there is none.

    `max_velocity` is the maximum velocity of the robot itself, shape (dof,), rad/s, or NULL. `SLACK_S` is
    added to the interval, because jitter of the client is not a jump.
    """
    cdef double within_s = c_clamped_interval(interval_s)
    cdef double most
    cdef int joint
    for joint in range(dof):
        most = joint_threshold(within_s, max_velocity[joint] if max_velocity != NULL else INFINITY)
        if not fabs(target[joint] - last[joint]) <= most:  # also true for NaN
            return joint
    return -1


cdef double distance_between(const double* first, const double* second) noexcept nogil:
    cdef double x = first[0] - second[0], y = first[1] - second[1], z = first[2] - second[2]
    return sqrt(x * x + y * y + z * z)


cdef double angle_between(const double* first, const double* second) noexcept nogil:
    cdef double turn[3]
    quat_between(first, second, turn)
    return sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])


cdef int c_pose_jump(
    const double* pose, const double* last, double interval_s, double max_linear, double max_angular
) noexcept nogil:
    """Whether the TCP would have to jump or rotate abruptly from the last pose to this one."""
    cdef double within_s = c_clamped_interval(interval_s)
    if not distance_between(pose, last) <= max_linear * within_s:
        return POSE_JUMPS
    if not angle_between(pose + 3, last + 3) <= max_angular * within_s:
        return POSE_TURNS
    return POSE_PASSES


def angular_distance(first, second):
    """Return the angle in [0, π] between two orientations (w, x, y, z), rad."""
    first, second = np.array(first, float), np.array(second, float)
    return angle_between(doubles(first, 4), doubles(second, 4))


def is_finite(values):
    """Whether all values are finite. True if there are none."""
    return bool(np.isfinite(values).all())


def clamped_interval(double interval_s):
    """Return the interval from which thresholds are calculated. It is clamped, so that bursts and pauses do
    not lead to extreme thresholds.
    """
    return c_clamped_interval(interval_s)


def check_joint_step(target, last, interval_s=DEFAULT_INTERVAL_S, max_velocity=None, names=()):
    """Check that no joint would have to jump from the last target to this one.

    Args:
        target, last: shape (dof,), rad.
        interval_s: time between the two commands, s.
        max_velocity: maximum velocity of the robot itself, shape (dof,), rad/s. `SLACK_S` is added to the
            interval, because jitter of the client is not a jump.
        names: joint names, for the error.
    """
    if target.shape != last.shape:
        return Rejected(f"{target.size} joints instead of {last.size}")
    if not last.size:
        return ACCEPTED
    target, last = np.array(target, float), np.array(last, float)
    rates = None if max_velocity is None else np.array(max_velocity, float)
    cdef const double* fastest = NULL if rates is None else doubles(rates, last.size)
    cdef int joint = c_joint_jump(
        doubles(target, last.size), doubles(last, last.size), last.size, interval_s, fastest
    )
    if joint < 0:
        return ACCEPTED
    name = names[joint] if names else f"joint{joint + 1}"
    most = joint_threshold(c_clamped_interval(interval_s), INFINITY if rates is None else fastest[joint])
    step = abs(target[joint] - last[joint])
    return Rejected(f"{name} would jump by {step:.4f} rad, allowed: {most:.4f} rad")


def check_pose_step(
    pose, last, interval_s=DEFAULT_INTERVAL_S, max_linear=LINEAR_VELOCITY, max_angular=ANGULAR_VELOCITY
):
    """Check that the TCP would not have to jump from the last pose to this one, with `interval_s` between the
    two.
    """
    if pose.shape != (7,) or last.shape != (7,):
        return Rejected(f"{pose.size} numbers instead of 7")
    pose, last = np.array(pose, float), np.array(last, float)
    cdef const double* here = doubles(last, 7)
    cdef const double* there = doubles(pose, 7)
    cdef int jump = c_pose_jump(there, here, interval_s, max_linear, max_angular)
    within_s = c_clamped_interval(interval_s)
    if jump == POSE_JUMPS:
        distance = distance_between(there, here)
        most = max_linear * within_s
        return Rejected(f"the TCP would jump by {distance:.4f} m, allowed: {most:.4f} m")
    if jump == POSE_TURNS:
        angle, most = angle_between(there + 3, here + 3), max_angular * within_s
        return Rejected(f"the TCP would turn by {angle:.4f} rad at once, allowed: {most:.4f} rad")
    return ACCEPTED
