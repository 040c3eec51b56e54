"""Timed joint waypoints: a motion through all of them, with two continuous derivatives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cobot.errors import LimitError
from cobot.motions.points import WaypointRequest, labels_of, require_positions
from cobot.motions.requests import MotionRequest
from cobot.planners.goals import is_there
from cobot.planners.ptp import plan_ptp
from cobot.planners.timing.course import PRESENT, WaypointCourse, course_of, through
from cobot.planners.timing.rounding import smoothed
from cobot.planners.timing.timed_fit import AS_ASKED, Fitted, fitted
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import (
    check_efforts,
    check_limits,
    check_motion,
    in_range,
    stretch_to_efforts,
    stretch_to_limits,
)
from cobot.trajectory import Changes, Trajectory
from cobot.types import Array, JointLimits, PlannerName

__all__ = ["plan_waypoints", "through"]

UNASKED_STRETCH = 1.05
"""Maximum factor by which a motion may take longer than its points specify, without the client's permission.
"""
ASIDE = 0.1
"""Share of the delay at each end that is left out when the slow interval is reported."""
FEW = 5_000
"""With more points than this, slowing down evenly is not tried first, because it takes a long time."""


def plan_waypoints(robot: RobotDescription, request: WaypointRequest) -> Trajectory:
    """Plan and validate a motion. Its `note` and `changes` report deviations from the points.

    If the points exceed the rate limits, their rounding is removed first, see `rounding`. If that is not
    enough, the motion deviates within the request's corridor, see `timed_fit`; without a corridor, the whole
    motion is slowed down evenly if the request permits this. If the motion then exceeds the drives' efforts,
    with the load, it is slowed down evenly too.

    Raises:
        InputError: the points do not define a motion; see `through`.
        LimitError: a limit is exceeded; the message names the points, or the position of an excessive effort.
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
    course = course_of(request.points, start, limits, tolerance_rad, request.ways)
    if request.check_limits or request.retime:
        motion = _within_limits(course, limits.including(start), request)
        motion = _within_efforts(robot, motion, float(course.times_s[-1]), request)
    else:
        motion = course.motion()
    robot.collision.check_trajectory(motion)
    if request.approach is None or is_there(request.start, motion.start):
        return motion
    approach = MotionRequest(request.start, motion.start, PlannerName.PTP, request.approach)
    first = plan_ptp(robot, approach, motion.start)
    check_motion(robot, first, approach.scaled_limits(robot))
    return first.followed_by(motion)


def _within_limits(course: WaypointCourse, limits: JointLimits, request: WaypointRequest) -> Trajectory:
    """The motion through the points if it stays within the limits, otherwise the nearest motion that does.

    Raises:
        LimitError: no motion that the request permits stays within the limits.
    """
    asked = motion = course.motion()
    excess = _excess(motion, limits, course.labels)
    if excess is None:
        return motion
    corridor = np.broadcast_to(np.asarray(request.corridor_rad, dtype=np.float64), limits.dof)
    has_corridor = bool((corridor > 0.0).all())
    cleaned = None if course.given_rates else _without_rounding(course, motion)
    if cleaned is not None and (not has_corridor or cleaned.changes.smoothed_rad <= corridor.min()):
        motion, excess = cleaned, _excess(cleaned, limits, course.labels)
        if excess is None:
            return motion
    longest_s = _longest_s(request, motion.duration_s)
    changed = None
    if has_corridor:
        changed = _follow(asked, motion, limits, corridor, longest_s, excess)
    elif request.retime:
        changed = _slow_evenly(motion, limits)
    if changed is None or changed.duration_s > longest_s:
        raise _with_advice(excess, asked.duration_s, changed, request)
    left = _excess(changed, limits, course.labels if changed.segments == motion.segments else None)
    if left is not None and request.check_limits:
        raise _with_advice(left, asked.duration_s, None, request)
    return changed


def _within_efforts(
    robot: RobotDescription, motion: Trajectory, asked_s: float, request: WaypointRequest
) -> Trajectory:
    """The motion, slowed down evenly if the drives are too weak for it.

    Raises:
        LimitError: slowing down does not help, or takes longer than the request permits.
    """
    try:
        check_efforts(robot.model, motion, robot.limits)
    except LimitError as exc:
        excess = exc
    else:
        return motion
    slower = stretch_to_efforts(robot.model, motion, robot.limits)
    if slower is not None and slower.duration_s <= _longest_s(request, asked_s):
        return _with_even_note(motion, slower, f": {excess}")
    if not request.check_limits:
        return motion
    if slower is None:
        raise LimitError(
            f"{excess}; slowing down does not help, because even holding the arm needs too much effort"
        ) from excess
    raise _with_advice(excess, asked_s, slower, request) from excess


def _longest_s(request: WaypointRequest, asked_s: float) -> float:
    return request.longest_s if request.retime else UNASKED_STRETCH * asked_s


