"""CHOMP: covariant Hamiltonian optimisation (Zucker et al. 2013, doi 10.1177/0278364913488805).

A path is bent until it is free of collisions. The gradient of the obstacle cost, from exact signed distances,
pushes its points away from obstacles. The covariant step, A⁻¹ times the gradient, spreads every push smoothly
over the whole path. The search starts from the straight line in joint space to each goal in turn, then from a
path that ompl finds, which it smooths. The result must also be free of collisions between its points.
Otherwise points are added.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from cobot.errors import CollisionError, PlanningError, PlanningTimeout
from cobot.motions.requests import MotionRequest
from cobot.planners.descent import PathDescent
from cobot.planners.search.spline import smooth_motion
from cobot.robot.clearance import Clearance
from cobot.robot.collision import Contact
from cobot.robot.description import RobotDescription
from cobot.trajectory import Notice, Trajectory
from cobot.types import RRT_CONNECT, Array

POINTS, MAX_POINTS = 30, 100
ITERATIONS = 120
SMOOTHING = 20
"""Minimum number of iterations for a path from ompl. It is already free of collisions, and these iterations
make it smoother.
"""
CLEARANCE_M = 0.04
"""ε of the paper's equation 21: obstacles push within this distance."""
SPARE_M = 1e-3
"""Clearance that the path keeps in addition to the margin, m, if both its ends have it. The spline through
the path needs this margin.
"""
PUSHED_M = 3e-3
"""Distance beyond the required clearance, m, below which the push has its full strength. The path between two
points needs this distance.
"""
SMOOTHNESS_WEIGHT = 0.05
STEP_RAD = 0.065
"""The largest change of a joint in one iteration."""
STRAIGHT_STARTS = 3


def plan_chomp(robot: RobotDescription, request: MotionRequest, goals: Array) -> Trajectory:
    """A smooth motion near the straight line in joint space to one of the goals, or near a path from ompl.
    The motion's `note` states whether a path from ompl was used.

    Raises:
        PlanningError: every descent ended in a path that touches something; reports what, where and how deep.
        PlanningTimeout: the time limit of the request is exceeded.
    """
    deadline_s = time.monotonic() + request.timeout_s
    problem: CollisionError | None = None
    for note, corners in _starts(robot, request, goals, deadline_s):
        points, why = _optimise(robot, corners, SMOOTHING if note else 0, deadline_s, request.timeout_s)
        problem = problem or why
        if points is None:
            continue
        try:
            motion = smooth_motion(robot, points, request.scaled_limits(robot))
        except CollisionError as exc:
            problem = problem or exc
        else:
            return replace(motion, note=note, notices=(Notice("chomp", {}),)) if note else motion
    raise PlanningError(
        f"chomp found no free path near the straight line: {problem}",
        findings=() if problem is None else problem.findings,
    )


def _starts(
    robot: RobotDescription, request: MotionRequest, goals: Array, deadline_s: float
) -> Iterator[tuple[str, Array]]:
    """For each path from which the search starts: the note, and the corners of the path, shape (n, dof)."""
    start = np.clip(request.start, robot.limits.min_position, robot.limits.max_position)
    for goal in goals[:STRAIGHT_STARTS]:
        yield "", np.array([start, goal])
    from cobot.planners.search.sampling import find_path

    left_s = deadline_s - time.monotonic()
    try:
        corners = find_path(robot, replace(request, timeout_s=left_s, algorithm=RRT_CONNECT), goals)
    except PlanningTimeout:
        return
    yield "chomp started from a path of ompl: it found none near the straight line", corners


def _optimise(
    robot: RobotDescription, corners: Array, least_iterations: int, deadline_s: float, timeout_s: float
) -> tuple[Array | None, CollisionError | None]:
    """Search for a collision-free polyline that begins and ends like `corners`. Returns the polyline, shape
    (n, dof), and None. If the search fails, returns None and the error that names the obstacle.

    Raises:
        PlanningTimeout: see `plan_chomp`.
    """
    margin_m, spare_m = robot.collision.margin_m, robot.collision.margin_m + SPARE_M
    ends = robot.collision.clearance.distances(corners[[0, -1]], spare_m).min(initial=spare_m)
    least_m = float(max(margin_m, ends - 1e-9))
    points = _sample(corners)
    with robot.collision.keeping(least_m) as clearance:
        while True:
            points, free = _descend(
                robot, clearance, points, least_m, least_iterations, deadline_s, timeout_s
            )
            if free is not None:
                return free, None
            if 2 * len(points) > MAX_POINTS or not clearance.are_free(points).all():
                return None, _obstacle(robot, clearance, points)
            points = _double(points)


