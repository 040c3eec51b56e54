"""Reads a FollowJointTrajectory goal from its message and checks it.

The rules are the same as for ros2_control's joint_trajectory_controller; `docs/fjt.md` lists the exceptions.
This module detects all errors in the message itself. Whether the arm can execute the motion is for the
planner to decide.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cobot.errors import ExecutionError, InputError
from cobot.ros.failures import FjtError
from cobot.strict import shown
from cobot.types import Array, JointLimits, Waypoint

SHOWN_NAMES = 10
LATE_START_S = 1.0
"""Maximum age of a goal's header.stamp, s. A goal that is late by less than this starts at once; an older one
is rejected.
"""
EARLIEST_START_S = 600.0
WIDER_PATH = "raise it, or send a slower trajectory"
Message = dict[str, Any]


class GoalError(InputError):
    """Raised if a FollowJointTrajectory goal is invalid. The text gives the reason."""

    error_code: ClassVar = FjtError.INVALID_GOAL


class JointsError(GoalError):
    error_code = FjtError.INVALID_JOINTS


class OldGoalError(GoalError):
    error_code = FjtError.OLD_HEADER_TIMESTAMP


class PathViolated(ExecutionError):
    """Raised if the arm deviates from the path by more than path_tolerance."""

    error_code: ClassVar = FjtError.PATH_TOLERANCE_VIOLATED


class GoalViolated(ExecutionError):
    """Raised if the arm does not reach the goal within goal_tolerance and goal_time_tolerance."""

    error_code: ClassVar = FjtError.GOAL_TOLERANCE_VIOLATED


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Allowed position and velocity error of each joint, shape (dof,), rad and rad/s; infinite where the goal
    sets no tolerance.
    """

    position: Array
    velocity: Array

    def violation(self, position_error: Array, velocity_error: Array, limits: JointLimits) -> str:
        """Describe the joint that exceeds its tolerance the most. Returns "" if all joints are within their
        tolerances.
        """
        for derivative, (error, allowed) in enumerate(
            ((position_error, self.position), (velocity_error, self.velocity))
        ):
            excess = np.abs(error) - allowed
            joint = int(excess.argmax())
            if excess[joint] > 0.0:
                off, limit = abs(error[joint]), allowed[joint]
                unit = limits.unit(joint, derivative)
                return f"{limits.names[joint]} is off by {off:.4g} {unit}, allowed: {limit:.4g}"
        return ""


@dataclass(frozen=True, slots=True)
class FjtGoal:
    """A valid goal.

    Attributes:
        points: trajectory points, with the joints in the robot's order.
        start_s: start time, s since 1970; None to start at once.
        path, end: tolerances along the path and at its end.
        late_s: how long after the time of the last point the arm may arrive, s; infinite if there is no
            limit.
    """

    points: list[Waypoint]
    start_s: float | None
    path: Tolerance
    end: Tolerance
    late_s: float

    def corridor_rad(self, smoothing_rad: float) -> Array:
        """Return how far each joint may deviate from the points. Shape: (dof,), in rad.

        The deviation is at most half the tolerance, because the arm does not follow its plan exactly.
        """
        return np.minimum(smoothing_rad, 0.5 * np.minimum(self.path.position, self.end.position))

    def late(self, planned_s: float) -> str:
        """Return the error message for an arm that has not arrived in time.

        Args:
            planned_s: duration of the planned motion, s.
        """
        bounded = not math.isinf(self.late_s)
        allowed = f" and goal_time_tolerance ({self.late_s:g} s)" if bounded else ""
        way = "; raise goal_time_tolerance, or set it to 0" if bounded else ""
        return (
            "the arm did not arrive within the trajectory's time "
            f"({self.points[-1].time_from_start_s:g} s){allowed}: the motion was planned to take "
            f"{planned_s:.3f} s{way}"
        )


