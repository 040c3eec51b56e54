"""Planner ompl: finds a collision-free polyline in joint space by sampling, for goals that no direct motion
reaches.

RRTConnect is compiled in this project. The other planners are those of the OMPL library. They call compiled
checks through the library's Python binding. A motion between two configurations is proven collision-free as a
whole, see `cobot.robot.clearance`. So there is no resolution to choose.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import replace
from functools import lru_cache

import numpy as np
from ompl import base, geometric, util

from cobot.errors import PlanningTimeout
from cobot.motions.requests import MotionRequest
from cobot.planners.goals import more_goals
from cobot.planners.rrt_connect import connect
from cobot.planners.search.detours import length, without_detours
from cobot.planners.shortcut import draw_in, shorten
from cobot.robot.clearance import Clearance
from cobot.robot.description import RobotDescription
from cobot.types import RRT_CONNECT, Algorithm, Array, Pose

SPARE_M, SPARE_ATTEMPTS, SPARE_SHARE = 1e-3, 5000, 0.3
"""Distance that a polyline keeps in addition to the margin if its ends also keep it. It leaves room for
blending the corners. If RRTConnect finds no such polyline with this number of attempts to add a node, per
second of the request's time, the search continues with the margin alone. This is a count and not a time, so
that the same seed always gives the same path. The algorithms from the OMPL library have this share of the
time.
"""
RANGE_RAD = 2.0
"""Largest distance between a node of RRTConnect and its parent."""
FIRST_ATTEMPTS = 1000
"""Number of attempts to add a node before more configurations of the goal are computed. After each time the
number grows by a half.
"""
DIRECT = 1.25
"""A path is not improved if its length is at most this multiple of the direct path's length."""
ROUNDS, PATHS = 6, 2
"""Number of rounds that improve a longer path, and number of paths whose detours each round
removes together.
"""
FIRST_SHARES, LATER_SHARES = 2 * (0.1, 0.25, 0.4), (0.4,)
"""The searches of the first round, and of each later round. Each value limits the extra length of a path
beyond the direct path, as a share of the extra length of the best path. The smaller the space, the sooner a
search finds a path in it. Small spaces without a path in the first round are not searched again.
"""
ATTEMPTS = 3000
"""Maximum number of attempts to add a node in one of these searches."""
MUCH_WORK, MUCH_LONGER = 100_000, 0.5
"""No search begins after this many collision checks (about 0.1 s) if the path is longer than the direct path
by at least the second value, a share of the direct path. For a shorter path the number is proportionally
smaller. This is a count and not a time, so that the same seed always gives the same path.
"""
ROUNDING_RAD = 1e-9
IMPROVING_S = 1.0
"""Time for OMPL's optimising planners to shorten their path after they have found one."""
SLICE_S = 0.05
"""Interval at which the progress of these planners is checked, s."""
NOT_IMPROVING = frozenset({"RRT", "FMT", "BFMT", "KPIECE1", "BKPIECE1", "LBKPIECE1"})

util.setLogLevel(util.LogLevel.LOG_NONE)
# OMPL's planners use one random generator per process. So a worker's sequence of plans is repeatable, but a
# single plan is not.
util.RNG.setSeed(1)


def find_path(robot: RobotDescription, request: MotionRequest, goals: Array) -> Array:
    """The corners of a collision-free polyline from the start to one of the goals, shape (n, dof).

    Raises:
        PlanningTimeout: no path was found within the request's time.
    """
    limits = robot.limits
    start = np.clip(request.start, limits.min_position, limits.max_position)
    end_s = time.monotonic() + request.timeout_s
    margin_m, room_m = robot.collision.margin_m, room(robot, np.vstack([start, goals]))
    corners = None
    if room_m > margin_m:
        attempts = math.ceil(SPARE_ATTEMPTS * request.timeout_s)
        corners = _search(robot, start, goals, request, room_m, attempts, SPARE_SHARE)
    if corners is None:
        left = replace(request, timeout_s=max(0.0, end_s - time.monotonic()))
        corners = _search(robot, start, goals, left, margin_m)
    if corners is None:
        raise PlanningTimeout.after(request.timeout_s, _failure(request, goals))
    corners[0] = request.start
    return corners