def _descend(
    robot: RobotDescription,
    clearance: Clearance,
    points: Array,
    least_m: float,
    least_iterations: int,
    deadline_s: float,
    timeout_s: float,
) -> tuple[Array, Array | None]:
    """The points after the descent, and the last points between which all straight motions were free of
    collisions.
    """
    limits, count = robot.limits, len(points)
    spread = _spread(count)
    smoothest = -spread @ _pull(points[0], points[-1], count)
    descent = PathDescent(
        clearance,
        points,
        smoothest,
        spread,
        limits.min_position,
        limits.max_position,
        least_m + PUSHED_M,
        CLEARANCE_M,
    )
    weight, free = SMOOTHNESS_WEIGHT, None
    touching = slice(0)  # the piece of the last contact, where the next one is most likely
    for iteration in range(ITERATIONS):
        if time.monotonic() > deadline_s:
            raise PlanningTimeout.after(timeout_s, f"chomp: not finished within {timeout_s:.1f} s")
        if descent.push() >= least_m:
            pieces = np.stack([points[:-1], points[1:]], axis=1)
            if clearance.contact(pieces[touching]) is None:
                if (found := clearance.contact(pieces)) is None:
                    free = points.copy()
                else:
                    touching = slice(found[0], found[0] + 1)
            if free is not None and iteration >= least_iterations:
                break
        if not descent.step(weight, STEP_RAD):
            break
        if iteration % 40 == 39:
            weight *= 0.3  # gives collisions more weight
    return points, free


def _obstacle(robot: RobotDescription, clearance: Clearance, points: Array) -> CollisionError:
    """The error that reports the deepest contact and its location."""
    points = _double(_double(points))
    distances = clearance.distances(points, 1.0)
    row, pair = np.unravel_index(int(distances.argmin()), distances.shape)
    contact = Contact(*robot.collision.names(int(pair)), float(distances[row, pair]))
    share = float(row / (len(points) - 1))
    return CollisionError(
        f"after {100.0 * share:.0f} % of the path {contact.first} and {contact.second} are still at a "
        f"distance of {1e3 * contact.distance_m:.0f} mm; try ompl",
        findings=[robot.collision.finding(contact, share)],
    )


def _sample(corners: Array) -> Array:
    """`POINTS` evenly spaced points along a polyline. They include its corners, so that its shape stays the
    same.
    """
    if len(corners) == 2:
        return np.linspace(corners[0], corners[1], POINTS)
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    places = np.union1d(np.linspace(0.0, reached[-1], POINTS), reached)
    return np.stack([np.interp(places, reached, column) for column in corners.T], axis=1)


def _double(points: Array) -> Array:
    """The same polyline with a point added between each pair of neighbours."""
    out = np.empty((2 * len(points) - 1, points.shape[1]))
    out[::2], out[1::2] = points, 0.5 * (points[:-1] + points[1:])
    return out


@lru_cache(maxsize=32)
def _spread(count: int) -> Array:
    """The matrix A⁻¹, with A from equation 16 of the paper for squared accelerations. The gradient of the
    smoothness is A q + b, so its covariant step is q + A⁻¹ b.
    """
    difference = _differences(count)[:, 1:-1]
    return np.asarray(np.linalg.inv(difference.T @ difference))


def _pull(start: Array, goal: Array, count: int) -> Array:
    """The vector b of the gradient. It is the contribution of the path's ends, which are at rest."""
    difference = _differences(count)
    ends = np.outer(difference[:, 0], start) + np.outer(difference[:, -1], goal)
    return np.asarray(difference[:, 1:-1].T @ ends)


@lru_cache(maxsize=32)
def _differences(count: int) -> Array:
    """Second differences of `count` points of a path that is at rest at both ends. Beyond each end, the path
    continues with a point equal to the end.
    """
    difference = np.zeros((count, count))
    for row in range(count):
        for column, weight in ((row - 1, 1.0), (row, -2.0), (row + 1, 1.0)):
            difference[row, min(max(column, 0), count - 1)] += weight
    return difference