def read_goal(goal: Message, limits: JointLimits, now_s: float) -> FjtGoal:
    """Read the goal in a complete message (see `cobot.ros.messages`).

    Args:
        now_s: the time of day, s since 1970.

    Raises:
        GoalError: the message is invalid. The error has the reason and the action's result code.
    """
    trajectory = goal["trajectory"]
    order = _order(trajectory["joint_names"], limits.names)
    for name in ("component_path_tolerance", "component_goal_tolerance"):
        if goal[name]:
            raise GoalError(f"{name}: must be empty, because no joint has several degrees of freedom")
    multi = goal["multi_dof_trajectory"]
    if multi["points"] or multi["joint_names"]:
        raise GoalError("multi_dof_trajectory: this robot has no joints with several degrees of freedom")
    points = _points(trajectory["points"], order)
    start_s = _start_time(trajectory["header"]["stamp"], points[-1].time_from_start_s, now_s)
    late_s = _seconds(goal["goal_time_tolerance"])
    return FjtGoal(
        points,
        start_s,
        _tolerance(goal["path_tolerance"], limits.names, "path_tolerance"),
        _tolerance(goal["goal_tolerance"], limits.names, "goal_tolerance"),
        late_s if late_s > 0.0 else math.inf,
    )


def _order(given: list[str], names: tuple[str, ...]) -> list[int]:
    """Return the index of each of the robot's joints in the goal's joint_names."""
    if sorted(given) != sorted(names):
        raise JointsError(
            f"joint_names must be {', '.join(names)}, in any order: {_name_errors(given, names)}"
        )
    return [given.index(name) for name in names]


def _name_errors(given: list[str], names: tuple[str, ...]) -> str:
    missing = [name for name in names if name not in given]
    unknown = [name for name in given if name not in names]
    twice = [name for name, count in Counter(given).items() if count > 1 and name in names]
    wrong = [
        f"{verb} {', '.join(map(shown, found[:SHOWN_NAMES]))}"
        for verb, found in (("missing:", missing), ("unknown:", unknown), ("listed twice:", twice))
        if found
    ]
    return "; ".join(wrong)


def _points(messages: list[Message], order: list[int]) -> list[Waypoint]:
    if not messages:
        raise GoalError("the trajectory has no points; cancel the goal to stop")
    times = np.array([_seconds(message["time_from_start"]) for message in messages])
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if len(late):
        index = int(late[0]) + 1
        raise GoalError(
            f"points[{index}]: time_from_start must increase strictly, but it is {times[index]:g} s "
            f"after {times[index - 1]:g} s; {_retimed(times, index)}"
        )
    if times[0] < 0.0:
        raise GoalError(f"points[0]: time_from_start is {times[0]:g} s; it must not be negative")
    for index, message in enumerate(messages):
        if message["effort"]:
            raise GoalError(f"points[{index}]: effort is not supported")
    positions = _rows(messages, "positions", order)
    if positions is None:
        raise GoalError("points[0]: positions are missing; velocities alone are not supported: send both")
    velocities = _rows(messages, "velocities", order)
    accelerations = _rows(messages, "accelerations", order)
    if accelerations is not None and velocities is None:
        raise GoalError("points[0]: accelerations without velocities are not supported: send both")
    if velocities is not None and accelerations is None:
        accelerations = hermite_accelerations(times, positions, velocities)
    # the arm is at rest there; MoveIt sends velocities for both ends of its motions
    if accelerations is not None:
        accelerations[-1] = 0.0
        if times[0] == 0.0:
            accelerations[0] = 0.0
    rows = [[None] * len(times) if row is None else row.tolist() for row in (velocities, accelerations)]
    named = [f"points[{index}]" for index in range(len(times))]
    return [
        Waypoint(*values) for values in zip(positions.tolist(), times.tolist(), *rows, named, strict=True)
    ]


