"""Motions from a state to rest in a moving frame, for each axis separately.

A pursued target continues to move. In a frame that moves with it, the problem is a motion from a state to
rest. This has a direct solution, which stays the same from cycle to cycle. A profile to a fixed position with
a final velocity would instead move back for a run-up whenever it is late.
"""

from libc.math cimport INFINITY, fmax, fmin

from rtloop.generators.otg cimport OTG_OK, Problem, Profile, otg_position, profile_extrema

cdef double ROUNDING = 1e-9  # rad or m; a smaller overshoot is ignored.


cdef void to_rest_in_frame(
    Problem* problem, Motion state, Motion frame, double due_s, double max_velocity, double max_acceleration
) noexcept nogil:
    """Express the problem in the frame, without the jerk limit.

    Args:
        state: current state of the follower.
        frame: state of the target at `due_s`. Its rates must be below the limits.
        max_velocity, max_acceleration: limits in the base frame. In the moving frame, they differ between the
            two directions.
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
    """Plan profiles of all axes with the smallest share of the jerk limits that makes them arrive in time.

    Args:
        overshoots: whether a profile may go beyond its target, or back beyond its start.

    Returns:
        Whether profiles were found. If none are short enough, they are the ones with the largest share.
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
    """Whether, with this share of the jerk limits, all axes have a profile that is short enough."""
    cdef int axis
    for axis in range(n):
        problems[axis].max_jerk = share * max_jerk[axis]
        if otg_position(&problems[axis], &profiles[axis]) != OTG_OK or profiles[axis].duration > patience_s:
            return False
        if not overshoots and overshoots_zero(problems[axis].position, &profiles[axis]):
            return False
    return True


cdef bint overshoots_zero(double off, const Profile* profile) noexcept nogil:
    """Whether a profile from `off` to zero goes beyond zero, or back beyond its start."""
    cdef double extrema[2]
    profile_extrema(profile, extrema)
    return extrema[0] < fmin(off, 0.0) - ROUNDING or extrema[1] > fmax(off, 0.0) + ROUNDING