def _excess(motion: Trajectory, limits: JointLimits, labels: list[str] | None) -> LimitError | None:
    try:
        check_limits(motion, limits, labels)
    except LimitError as exc:
        return exc
    return None


def _without_rounding(course: WaypointCourse, motion: Trajectory) -> Trajectory | None:
    """The motion through the points after their rounding errors are removed; None if no rounding is
    recognisable.
    """
    found = smoothed(course.times_s, course.positions)
    if found is None:
        return None
    positions, unit = found
    off_rad = float(np.abs(positions - course.positions).max())
    note = (
        f"the points were smoothed by up to {off_rad:.1e} rad, within their rounding of {unit:.0e} rad, "
        "because the jerk of the rounding exceeds the limits"
    )
    cleaned = replace(course, positions=positions).motion()
    return _with_note(cleaned, note, replace(motion.changes, smoothed_rad=off_rad))


def _follow(
    asked: Trajectory,
    cleaned: Trajectory,
    limits: JointLimits,
    corridor: Array,
    longest_s: float,
    excess: LimitError,
) -> Trajectory:
    """The shorter of two motions: the requested motion within a corridor, or the cleaned motion, slowed down
    evenly.
    """
    inside = in_range(cleaned, limits)  # slowing down cannot bring a joint back into its range
    even = _slow_evenly(cleaned, limits) if asked.segments <= FEW else None
    if even is not None and inside and even.duration_s <= AS_ASKED * asked.duration_s:
        return even
    found = fitted(asked, limits, corridor, longest_s)
    if found is None or found.motion.duration_s > UNASKED_STRETCH * asked.duration_s:
        even = even or _slow_evenly(cleaned, limits)
        if found is None or (inside and found.motion.duration_s >= even.duration_s):
            return even
    slowed_s = _slow_interval(found, asked.duration_s)
    changes = replace(
        asked.changes,
        smoothed_rad=found.off_rad,
        stretch=found.motion.duration_s / asked.duration_s,
        slowed_s=slowed_s,
    )
    note = f"the motion deviates by up to {found.off_rad:.1e} rad from the curve through the points"
    if slowed_s is not None:
        note += (
            f" and takes {found.motion.duration_s:.3f} s instead of {asked.duration_s:.3f} s, "
            f"slower from {slowed_s[0]:.3f} s to {slowed_s[1]:.3f} s"
        )
    return _with_note(replace(found.motion, note=asked.note), f"{note}: {excess}", changes)


def _slow_evenly(motion: Trajectory, limits: JointLimits) -> Trajectory:
    slower = stretch_to_limits(motion, limits)
    return motion if slower is motion else _with_even_note(motion, slower)


def _with_even_note(motion: Trajectory, slower: Trajectory, why: str = "") -> Trajectory:
    """The motion that was slowed down evenly, with a note about the slowdown."""
    asked_s = motion.duration_s / motion.changes.stretch
    changes = replace(motion.changes, stretch=slower.duration_s / asked_s, slowed_s=(0.0, asked_s))
    note = f"the whole motion was slowed down from {motion.duration_s:.3f} s to {slower.duration_s:.3f} s"
    return _with_note(slower, note + why, changes)


def _slow_interval(found: Fitted, duration_s: float) -> tuple[float, float] | None:
    """The interval in which the motion becomes late, compared with the requested times of the points. A small
    part at each end is cut off. None if the motion is not late.
    """
    late_s = found.motion.duration_s - duration_s
    if late_s <= (AS_ASKED - 1.0) * duration_s:
        return None
    behind_s = found.motion.breakpoints_s - found.times_s
    begin = int(np.argmax(behind_s > ASIDE * late_s))
    end = int(np.argmax(behind_s >= (1.0 - ASIDE) * late_s))
    return float(found.times_s[begin]), float(found.times_s[max(end, begin)])


def _with_note(motion: Trajectory, note: str, changes: Changes) -> Trajectory:
    return replace(motion, note="; ".join(filter(None, (motion.note, note))), changes=changes)


def _with_advice(
    excess: LimitError, asked_s: float, possible: Trajectory | None, request: WaypointRequest
) -> LimitError:
    """The error with advice on how to stay within the limits, and with the duration that the motion would
    then have.
    """
    sentence = str(excess)
    if f"between {PRESENT} and" in sentence and request.approach is None and not request.retime:
        return LimitError(f"{sentence}; {request.ways.start}")
    if "the position of" in sentence:
        return excess
    takes = "" if possible is None else f"{possible.duration_s:.3f} s instead of {asked_s:.3f} s"
    if not request.retime:
        return LimitError(f"{sentence}; {request.ways.rates}" + (f" ({takes})" if takes else ""))
    if possible is None:
        return excess
    late_s = math.ceil(1e3 * (possible.duration_s - asked_s)) / 1e3
    way = f": {request.ways.time.format(late_s=late_s)}" if request.ways.time else ""
    allowed = f"up to {request.longest_s:.3f} s are allowed{way}"
    return LimitError(f"{sentence}; within the limits it takes {takes}, and {allowed}")