def _rows(messages: list[Message], name: str, order: list[int]) -> Array | None:
    """Read one quantity from all points; None if the points do not contain it. Shape: (n, dof), with the
    joints in the robot's order.
    """
    rows = [message[name] for message in messages]
    if not any(rows):
        return None
    for index, row in enumerate(rows):
        if not row and name != "positions":
            having = next(place for place, each in enumerate(rows) if each)
            raise GoalError(
                f"points[{index}] has no {name}, but points[{having}] does: give {name} at all points or "
                "at none"
            )
        if len(row) != len(order):
            raise GoalError(f"points[{index}]: {name} must be {len(order)} numbers, got {len(row)}")
    values = np.array(rows, dtype=np.float64)
    if not np.isfinite(values).all():
        index, joint = np.argwhere(~np.isfinite(values))[0]
        raise GoalError(f"points[{index}]: {name}[{joint}] is not a finite number")
    return np.asarray(values[:, order])


def _retimed(times: Array, index: int) -> str:
    """Suggest how to correct a point whose time is not later than the time of the previous point."""
    if not times.any():
        return "all times are 0: add a time parameterization (MoveIt has an adapter for it)"
    return "leave the point out" if times[index] == times[index - 1] else "order the points by their times"


def hermite_accelerations(times_s: Array, positions: Array, velocities: Array) -> Array:
    """Calculate the accelerations at points whose velocities are known. They result from the cubics between
    the points. Shape: (n, dof).

    Where two cubics meet, the result is the mean of their accelerations, because the acceleration of a cubic
    Hermite spline jumps there. At both ends the acceleration is 0, because the arm is at rest there.
    """
    accelerations = np.zeros_like(positions)
    if len(times_s) > 2:
        step = np.diff(times_s)[:, None]
        slope = np.diff(positions, axis=0) / step
        ends = (2.0 * velocities[:-1] + 4.0 * velocities[1:] - 6.0 * slope) / step
        begins = (6.0 * slope - 4.0 * velocities[:-1] - 2.0 * velocities[1:]) / step
        accelerations[1:-1] = 0.5 * (ends[:-1] + begins[1:])
    return accelerations


def _start_time(stamp: Message, duration_s: float, now_s: float) -> float | None:
    start_s = _seconds(stamp)
    if start_s == 0.0:
        return None
    if start_s < now_s - LATE_START_S:
        end = "ended" if start_s + duration_s < now_s else "begun"
        raise OldGoalError(
            f"header.stamp: the trajectory should have {end} {now_s - start_s:.3f} s ago, allowed: "
            f"{LATE_START_S:g} s; with a stamp of 0 it begins at once"
        )
    if start_s > now_s + EARLIEST_START_S:
        raise GoalError(
            f"header.stamp is {start_s - now_s:.0f} s in the future, allowed: {EARLIEST_START_S:g} s; "
            "check that both clocks agree"
        )
    return start_s


def _tolerance(messages: list[Message], names: tuple[str, ...], field: str) -> Tolerance:
    """Read the tolerances in a message. In ROS, 0 means the default and -1 means no tolerance; both are
    returned as infinity.
    """
    made = Tolerance(np.full(len(names), math.inf), np.full(len(names), math.inf))
    for index, message in enumerate(messages):
        if message["name"] not in names:
            raise JointsError(
                f"{field}[{index}]: there is no joint {shown(message['name'])}; "
                f"valid names: {', '.join(names)}"
            )
        joint = names.index(message["name"])
        for row, name in ((made.position, "position"), (made.velocity, "velocity"), (None, "acceleration")):
            value = message[name]
            if not math.isfinite(value) or (value < 0.0 and value != -1.0):
                raise GoalError(f"{field}[{index}]: {name} must be -1, 0 or a positive number, got {value:g}")
            if value > 0.0 and row is None:
                raise GoalError(
                    f"{field}[{index}]: accelerations are not measured, so they cannot have a tolerance"
                )
            if value > 0.0 and row is not None:
                row[joint] = value
    return made


def _seconds(time: Message) -> float:
    return float(time["sec"] + 1e-9 * time["nanosec"])
