"""A new goal for a running motion.

A ptp motion continues from the moving state: Ruckig's profiles lead from its velocities and accelerations to
the new goal. Where that is impossible, and for all other planners, the new motion is the sum of two. In the
first, the arm slows down from the point of the change until it stops, all joints in the same time. The second
is a motion of any planner that leads from the point of this stop to the new goal. It begins before the first
has ended, as early as the limits permit. The accelerations of both motions are continuous, so the
acceleration of the sum is continuous too. The sum is then checked like every motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import ruckig

from cobot.errors import CobotError, CollisionError, LimitError, PlanningError
from cobot.motions.change_over import ChangeOver
from cobot.motions.requests import MotionRequest
from cobot.planners import function_of, plan
from cobot.planners.goals import nearest_goal
from cobot.planners.ptp import from_profiles
from cobot.planners.timing.profile import fastest_profile
from cobot.polynomials import greatest_rates, pieces_at
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import PLANNED_TOLERANCE, check_motion
from cobot.trajectory import ORDER, Trajectory
from cobot.trajectory_parts import SAME_S, cut, expanded, remainder_at
from cobot.types import Array, JointLimits, PlannerName, Synchronization

MOVING_ON = (PlannerName.PTP, PlannerName.AUTO)
"""Planners that first try the direct motion of all joints."""

GENTLE = 0.7
"""Share of the acceleration limits that is used for slowing down. The new motion may use the remaining
part.
"""
SHARES = (0.0, 0.3, 0.6, 0.8, 1.0)
"""Shares of the time to rest. The new motion begins after the first of these shares after which the sum stays
within the limits.
"""
STEPS = 100
"""Number of samples of the motion to rest. Each of `SHARES` is a multiple of one step."""
LOOK_S = 0.01
"""Interval at which the TCP speed is checked while both motions are added, s."""


def load_search() -> None:
    """Import the modules that are needed to find a path around obstacles. The import takes longer than
    finding the path.
    """
    import scipy.interpolate  # noqa: F401

    function_of(PlannerName.OMPL)


def retarget(
    robot: RobotDescription, request: MotionRequest, under_way: Trajectory, now_s: float, from_s: float
) -> ChangeOver:
    """Change the goal of a motion. Before `from_s` the motion stays unchanged.

    While both motions are added, neither a joint nor the TCP is faster than in the faster one of them.

    Args:
        request: the new goal; its start is not used.
        now_s: current path time; the result leaves out the part before this time.
        from_s: path time of the change.

    Raises:
        PlanningError: the new goal is out of reach from there, or the path to it is not collision-free.
        InputError: see `cobot.planners.plan`.
    """
    from_s = min(from_s, under_way.duration_s)
    state = np.array([under_way.sample([from_s], order)[0] for order in range(3)])
    if from_s == under_way.duration_s:
        state[1:] = 0.0
    whole, until_s = _moving_on(robot, request, state), 0.0
    if whole is None:
        whole, until_s = _by_way_of_rest(robot, request, under_way, max(now_s, 0.0), state)
    before = replace(_until(under_way, from_s), note="", notices=())
    changed, offset_s = remainder_at(before.followed_by(whole), now_s)
    at_s = from_s - offset_s
    return ChangeOver(changed, offset_s, at_s, at_s + until_s)


def _moving_on(robot: RobotDescription, request: MotionRequest, state: Array) -> Trajectory | None:
    """The fastest motion of all joints to the goal from a moving state of shape (3, dof). None if the request
    needs a different path, if its limits are below the current velocities, or if the motion is not
    collision-free.
    """
    limits = request.scaled_limits(robot)
    direct = request.planner in MOVING_ON and request.synchronization is Synchronization.TIME
    slow = (np.abs(state[1:]) > (limits.max_velocity, limits.max_acceleration)).any()
    if not direct or slow or request.constraints is not None:
        return None
    problem = _profile(state, limits)
    try:
        goal = nearest_goal(robot, replace(request, start=state[0]))
        problem.target_position = goal.tolist()
        solution = fastest_profile(problem)
        motion = from_profiles(solution.profiles[0], solution.duration)
        check_motion(robot, motion, limits)
    except CobotError:
        return None
    return motion


def _by_way_of_rest(
    robot: RobotDescription, request: MotionRequest, under_way: Trajectory, now_s: float, state: Array
) -> tuple[Trajectory, float]:
    """Slow down to rest, then begin the new motion. Returns the whole trajectory, and the time at which the
    slowing motion ends.
    """
    left = cut(under_way, min(now_s, under_way.duration_s - 2.0 * SAME_S), under_way.duration_s)
    limits = _allowed(robot, request, left)
    slowing = _slow_down(state, limits)
    following = plan(robot, replace(request, start=slowing.end))
    if following is not None:
        whole = _joined(robot, request, limits, left, slowing, following)
        return replace(whole, note=following.note, notices=following.notices), slowing.duration_s
    check_motion(robot, slowing, limits)
    return slowing, slowing.duration_s


def _allowed(robot: RobotDescription, request: MotionRequest, left: Trajectory) -> JointLimits:
    """For each limit, the larger of the request's limit and the value that the current motion uses, within
    the robot's limits.
    """
    asked, own = request.scaled_limits(robot), robot.limits
    used = greatest_rates(left.coefficients, np.diff(left.breakpoints_s)).max(axis=1)
    rows = zip(
        (asked.max_velocity, asked.max_acceleration, asked.max_jerk),
        used * (1.0 + PLANNED_TOLERANCE),
        (own.max_velocity, own.max_acceleration, own.max_jerk),
        strict=True,
    )
    return own.with_rates(*(np.minimum(np.maximum(mine, other), most) for mine, other, most in rows))


def _slow_down(state: Array, limits: JointLimits) -> Trajectory:
    """A motion to rest from a moving state of shape (3, dof). All joints stop at the same time."""
    if not state[1:].any():
        return _resting(state[0])
    acceleration = np.maximum(GENTLE * limits.max_acceleration, np.abs(state[2]) * (1.0 + PLANNED_TOLERANCE))
    gentle = limits.with_rates(limits.max_velocity, acceleration, limits.max_jerk)
    problem = _profile(state, gentle)
    problem.control_interface = ruckig.ControlInterface.Velocity
    solution = fastest_profile(problem)
    return from_profiles(solution.profiles[0], solution.duration)


def _profile(state: Array, limits: JointLimits) -> ruckig.InputParameter:
    """Ruckig's problem of a motion to rest from a moving state of shape (3, dof)."""
    problem = ruckig.InputParameter(limits.dof)
    problem.synchronization = ruckig.Synchronization.Phase
    problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
    problem.max_velocity = limits.max_velocity.tolist()
    problem.max_acceleration = limits.max_acceleration.tolist()
    problem.max_jerk = limits.max_jerk.tolist()
    return problem


