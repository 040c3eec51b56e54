"""From where something is to rest in a frame that moves, each axis for itself.

What is pursued moves on while it is pursued. In a frame that moves with it the problem is one from a state to
rest, which is solved at once, and which lasts from cycle to cycle; a profile to a fixed place with a
velocity there would run back to take a run-up whenever it is late.
"""

from libc.math cimport INFINITY, fmax, fmin

from rtloop.generators.otg cimport OTG_OK, Problem, Profile, otg_position, profile_extrema

cdef double ROUNDING = 1e-9  # rad or m: this is no overshoot.


cdef void to_rest_in_frame(
    Problem* problem, Motion state, Motion frame, double due_s, double max_velocity, double max_acceleration
) noexcept nogil:
    """The problem in the frame, but for the jerk.

    Args:
        state: where the follower is now.
        frame: where what is pursued will be in `due_s`. It must be slower than the limits.
        max_velocity, max_acceleration: at rest. In the frame the limits are not the same in both directions.
    """
    cdef Motion off = difference(state, moved(frame, -due_s))
    problem.position, problem.velocity, problem.acceleration = off.position, off.velocity, off.acceleration
    problem.target_position = problem.target_velocity = 0.0
    problem.max_velocity, problem.min_velocity = max_velocity - frame.velocity, -max_velocity - frame.velocity
    problem.max_acceleration = max_acceleration - frame.acceleration
    problem.min_acceleration = -max_acceleration - frame.acceleration


cdef bint plan_gently(
    Problem* problems, Profile* profiles, const double* max_jerk, int n, const Ladder* ladder, bint overshoots
) noexcept nogil:
    """Profiles of all axes with the gentlest share of the jerk limits that is done in time.

    Args:
        overshoots: whether a way may go beyond its target, or farther off than its start.

    Returns:
        Whether there is a way. If none is short enough, it is that of the highest rung that has one.
    """
    cdef int rung
    for rung in range(ladder.count):
        if _climb(problems, profiles, max_jerk, n, ladder.share[rung], ladder.patience_s, overshoots):
            return True
    for rung in range(ladder.count - 1, -1, -1):
        if _climb(problems, profiles, max_jerk, n, ladder.share[rung], INFINITY, True):
            return True
    return False


cdef bint _climb(
    Problem* problems, Profile* profiles, const double* max_jerk, int n,
    double share, double patience_s, bint overshoots,
) noexcept nogil:
    """Whether all axes have a way with this share of the jerk limits that is short enough."""
    cdef int axis
    for axis in range(n):
        problems[axis].max_jerk = share * max_jerk[axis]
        if otg_position(&problems[axis], &profiles[axis]) != OTG_OK or profiles[axis].duration > patience_s:
            return False
        if not overshoots and overshoots_zero(problems[axis].position, &profiles[axis]):
            return False
    return True


cdef bint overshoots_zero(double off, const Profile* profile) noexcept nogil:
    """Whether a way from `off` to zero goes beyond zero, or farther off than its start."""
    cdef double extrema[2]
    profile_extrema(profile, extrema)
    return extrema[0] < fmin(off, 0.0) - ROUNDING or extrema[1] > fmax(off, 0.0) + ROUNDING
