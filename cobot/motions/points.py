"""Motions through timed points, and the checks that the points must pass."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot.errors import InputError
from cobot.robot.limits import check_positions
from cobot.types import Array, JointLimits, Scaling, Waypoint

REST_TOLERANCE = 1e-6
MIN_INTERVAL_S, MAX_TIME_S = 1e-9, 1e6
"""Minimum time between two points, and maximum time of the last point. They only prevent a numeric
overflow.
"""
MAX_NUMBER = 1e6
"""Maximum absolute value of a position, velocity or acceleration of a point. It prevents a numeric
overflow.
"""


@dataclass(frozen=True, slots=True)
class WaysOut:
    """Advice for error messages about timed points, phrased for the client's interface.

    Attributes:
        start: advice if the points do not begin at the arm's position.
        rates: advice if the points are too fast and the client can request a slower motion.
        time: advice if the motion takes longer than the client permits; `{late_s}` is the excess, s.
    """

    start: str
    rates: str = ""
    time: str = ""


REST = WaysOut(
    "move there first, or send move_to_start=true (on the command line: --move-to-start)",
    "retime=true slows the motion down until the limits hold",
)
FOLLOW_JOINT_TRAJECTORY = WaysOut(
    "move there first, or give the first point a time_from_start above 0, so that the arm moves there from "
    "its current position",
    time="raise goal_time_tolerance to {late_s:.3f} s, or set it to 0 to accept any duration",
)


@dataclass(frozen=True, slots=True)
class WaypointRequest:
    """A motion through timed points.

    Attributes:
        start: the arm's joint positions, shape (dof,), rad.
        points: the timed points.
        start_tolerance_rad: maximum distance between `start` and a first point at time 0, rad.
        check_limits: whether the position, velocity, acceleration and jerk limits are checked. Collisions are
            always checked.
        retime: whether the motion is slowed down until it keeps the rate limits, instead of being rejected.
        corridor_rad: maximum deviation of each joint from the curve through the points if it violates the
            limits, shape (dof,) or one value for all joints. 0 means that the curve is kept, and the whole
            motion is slowed down.
        longest_s: maximum duration after `retime`, s, without `approach`.
        approach: scaling of a ptp motion to the first point; None means that the first point must be at
            `start`.
        ways: advice for error messages.
    """

    start: Array
    points: Sequence[Waypoint]
    start_tolerance_rad: float
    check_limits: bool = True
    retime: bool = False
    approach: Scaling | None = None
    corridor_rad: Array | float = 0.0
    longest_s: float = math.inf
    ways: WaysOut = REST


def check_first(
    point: Waypoint, start: Array, limits: JointLimits, tolerance_rad: float, *, within_limits: bool
) -> None:
    """Check the first point before the other points are read; see `WaypointRequest`.

    Raises:
        InputError: the first point is at time 0 but is not the arm's current position.
        LimitError: the point is beyond the position limits.
    """
    (label,) = labels_of([point], limits.dof)
    positions = np.asarray(point.positions, dtype=np.float64)
    if within_limits:
        check_positions(limits, positions, f"{label}: angle")
    if point.time_from_start_s == 0.0:
        require_start(positions, start, limits, tolerance_rad, label)


def require_positions(points: Sequence[Waypoint], limits: JointLimits, labels: list[str]) -> None:
    """Check all positions in a single comparison, because there may be many."""
    positions = np.array([point.positions for point in points], dtype=np.float64)
    within = (limits.min_position <= positions) & (positions <= limits.max_position)
    for index in np.flatnonzero(~within.all(axis=1))[:1]:
        check_positions(limits, positions[index], f"{labels[index]}: angle")


def labels_of(points: Sequence[Waypoint], dof: int) -> list[str]:
    """The name of each point for error messages.

    Raises:
        InputError: there are no points, or a point does not have one number per joint.
    """
    if not points:
        raise InputError("points: at least one is needed")
    labels = [point.label or f"point {index + 1}" for index, point in enumerate(points)]
    for point, label in zip(points, labels, strict=True):
        for name in ("positions", "velocities", "accelerations"):
            values = getattr(point, name)
            if values is not None and len(values) != dof:
                raise InputError(f"{label}: {name} must have {dof} numbers, got {len(values)}")
    return labels


def require_size(points: Sequence[Waypoint], labels: list[str]) -> None:
    """Check that no number exceeds `MAX_NUMBER`. This also applies to motions for which the limits are not
    checked.

    Raises:
        InputError: a number exceeds it; the message names the first point with such a number.
    """
    for name in ("positions", "velocities", "accelerations"):
        given = [(label, getattr(point, name)) for label, point in zip(labels, points, strict=True)]
        given = [(label, values) for label, values in given if values is not None]
        if not given:
            continue
        sizes = np.abs(np.array([values for _, values in given], dtype=np.float64)).max(axis=1)
        for index in np.flatnonzero(sizes > MAX_NUMBER)[:1]:
            raise InputError(f"{given[index][0]}: {name} may be up to {MAX_NUMBER:g}, got {sizes[index]:g}")


def require_order(times: Array, labels: list[str]) -> None:
    """Check that times are from 0 to `MAX_TIME_S` s and increase by at least `MIN_INTERVAL_S` s.

    Raises:
        InputError: a time violates this; the message names the first point with such a time.
    """
    if times[0] < 0.0:
        raise InputError(f"{labels[0]}: time_from_start is {times[0]} s; it must not be negative")
    if 0.0 < times[0] < MIN_INTERVAL_S:
        raise InputError(
            f"{labels[0]}: time_from_start is {times[0]} s; it must be 0 or at least {MIN_INTERVAL_S:g} s"
        )
    for index in np.flatnonzero(times > MAX_TIME_S)[:1]:
        raise InputError(
            f"{labels[index]}: time_from_start is {times[index]} s, allowed: up to {MAX_TIME_S:g} s"
        )
    late = np.flatnonzero(np.diff(times) < MIN_INTERVAL_S / 2.0)  # half, because large times are rounded
    if len(late):
        index = int(late[0]) + 1
        raise InputError(
            f"{labels[index]}: time_from_start is {times[index]} s; it must be at least "
            f"{MIN_INTERVAL_S:g} s later than the {times[index - 1]} s of {labels[index - 1]}"
        )


def require_rest(points: Sequence[Waypoint], labels: list[str], *, first: bool) -> None:
    for index in [0, -1] if first else [-1]:
        for name, values in (
            ("velocities", points[index].velocities),
            ("accelerations", points[index].accelerations),
        ):
            if values is not None and np.abs(np.asarray(values)).max() > REST_TOLERANCE:
                end = "start" if index == 0 else "end"
                joint = int(np.abs(np.asarray(values)).argmax())
                raise InputError(
                    f"{labels[index]}: the motion must {end} at rest, but its {name} are not 0: "
                    f"{name}[{joint}] is {values[joint]:g}; send 0 there, or no {name} at all"
                )


def require_start(
    first: Array, start: Array, limits: JointLimits, tolerance_rad: float, label: str, ways: WaysOut = REST
) -> None:
    off = np.abs(first - start)
    if off.max() <= tolerance_rad:
        return
    joint = int(off.argmax())
    unit = limits.unit(joint)
    raise InputError(
        f"{label}: starts with {limits.names[joint]} at {first[joint]:.4f} {unit}, but the arm is at "
        f"{start[joint]:.4f} {unit}: {off[joint]:.4f} {unit} apart, allowed: {tolerance_rad:g} {unit}; "
        f"{ways.start}"
    )