def _resting(position: Array) -> Trajectory:
    coefficients = np.zeros((1, len(position), ORDER))
    coefficients[0, :, 0] = position
    return Trajectory(np.array([0.0, 1e-6]), coefficients)


def _joined(
    robot: RobotDescription,
    request: MotionRequest,
    limits: JointLimits,
    left: Trajectory,
    slowing: Trajectory,
    following: Trajectory,
) -> Trajectory:
    """Join the motion that slows down and the motion that follows it into one motion that passes all checks.

    The second begins as early as limits and collisions permit; with constraints it begins at rest. Once the
    first motion has ended, the sum equals the second. If `plan` has just checked the second motion, that part
    is not checked again.

    Raises:
        PlanningError: a check fails even if the second motion begins after the first has ended; the error is
            raised by that check.
    """
    is_proven = robot.collision.has_proven(following)
    shares = _possible_shares(slowing, following, limits) if request.constraints is None else SHARES[-1:]
    for share in shares:
        begun_s = share * slowing.duration_s
        both_s = min(slowing.duration_s - begun_s, following.duration_s)
        if both_s <= SAME_S:  # the second begins where the first ends
            opening, whole = slowing, slowing.followed_by(following)
        else:
            whole = opening = _sum(slowing, cut(following, 0.0, both_s), begun_s)
            if following.duration_s - both_s > SAME_S:
                whole = opening.followed_by(cut(following, both_s, following.duration_s))
            speed = _tcp_speed(robot, opening)
            if all(speed > _tcp_speed(robot, each) for each in (left, following)):
                continue
        try:
            check_motion(robot, opening if is_proven else whole, limits)
        except (LimitError, PlanningError):
            continue
        return whole
    try:
        check_motion(robot, whole, limits)  # an error names the point in the whole motion
    except (LimitError, PlanningError) as exc:
        kind = CollisionError if isinstance(exc, CollisionError) else PlanningError
        said = f"the path from the current motion to the new goal: {exc}"
        raise kind(said, findings=exc.findings) from exc
    return whole


