"""A course: timed points as arrays, with a name for each, and the curve through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cobot.errors import InputError
from cobot.motions.points import (
    REST,
    WaysOut,
    labels_of,
    require_order,
    require_rest,
    require_size,
    require_start,
)
from cobot.trajectory import CHANGE_PEAKS, UNCHANGED, Changes, Trajectory, from_hermite
from cobot.types import Array, JointLimits, Waypoint

PRESENT = "the current position"
BLEND_SHARE = 0.05
"""Share of each limit that blending out an offset may use, if the motion is long enough."""
TELL_RAD = 1e-6
"""Offsets at the start that are smaller than this are not reported: no encoder can measure them."""


@dataclass(frozen=True, slots=True)
class WaypointCourse:
    """The points of a waypoint motion as arrays. They include the current position if it had to be added.

    Attributes:
        times_s, positions: times, shape (n,), and joint positions, shape (n, dof), rad, of the points.
        labels: name of each point for error messages.
        points: the points of the request, which may specify velocities and accelerations.
        changes: the offset that was blended out.
    """

    times_s: Array
    positions: Array
    labels: list[str]
    points: Sequence[Waypoint]
    changes: Changes = UNCHANGED

    def motion(self) -> Trajectory:
        """The curve through the points, with a quintic between each pair of neighbours."""
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(self.times_s, self.positions, bc_type="clamped")
        velocities, accelerations = spline(self.times_s, 1), spline(self.times_s, 2)
        accelerations[[0, -1]] = 0.0
        for index, point in enumerate(self.points):
            if point.velocities is not None:
                velocities[index] = point.velocities
            if point.accelerations is not None:
                accelerations[index] = point.accelerations
        motion = from_hermite(self.times_s, self.positions, velocities, accelerations)
        blended = self.changes
        if blended.blended_rad <= TELL_RAD:
            return motion
        note = (
            f"the arm was {blended.blended_rad:.1e} rad away from the first point; this is blended out "
            f"within {blended.blended_s:.3f} s"
        )
        return replace(motion, note=note, changes=blended)

    @property
    def given_rates(self) -> bool:
        return any(p.velocities is not None or p.accelerations is not None for p in self.points)


def course_of(
    points: Sequence[Waypoint],
    start: Array,
    limits: JointLimits,
    start_tolerance_rad: float,
    ways: WaysOut = REST,
) -> WaypointCourse:
    """Create the course of the given points. Arguments and errors are the same as for `through`."""
    labels = labels_of(points, limits.dof)
    times = np.array([point.time_from_start_s for point in points])
    positions = np.array([point.positions for point in points], dtype=np.float64)
    require_order(times, labels)
    require_size(points, labels)
    require_rest(points, labels, first=times[0] == 0.0)
    if times[-1] == 0.0:
        raise InputError(f"{labels[0]}: a motion needs a point with a time_from_start above 0")
    if times[0] == 0.0:
        require_start(positions[0], start, limits, start_tolerance_rad, labels[0], ways)
        return _blended(WaypointCourse(times, positions, labels, points), start, limits)
    times, positions = np.append(0.0, times), np.vstack([start, positions])
    return WaypointCourse(times, positions, [PRESENT, *labels], [Waypoint(start.tolist(), 0.0), *points])


def through(
    points: Sequence[Waypoint], start: Array, limits: JointLimits, start_tolerance_rad: float
) -> tuple[Trajectory, list[str]]:
    """Quintics that pass through the points at the points' times. The motion begins and ends at rest.

    If the first point is at time 0, it must be the arm's current position. A small offset is blended out over
    the first points. If the first time is later, the current position is added as a point at time 0. If a
    point does not specify its velocity or acceleration, the clamped cubic spline through all points defines
    it.

    Returns:
        The trajectory, and a name for each of its breakpoints.

    Raises:
        InputError: no points, times that do not increase, a start elsewhere, or ends that are not at rest.
    """
    course = course_of(points, start, limits, start_tolerance_rad)
    return course.motion(), course.labels


def _blended(course: WaypointCourse, start: Array, limits: JointLimits) -> WaypointCourse:
    """The course, beginning at the arm's current position. The quintic with the least jerk fades out the
    offset.
    """
    offset = start - course.positions[0]
    off = np.abs(offset)
    if not off.any():
        return course
    bounds = (limits.max_velocity, limits.max_acceleration, limits.max_jerk)
    needed = [
        float((peak * off / (BLEND_SHARE * bound)).max()) ** (1.0 / order)
        for order, (peak, bound) in enumerate(zip(CHANGE_PEAKS, bounds, strict=True), start=1)
    ]
    duration_s = min(max(needed), float(course.times_s[-1]))
    count = int(np.searchsorted(course.times_s, duration_s))
    s = course.times_s[:count] / duration_s
    left = [
        1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        -30.0 * s**2 * (1.0 - s) ** 2 / duration_s,
        -60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration_s**2,
    ]
    positions = course.positions.copy()
    positions[:count] += left[0][:, None] * offset
    positions[0] = start
    shifted = [
        replace(
            point,
            velocities=_sum(point.velocities, left[1][index] * offset),
            accelerations=_sum(point.accelerations, left[2][index] * offset),
        )
        for index, point in enumerate(course.points[:count])
    ]
    changes = Changes(blended_rad=float(off.max()), blended_s=duration_s)
    return replace(course, positions=positions, points=[*shifted, *course.points[count:]], changes=changes)


def _sum(rates: Sequence[float] | None, change: Array) -> list[float] | None:
    return None if rates is None else (np.asarray(rates) + change).tolist()
