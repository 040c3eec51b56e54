"""Timed joint waypoints: a twice continuously differentiable motion through all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from cobot.errors import InputError, LimitError
from cobot.motions.points import (
    GO_THERE,
    labels_of,
    require_order,
    require_positions,
    require_rest,
    require_start,
)
from cobot.motions.requests import MotionRequest, WaypointRequest
from cobot.planners.checks import is_there, validate
from cobot.planners.ptp import plan_ptp
from cobot.planners.rounding import smoothed
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_limits, stretch_to_limits
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits, PlannerName, Waypoint

PRESENT = "the present position"


def plan_waypoints(robot: RobotDescription, request: WaypointRequest) -> Trajectory:
    """The validated motion. Its `note` says if rounding was taken out of the points, see `rounding`.

    Raises:
        InputError: the points do not make a motion, see `through`.
        LimitError: naming the points between which a joint exceeds a limit.
        CollisionError: see `CollisionChecker.check_trajectory`.
    """
    limits = robot.limits
    labels = labels_of(request.points, limits.dof)
    if request.check_limits:
        require_positions(request.points, limits, labels)
    if request.approach is None:
        start, tolerance_rad = request.start, request.start_tolerance_rad
    else:
        start, tolerance_rad = np.asarray(request.points[0].positions, dtype=np.float64), 0.0
    if len(request.points) == 1 and request.approach is not None:
        start = request.start
    course = _course(request.points, start, limits, tolerance_rad)
    if request.check_limits or request.retime:
        motion, beyond = _within_rounding(course, limits)
        if request.retime:
            motion = stretch_to_limits(motion, limits)
        if request.check_limits and (beyond or request.retime):
            _require_limits(motion, limits, course.labels, request)
    else:
        motion = course.motion()
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
    course = _course(points, start, limits, start_tolerance_rad)
    return course.motion(), course.labels


@dataclass(frozen=True, slots=True)
class _Course:
    """The points as arrays, the present position included where it is one of them.

    Attributes:
        times_s, positions: shape (n,), and (n, dof), rad.
        labels: what each is called.
        points: for the rates that they give.
    """

    times_s: Array
    positions: Array
    labels: list[str]
    points: Sequence[Waypoint]

    def motion(self) -> Trajectory:
        spline = CubicSpline(self.times_s, self.positions, bc_type="clamped")
        velocities, accelerations = spline(self.times_s, 1), spline(self.times_s, 2)
        accelerations[[0, -1]] = 0.0
        for index, point in enumerate(self.points):
            if point.velocities is not None:
                velocities[index] = point.velocities
            if point.accelerations is not None:
                accelerations[index] = point.accelerations
        return from_hermite(self.times_s, self.positions, velocities, accelerations)

    @property
    def given_rates(self) -> bool:
        return any(p.velocities is not None or p.accelerations is not None for p in self.points)


def _course(
    points: Sequence[Waypoint], start: Array, limits: JointLimits, start_tolerance_rad: float
) -> _Course:
    """See `through`."""
    labels = labels_of(points, limits.dof)
    times = np.array([point.time_from_start_s for point in points])
    positions = np.array([point.positions for point in points], dtype=np.float64)
    require_order(times, labels)
    require_rest(points, labels, first=times[0] == 0.0)
    if times[-1] == 0.0:
        raise InputError(f"{labels[0]}: a motion needs a point with a time_from_start above 0")
    if times[0] == 0.0:
        require_start(positions[0], start, limits, start_tolerance_rad, labels[0])
        positions[0] = start
    else:
        times, positions = np.append(0.0, times), np.vstack([start, positions])
        labels = [PRESENT, *labels]
        points = [Waypoint(start.tolist(), 0.0), *points]
    return _Course(times, positions, labels, points)


def _within_rounding(course: _Course, limits: JointLimits) -> tuple[Trajectory, bool]:
    """The motion, without the rounding of its points if that is beyond the limits and can be taken out.

    Returns:
        The motion, and whether it may still be beyond a limit.
    """
    motion = course.motion()
    try:
        check_limits(motion, limits.including(motion.start))
    except LimitError:
        found = None if course.given_rates else smoothed(course.times_s, course.positions)
        if found is None:
            return motion, True
        positions, unit = found
        off_rad = np.abs(positions - course.positions).max()
        note = (
            f"the points were smoothed by up to {off_rad:.1e} rad, within the {unit:.0e} rad to which they "
            "are rounded: the jerk of the rounding would be beyond the limits"
        )
        return replace(replace(course, positions=positions).motion(), note=note), True
    return motion, False


def _require_limits(
    motion: Trajectory, limits: JointLimits, labels: list[str], request: WaypointRequest
) -> None:
    """See `check_limits`; what is beyond a limit comes with the way out."""
    try:
        check_limits(motion, limits.including(motion.start), labels)
    except LimitError as exc:
        sentence = str(exc)
        if f"between {PRESENT} and" in sentence and request.approach is None:
            raise LimitError(f"{exc}; {GO_THERE}") from None
        if not request.retime and "the position of" not in sentence:
            raise LimitError(f"{exc}; retime=true slows the motion down until the limits hold") from None
        raise