def _possible_shares(slowing: Trajectory, following: Trajectory, limits: JointLimits) -> list[float]:
    """The `SHARES` at which no sample of the sum exceeds a rate limit. The last share is always among them.
    The calculation takes a fraction of the time of `check_motion`.
    """
    times_s = slowing.duration_s / STEPS * np.arange(STEPS)
    bounds = np.array((limits.max_velocity, limits.max_acceleration, limits.max_jerk))[:, None]
    first, second = (
        pieces_at(each.breakpoints_s, each.coefficients, np.minimum(times_s, each.duration_s))[1:]
        for each in (slowing, following)
    )
    possible = []
    for share in SHARES:
        step = round(share * STEPS)
        total = np.abs(first[:, step:] + second[:, : STEPS - step])
        if (total <= bounds * (1.0 + PLANNED_TOLERANCE)).all():
            possible.append(share)
    return possible


def _tcp_speed(robot: RobotDescription, motion: Trajectory) -> float:
    """The largest TCP speed, m/s."""
    times_s = np.linspace(0.0, motion.duration_s, max(int(motion.duration_s / LOOK_S), 1) + 1)
    places = pieces_at(motion.breakpoints_s, motion.coefficients, times_s)
    twists = robot.model.chain.twists(places[0], places[1])
    return float(np.linalg.norm(twists[:, :3], axis=1).max())


def _sum(slowing: Trajectory, following: Trajectory, begun_s: float) -> Trajectory:
    """The superposition of a motion to rest and a second motion, which starts from that position of rest at a
    given time.
    """
    times = np.unique(np.concatenate([slowing.breakpoints_s, begun_s + following.breakpoints_s]))
    times = times[np.append(True, np.diff(times) > SAME_S)]
    middles = 0.5 * (times[:-1] + times[1:])
    coefficients = np.zeros((len(middles), slowing.dof, ORDER))
    for motion, since_s in ((slowing, 0.0), (following, begun_s)):
        inside = middles - since_s
        on = (inside > 0.0) & (inside < motion.duration_s)
        coefficients[on] += expanded(motion, times[:-1][on] - since_s, inside[on])
        before, after = inside <= 0.0, inside >= motion.duration_s
        coefficients[before, :, 0] += motion.start
        coefficients[after, :, 0] += motion.end
    coefficients[:, :, 0] -= slowing.end
    return Trajectory(times, coefficients)


def _until(motion: Trajectory, end_s: float) -> Trajectory:
    """The part of a motion up to a time. Its polynomials stay the same, bit for bit."""
    count = int(np.searchsorted(motion.breakpoints_s, end_s - SAME_S, side="right"))
    count = min(max(count, 1), motion.segments)
    times = np.append(motion.breakpoints_s[:count], max(end_s, motion.breakpoints_s[count - 1] + SAME_S))
    return Trajectory(times, motion.coefficients[:count])