def _search(
    robot: RobotDescription,
    start: Array,
    goals: Array,
    request: MotionRequest,
    distance_m: float,
    attempts: int = 0,
    share: float = 1.0,
) -> Array | None:
    """The corners of a polyline that keeps the given distance from obstacles; None if none is found.
    RRTConnect gives up after a number of attempts, the other algorithms after a share of the request's time.
    All of them observe the request's timeout.
    """
    end_s = time.monotonic() + request.timeout_s
    with robot.collision.keeping(distance_m) as clearance:
        if request.algorithm == RRT_CONNECT:
            return _connect(robot, clearance, start, goals, request, attempts)
        found = _Search(robot, clearance, start, goals, request.algorithm).run(share * request.timeout_s)
        if found is None:
            return None
        return draw_in(clearance, shorten(clearance, found, request.seed, end_s), end_s)


def _connect(
    robot: RobotDescription,
    clearance: Clearance,
    start: Array,
    goals: Array,
    request: MotionRequest,
    attempts: int,
) -> Array | None:
    """Return the first path if it is close to the direct path. Otherwise, search for more paths, and return
    the shortest of them and of their combination; see `without_detours`.

    If the searches of a round find no path, this round is the last one.
    """
    bounds = robot.limits.min_position, robot.limits.max_position
    deadline_s = time.monotonic() + request.timeout_s
    seeds = iter(_seeds(request.seed))
    seed = next(seeds)
    found, goals = _first(robot, clearance, start, goals, request, seed, attempts)
    if found is None:
        return None
    away = np.linalg.norm(goals - start, axis=1)
    direct_rad, best = float(away.min()), shorten(clearance, found, seed, deadline_s)
    paths, begun = [best], clearance.evaluations  # the work for the first path is not counted

    def is_enough() -> bool:
        return len(best) == 2 or length(best) <= DIRECT * direct_rad

    def is_too_much() -> bool:
        share = min(1.0, (length(best) / direct_rad - 1.0) / MUCH_LONGER)
        return clearance.evaluations - begun > share * MUCH_WORK or time.monotonic() > deadline_s

    for number in range(ROUNDS):
        for share in LATER_SHARES if number else FIRST_SHARES:
            if is_enough() or is_too_much() or len(paths) >= PATHS:
                break
            seed, left_s = next(seeds), deadline_s - time.monotonic()
            longest_rad = direct_rad + share * (length(best) - direct_rad)
            near = goals[away <= longest_rad]
            found = connect(clearance, start, near, *bounds, seed, left_s, RANGE_RAD, longest_rad, ATTEMPTS)
            if found is not None:
                paths.append(shorten(clearance, found, seed, deadline_s))
                best = min(best, paths[-1], key=length)
        if is_enough():
            break
        near = goals[away <= length(best) + ROUNDING_RAD]
        best = min(
            best, without_detours(clearance, paths or [best], near, bounds, seed, deadline_s), key=length
        )
        if is_enough() or is_too_much() or not paths:
            break
        paths = []
    return draw_in(clearance, best, deadline_s)


@lru_cache(maxsize=64)
def _seeds(seed: int) -> list[int]:
    """The seeds of all searches of a request. Computing them takes longer than a short search."""
    count = 1 + len(FIRST_SHARES) + (ROUNDS - 1) * len(LATER_SHARES)
    return [int(each) for each in np.random.default_rng(seed).integers(2**62, size=count)]


