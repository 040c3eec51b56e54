"""Declarations for other compiled modules: pursuit in a moving frame. See moving_frame.pyx."""

from rtloop.generators.otg cimport Problem, Profile

cdef struct Motion:  # State of one axis, in m or rad, and s.
    double position, velocity, acceleration

cdef struct Ladder:  # Shares of the jerk limit, the smallest first.
    int count
    double share[4]
    double patience_s  # Maximum duration of the motion with each share except the last.


cdef inline Motion moved(Motion motion, double time_s) noexcept nogil:
    """Return the motion after a time, which may be negative, at constant acceleration."""
    cdef Motion there = motion
    there.position += time_s * (motion.velocity + 0.5 * time_s * motion.acceleration)
    there.velocity += time_s * motion.acceleration
    return there


cdef inline Motion difference(Motion motion, Motion other) noexcept nogil:
    cdef Motion between = motion
    between.position -= other.position
    between.velocity -= other.velocity
    between.acceleration -= other.acceleration
    return between


cdef void to_rest_in_frame(
    Problem* problem, Motion state, Motion frame, double due_s, double max_velocity, double max_acceleration
) noexcept nogil
cdef bint plan_gently(
    Problem* problems, Profile* profiles, const double* max_jerk, int n, const Ladder* ladder, bint overshoots
) noexcept nogil
cdef bint overshoots_zero(double off, const Profile* profile) noexcept nogil
