"""Timed joint waypoints: a twice continuously differentiable motion through all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from cobot.errors import InputError
from cobot.planners.ptp import plan_ptp
from cobot.planners.request import MotionRequest, is_there, validate
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import stretch_to_limits
from cobot.robot.limits import check_positions
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits, PlannerName, Scaling, Waypoint

REST_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class WaypointRequest:
    """A motion through timed points.

    Attributes:
        start: where the arm is, shape (dof,), rad.
        points: see `through`.
        start_tolerance_rad: how far a first point at time 0 may be from `start`.
        check_limits: velocity, acceleration, jerk and position limits; collisions are always checked.
        retime: slow the whole motion down by as much as the rate limits need, instead of refusing it.
        approach: go to the first point by ptp before, with this scaling; None: it must be at `start`.
    """

    start: Array
    points: Sequence[Waypoint]
    start_tolerance_rad: float
    check_limits: bool = True
    retime: bool = False
    approach: Scaling | None = None


def plan_waypoints(robot: RobotDescription, request: WaypointRequest) -> Trajectory:
    """The validated motion.

    Raises:
        InputError: the points do not make a motion, see `through`.
        LimitError: naming the points between which a joint exceeds a limit.
        CollisionError: see `CollisionChecker.check_trajectory`.
    """
    limits = robot.limits
    labels = _labels(request.points, limits.dof)
    if request.check_limits:
        for point, label in zip(request.points, labels, strict=True):
            check_positions(limits, np.asarray(point.positions), f"{label}: angle")
    if request.approach is None:
        start, tolerance_rad = request.start, request.start_tolerance_rad
    else:
        start, tolerance_rad = np.asarray(request.points[0].positions, dtype=np.float64), 0.0
    if len(request.points) == 1 and request.approach is not None:
        start = request.start
    motion, knots = through(request.points, start, limits, tolerance_rad)
    if request.retime:
        motion = stretch_to_limits(motion, limits)
    if request.check_limits:
        validate(robot, motion, limits, knots)
    else:
        robot.collision.check_trajectory(motion)
    if request.approach is None or is_there(request.start, motion.start):
        return motion
    approach = MotionRequest(request.start, motion.start, PlannerName.PTP, request.approach)
    first = plan_ptp(robot, approach, motion.start)
    validate(robot, first, approach.scaled_limits(robot))
    return first.followed_by(motion)


def through(
    points: Sequence[Waypoint], start: Array, limits: JointLimits, start_tolerance_rad: float
) -> tuple[Trajectory, list[str]]:
    """Quintics through the points at their times, from rest to rest.

    A first point at time 0 must be where the arm is; when the first time is later, the present
    position at time 0 is the point before it. Velocities and accelerations that a point does not
    give are those of the clamped cubic spline through all points.

    Returns:
        The trajectory, and a name for each of its breakpoints.

    Raises:
        InputError: no points, times that do not increase, a start elsewhere, ends that are not at rest.
    """
    labels = _labels(points, limits.dof)
    times = np.array([point.time_from_start_s for point in points])
    positions = np.array([point.positions for point in points], dtype=np.float64)
    _require_order(times, labels)
    _require_rest(points, labels, first=times[0] == 0.0)
    if times[-1] == 0.0:
        raise InputError(f"{labels[0]}: a motion needs a point with a time_from_start above 0")
    if times[0] == 0.0:
        _require_start(positions[0], start, limits, start_tolerance_rad, labels[0])
        positions[0] = start
    else:
        times, positions = np.append(0.0, times), np.vstack([start, positions])
        labels = ["the present position", *labels]
        points = [Waypoint(start.tolist(), 0.0), *points]
    spline = CubicSpline(times, positions, bc_type="clamped")
    velocities, accelerations = spline(times, 1), spline(times, 2)
    accelerations[[0, -1]] = 0.0
    for index, point in enumerate(points):
        if point.velocities is not None:
            velocities[index] = point.velocities
        if point.accelerations is not None:
            accelerations[index] = point.accelerations
    return from_hermite(times, positions, velocities, accelerations), labels


def _labels(points: Sequence[Waypoint], dof: int) -> list[str]:
    """What to call each point; and that there are points, with a number for each joint."""
    if not points:
        raise InputError("points: at least one is needed")
    labels = [point.label or f"point {index + 1}" for index, point in enumerate(points)]
    for point, label in zip(points, labels, strict=True):
        for name in ("positions", "velocities", "accelerations"):
            values = getattr(point, name)
            if values is not None and len(values) != dof:
                raise InputError(f"{label}: {name} must have {dof} numbers, got {len(values)}")
    return labels


def _require_order(times: Array, labels: list[str]) -> None:
    if times[0] < 0.0:
        raise InputError(f"{labels[0]}: time_from_start is {times[0]} s, must not be negative")
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if len(late):
        index = int(late[0]) + 1
        raise InputError(
            f"{labels[index]}: time_from_start is {times[index]} s, must be later than the "
            f"{times[index - 1]} s of {labels[index - 1]}"
        )


def _require_rest(points: Sequence[Waypoint], labels: list[str], *, first: bool) -> None:
    for index in [0, -1] if first else [-1]:
        for name, values in (
            ("velocities", points[index].velocities),
            ("accelerations", points[index].accelerations),
        ):
            if values is not None and np.abs(np.asarray(values)).max() > REST_TOLERANCE:
                end = "start" if index == 0 else "end"
                raise InputError(f"{labels[index]}: the motion must {end} at rest, but its {name} are not 0")


def _require_start(first: Array, start: Array, limits: JointLimits, tolerance_rad: float, label: str) -> None:
    off = np.abs(first - start)
    if off.max() <= tolerance_rad:
        return
    joint = int(off.argmax())
    raise InputError(
        f"{label}: starts with {limits.names[joint]} at {first[joint]:.4f} rad, but it is at "
        f"{start[joint]:.4f} rad: {off[joint]:.4f} rad apart, allowed are {tolerance_rad:g} rad; "
        "go there first; POST /trajectory/send does it by itself with move_to_start"
    )