def _first(
    robot: RobotDescription,
    clearance: Clearance,
    start: Array,
    goals: Array,
    request: MotionRequest,
    seed: int,
    most: int,
) -> tuple[Array | None, Array]:
    """Find a first path. Returns the path and the goals that are known by then. An arm with more joints than
    the pose needs may have no collision-free path to the first goals. More goals are therefore computed for
    such an arm if no path is found soon. `most` is the maximum number of attempts to add a node. If it is 0,
    only the time is limited.
    """
    deadline_s = time.monotonic() + request.timeout_s
    bounds = robot.limits.min_position, robot.limits.max_position
    grows = isinstance(request.goal, Pose) and robot.model.kinematics(request.free_axes).redundant
    attempts, tried = FIRST_ATTEMPTS if grows else most, 0
    for number in itertools.count():
        left_s = deadline_s - time.monotonic()
        if most:
            attempts = min(attempts, most - tried)
        found = connect(clearance, start, goals, *bounds, seed + number, left_s, RANGE_RAD, np.inf, attempts)
        tried += attempts
        if found is not None or not grows or tried == most or time.monotonic() >= deadline_s:
            break
        goals = np.vstack([goals, more_goals(robot, request, number + 1)])
        attempts += attempts // 2
    return found, goals


def room(robot: RobotDescription, ends: Array) -> float:
    """The clearance (m) that a polyline between the given ends can keep. It is at most the clearance of the
    ends themselves.
    """
    margin_m = robot.collision.margin_m
    nearest = robot.collision.clearance.distances(ends, margin_m + SPARE_M).min(initial=margin_m + SPARE_M)
    return float(max(margin_m, nearest - 1e-9))


def _failure(request: MotionRequest, goals: Array) -> str:
    several = f" to any of {len(goals)} configurations of the goal" if len(goals) > 1 else ""
    return f"ompl: no free path{several} within {request.timeout_s:.1f} s ({request.algorithm} found none)"


class _Motions(base.MotionValidator):  # type: ignore[misc]
    """OMPL's check whether a straight joint motion, including its goal, is collision-free."""

    def __init__(self, information: base.SpaceInformation, clearance: Clearance) -> None:
        super().__init__(information)
        self._is_free = clearance.is_edge_free

    def checkMotion(self, start: base.State, goal: base.State) -> bool:  # noqa: N802 - OMPL's name
        return self._is_free(start, goal)


class _Search:
    """One planning problem, prepared for OMPL."""

    def __init__(
        self, robot: RobotDescription, clearance: Clearance, start: Array, goals: Array, algorithm: Algorithm
    ) -> None:
        limits = robot.limits
        self._dof = limits.dof
        self._improves = algorithm not in NOT_IMPROVING
        space = base.RealVectorStateSpace(limits.dof)
        bounds = base.RealVectorBounds(limits.dof)
        for joint in range(limits.dof):
            bounds.setLow(joint, float(limits.min_position[joint]))
            bounds.setHigh(joint, float(limits.max_position[joint]))
        space.setBounds(bounds)
        self._setup = geometric.SimpleSetup(space)
        information = self._setup.getSpaceInformation()
        self._motions = _Motions(information, clearance)  # OMPL holds no reference to it
        information.setMotionValidator(self._motions)
        self._setup.setStateValidityChecker(clearance.is_free)
        self._setup.setStartState(_state(space, start))
        goal = base.GoalStates(information)
        for joints in goals:
            goal.addState(_state(space, joints))
        self._setup.setGoal(goal)
        self._setup.setPlanner(getattr(geometric, algorithm)(information))

    def run(self, left_s: float) -> Array | None:
        """The corners of a path, shape (n, dof); None if no path is found within `left_s`."""
        self._setup.clear()
        begun_s = time.monotonic()
        self._setup.solve(min(SLICE_S, left_s) if self._improves else left_s)
        end_s = left_s
        while self._improves and (now_s := time.monotonic() - begun_s) < end_s:
            if self._setup.haveExactSolutionPath() and end_s == left_s:
                end_s = min(left_s, now_s + IMPROVING_S)
            self._setup.solve(min(SLICE_S, end_s - now_s))
        if not self._setup.haveExactSolutionPath():
            return None
        states = self._setup.getSolutionPath().getStates()
        return np.array([[state[joint] for joint in range(self._dof)] for state in states])


def _state(space: base.RealVectorStateSpace, joints: Array) -> base.State:
    state = space.allocState()
    for joint, value in enumerate(joints):
        state[joint] = float(value)
    return state
