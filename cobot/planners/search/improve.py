"""Faster motions around obstacles, as long as planning time is left.

A try changes the curve of the best motion so far by a smooth random amount, or searches for a different path
around the obstacles that is no longer than the best one. The resulting path is timed. It replaces the best
motion if it is faster and passes the same checks. A change that has helped is tried again. Each result can be
executed, so the search can end at any moment.

A try depends only on the seed of the request, the number of the try and the results of earlier tries.
Therefore the same number of tries gives the same motion.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cobot.errors import CobotError
from cobot.motions.improving import Improving
from cobot.motions.requests import MotionRequest
from cobot.planners import validated
from cobot.planners.escape import leave_invalid_start
from cobot.planners.goals import joint_goals
from cobot.planners.ptp import fastest_s, plan_ptp
from cobot.planners.rrt_connect import connect
from cobot.planners.search.detours import length
from cobot.planners.search.sampling import ATTEMPTS, RANGE_RAD, room
from cobot.planners.search.spline import resampled, smooth_curve, smooth_motion
from cobot.planners.shortcut import draw_in, shorten
from cobot.planners.timing.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.trajectory import Notice, Trajectory
from cobot.types import Array, PlannerName

NEAR = 1.01
"""A motion is final if its duration is at most this multiple of the lower bound."""
SEARCH_EVERY = 10
"""One in this many tries searches for a different path. The other tries change the curve of the best motion.
"""
MAX_POINTS = 64
"""Usual maximum number of control points. Only if the unchanged curve is not collision-free, more points are
used.
"""
WAVES = 5
"""Number of half waves in a random change. The amplitude of each is inversely proportional to its number."""
SHARES = (1.0, 0.5, 0.25)
"""Sizes of a random change, as shares of `Improving.step_rad`."""
STEPS_RAD, GROWTH, DECAY = (0.02, 0.4), 1.3, 0.97
"""Smallest and largest step, rad. Then the factors by which the step changes: after a successful change,
and after an unsuccessful one.
"""
LOOKS = 48
"""Number of points at which a curve is checked before the complete proof that it is collision-free."""
PATH_SAMPLES = 200
SAME_RAD = 1e-6


def begin(robot: RobotDescription, request: MotionRequest, first: Trajectory) -> Improving:
    """The state before the first try.

    A motion that leaves a start in collision or beyond a limit is not improved, because its first part is the
    shortest path out.
    """
    goals, limits = joint_goals(robot, request), request.scaled_limits(robot)
    if not np.isclose(goals, first.end, rtol=0.0, atol=SAME_RAD).all(axis=1).any():
        goals = np.vstack([goals, first.end])
    bounds_s = np.array([fastest_s(request.start, goal, limits) for goal in goals])
    state = Improving(first, first.duration_s, goals, bounds_s)
    return replace(state, done=leave_invalid_start(robot, request) is not None or _is_final(state))


def improve(
    robot: RobotDescription,
    request: MotionRequest,
    state: Improving,
    slice_s: float,
    max_tries: float = np.inf,
    clock: Callable[[], float] | None = None,
) -> Improving:
    """Try to find faster motions for `slice_s` seconds or `max_tries` tries, whichever ends first. The last
    try may end after that time.
    """
    clock = clock or time.monotonic
    begun_s, last = clock(), state.tries + max_tries
    before_s = state.spent_s
    while not state.done and state.tries < last and state.spent_s - before_s < slice_s:
        state = _try(robot, request, state)
        state = replace(state, spent_s=before_s + clock() - begun_s)
    return state


def _is_final(state: Improving) -> bool:
    return state.best.duration_s <= NEAR * state.lower_bound_s


def _try(robot: RobotDescription, request: MotionRequest, state: Improving) -> Improving:
    number = state.tries
    state = replace(state, tries=number + 1)
    try:
        if number == 0 and request.planner is PlannerName.AUTO:
            return _go_directly(robot, request, state)
        if number % SEARCH_EVERY == SEARCH_EVERY - 1:
            return _accept(robot, request, state, _another_way(robot, request, state, number))
        return _change(robot, request, state, np.random.default_rng((request.seed, number)))
    except CobotError:
        return state


def _accept(
    robot: RobotDescription, request: MotionRequest, state: Improving, motion: Trajectory | None
) -> Improving:
    """The state after trying this motion. If the motion is faster than the best one and passes all checks, it
    is the new best one.

    Raises:
        CobotError: the motion fails a check.
    """
    if motion is None or motion.duration_s >= state.best.duration_s:
        return state
    if not motion.notices:
        motion = replace(motion, note=state.best.note, notices=state.best.notices)
    motion = validated(robot, request, motion)
    state = replace(state, best=motion, improvements=state.improvements + 1)
    return replace(state, done=_is_final(state))


def _go_directly(robot: RobotDescription, request: MotionRequest, state: Improving) -> Improving:
    """Try the direct joint motions to the other joint positions of the goal, and keep one if it is faster."""
    for index in np.argsort(state.lower_bounds_s, kind="stable"):
        if state.lower_bounds_s[index] >= state.best.duration_s:
            break
        motion = plan_ptp(robot, request, state.goals[index])
        taken = Notice("auto", {"planner": PlannerName.PTP.value})
        note = "auto used ptp: the direct joint motion is free"
        try:
            return _accept(robot, request, state, replace(motion, note=note, notices=(taken,)))
        except CobotError:
            continue
    return state


def _another_way(
    robot: RobotDescription, request: MotionRequest, state: Improving, number: int
) -> Trajectory | None:
    """A motion that takes a different path around the obstacles. The path is at most as long as the best
    motion's path.
    """
    limits, start = robot.limits, request.start
    longest_rad = length(_sampled(state.best))
    goals = state.goals[np.linalg.norm(state.goals - start, axis=1) <= longest_rad]
    bounds = limits.min_position, limits.max_position
    seed = int(np.random.default_rng((request.seed, number)).integers(2**62))
    with robot.collision.keeping(room(robot, np.vstack([start, goals]))) as clearance:
        way = connect(
            clearance, start, goals, *bounds, seed, request.timeout_s, RANGE_RAD, longest_rad, ATTEMPTS
        )
        if way is None:
            return None
        way = draw_in(clearance, shorten(clearance, way, seed))
    return smooth_motion(robot, way, request.scaled_limits(robot))


def _change(
    robot: RobotDescription, request: MotionRequest, state: Improving, random: np.random.Generator
) -> Improving:
    """The state after trying a changed curve close to the curve of the best motion."""
    change, plain = state.change, state.tries % SEARCH_EVERY == 1
    if change is None and not plain:
        change = state.step_rad * random.choice(SHARES) * _wave(state, random)
    motion = _changed(robot, request, state, change)
    if motion is None and change is None and state.points < MAX_POINTS and not state.improvements:
        return replace(state, points=2 * state.points)
    try:
        better = _accept(robot, request, state, motion)
    except CobotError:
        better = state
    if better is not state:
        step_rad = state.step_rad if plain else min(GROWTH * state.step_rad, STEPS_RAD[1])
        return replace(better, change=change, step_rad=step_rad)
    step_rad = state.step_rad if plain or state.change is not None else DECAY * state.step_rad
    return replace(state, change=None, step_rad=max(step_rad, STEPS_RAD[0]))


def _wave(state: Improving, random: np.random.Generator) -> Array:
    """A smooth random change of all joints that is 0 at both ends, shape (points, dof)."""
    orders = np.arange(1, WAVES + 1)
    waves = np.sin(np.pi * orders * np.linspace(0.0, 1.0, state.points)[:, None]) / orders
    return np.asarray(waves @ random.normal(size=(WAVES, state.best.dof)))


def _changed(
    robot: RobotDescription, request: MotionRequest, state: Improving, change: Array | None
) -> Trajectory | None:
    """The motion along the changed curve; None if it is not collision-free.

    Raises:
        CobotError: the curve cannot be timed.
    """
    limits = robot.limits
    points = resampled(_sampled(state.best), state.points)
    if change is not None:
        points[1:-1] = np.clip(points + change, limits.min_position, limits.max_position)[1:-1]
    (curve, pieces), clearance = smooth_curve(points), robot.collision.clearance
    if not clearance.are_free(curve.at(np.linspace(0.0, 1.0, LOOKS))).all():
        return None
    if clearance.contact(pieces) is not None:
        return None
    return time_optimal(robot, curve, request.scaled_limits(robot)).trajectory


def _sampled(motion: Trajectory) -> Array:
    return motion.sample(np.linspace(0.0, motion.duration_s, PATH_SAMPLES))
