"""Motions appended to a running motion, without a stop. The part that rtloop already has does not change.

The motions since the last stop are joined again together with the new ones, see `joined`. The old and the new
motion have the same path up to the corner where the old one ended, and nearly the same timing until the old
one slows down for its end. In a window before that corner the timing changes from the old motion's to the new
motion's. Before the window the result equals the old motion bit for bit; after the window it equals the new
motion. If no window stays within the limits because the arm is too near the end, the arm stops there and
continues immediately.

A motion that can be extended keeps a small reserve for the window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from cobot.errors import InputError, PlanningError
from cobot.motions.stretches import Corner, Leg, Stretch
from cobot.planners.blending.going_over import LimitedPath, PathTiming, make_transition
from cobot.planners.blending.joined import Part, check_radii, corners_of, part_of, with_stops
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import with_room
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.trajectory_parts import remainder_at

RESERVE = (0.998, 0.98, 0.92)
"""Shares of the velocity, acceleration and jerk limits that a motion uses if it can be extended."""
KEPT_S = 3.0
"""Motions that ended more than this time ago, s, are not joined again, because the new motions do not depend
on them.
"""


def begin_stretch(robot: RobotDescription, legs: Sequence[Leg], radii_m: Sequence[float]) -> Stretch:
    """Join motions, beginning at rest. The arm stops where the radius is 0 or blending is impossible.

    Args:
        legs: each begins where the previous one ends.
        radii_m: blend radius at the end of each leg, the last one included.

    Raises:
        InputError: see `joined`.
    """
    check_radii(legs, radii_m[:-1])
    return _following(robot, None, legs, radii_m)


def extend_stretch(
    robot: RobotDescription,
    under_way: Stretch,
    legs: Sequence[Leg],
    radii_m: Sequence[float],
    now_s: float,
    from_s: float,
) -> Stretch:
    """Append motions to a running motion, without changing it before `from_s`; see `begin_stretch`.

    Args:
        now_s: current path time; the result leaves out the part before this time.
        from_s: path time before which nothing changes.
    """
    check_radii(legs, radii_m[:-1])
    found = None
    if under_way.radii_m[-1] > 0.0 and under_way.progress is not None:
        found = _rounded(robot, under_way, legs, radii_m, max(from_s, under_way.valid_s))
    if found is None:
        found = _following(robot, under_way, legs, radii_m)
    left, offset_s = remainder_at(found.trajectory, now_s)
    ends = [end_s - offset_s for end_s in found.ends_s]
    over = min(sum(end_s <= 0.0 for end_s in ends), len(ends) - len(found.legs))
    return replace(
        found,
        trajectory=left,
        ends_s=tuple(ends[over:]),
        since_s=found.since_s - offset_s,
        valid_s=found.valid_s - offset_s,
        offset_s=offset_s,
    )


def _following(
    robot: RobotDescription, before: Stretch | None, legs: Sequence[Leg], radii_m: Sequence[float]
) -> Stretch:
    """Join several motions to one. It begins at rest, at the end of `before` if that is given."""
    paths = [JointCurve.of_trajectory(leg.motion) for leg in legs]
    corners = corners_of(robot, legs, paths, [0.0, *radii_m])
    stops = [index for index, corner in enumerate(corners, start=1) if corner is None]
    used: list[float] = []
    for begin, end in pairwise([0, *stops, len(legs)]):
        inner = [corner for corner in corners[begin : end - 1] if corner is not None]
        more = radii_m[end - 1] > 0.0
        part = _part(robot, legs[begin:end], paths[begin:end], inner, reserve=more, one_law=more)
        used += [0.0, *part.blended.used_m]
        since_s = 0.0 if before is None else before.trajectory.duration_s
        whole = part.blended.trajectory
        before = Stretch(
            whole if before is None else before.trajectory.followed_by(whole),
            (*(before.ends_s if before else ()), *(since_s + end_s for end_s in part.blended.ends_s)),
            tuple(used),
            tuple(legs[begin:end]),
            tuple(radii_m[begin:end]),
            tuple(inner),
            part.progress,
            since_s,
            since_s,
        )
    assert before is not None
    return before


def _part(
    robot: RobotDescription,
    legs: Sequence[Leg],
    paths: Sequence[JointCurve],
    corners: Sequence[Corner],
    *,
    reserve: bool,
    one_law: bool,
) -> Part:
    """The motions, without stops where possible.

    A very short leg also gets stops, because rounding can look like jumps in the segments of its path.
    """
    slower = [_reserved(robot, leg) for leg in legs] if reserve else legs
    try:
        return part_of(robot, slower, paths, corners, one_law=one_law)
    except (PlanningError, InputError):
        return Part(with_stops(legs))


def _reserved(robot: RobotDescription, leg: Leg) -> Leg:
    of_tcp = None if leg.tcp is None else leg.tcp.scaled(*RESERVE)
    return replace(leg, limits=with_room(robot, leg.limits).scaled(*RESERVE), tcp=of_tcp)


def _rounded(
    robot: RobotDescription, under_way: Stretch, legs: Sequence[Leg], radii_m: Sequence[float], from_s: float
) -> Stretch | None:
    """The motions without a stop at the end of the running motion; None if that is impossible."""
    left_out = _left_out(under_way, from_s)
    all_legs = [*under_way.legs[left_out:], *legs]
    radii = [*under_way.radii_m[left_out:], *radii_m]
    paths = [JointCurve.of_trajectory(leg.motion) for leg in all_legs]
    old = len(all_legs) - len(legs)
    radius_before = under_way.radii_m[-2] if len(under_way.radii_m) > 1 else 0.0
    ahead = corners_of(robot, all_legs[old - 1 :], paths[old - 1 :], [radius_before, *radii[old - 1 :]])
    count = ahead.index(None) if None in ahead else len(ahead)
    corners = [*under_way.corners[left_out:], *(corner for corner in ahead[:count] if corner is not None)]
    end = old + count
    part = _part(robot, all_legs[:end], paths[:end], corners, reserve=True, one_law=True)
    if count == 0 or part.progress is None:
        return None
    until = sum(path.length for path in paths[:old]) - corners[len(corners) - count].before
    course = LimitedPath.of(robot, all_legs[:end], paths[:end], corners)
    timing = PathTiming(part.blended.trajectory, part.progress)
    found = make_transition(robot, course, _timing(under_way, left_out), timing, until, from_s)
    if found is None:
        return None
    whole, since_s, valid_s = found
    over = len(under_way.ends_s) - old
    before: list[float] = [end_s for end_s in under_way.ends_s[over:] if end_s < from_s]
    after = [since_s + end_s for end_s in part.blended.ends_s[len(before) :]]
    stretch = Stretch(
        trajectory=whole,
        ends_s=(*under_way.ends_s[:over], *before, *after),
        used_m=part.blended.used_m[-count:],
        legs=tuple(all_legs[:end]),
        radii_m=tuple(radii[:end]),
        corners=tuple(corners),
        progress=part.progress,
        since_s=since_s,
        valid_s=valid_s,
    )
    if end == len(all_legs):
        return stretch
    following = _following(robot, stretch, all_legs[end:], radii[end:])
    return replace(following, used_m=(*stretch.used_m, *following.used_m))


def _timing(under_way: Stretch, left_out: int) -> PathTiming:
    """The timing of the running motion, on the path without its first motions."""
    progress = under_way.progress
    assert progress is not None
    coefficients = progress.coefficients.copy()
    coefficients[:, :, 0] -= sum(
        JointCurve.of_trajectory(leg.motion).length for leg in under_way.legs[:left_out]
    )
    shorter = Trajectory(progress.breakpoints_s, coefficients)
    return PathTiming(under_way.trajectory, shorter, under_way.since_s)


def _left_out(under_way: Stretch, from_s: float) -> int:
    """The number of motions, counted from the last stop, that do not have to be joined again."""
    assert under_way.progress is not None
    place = float(under_way.progress.sample([from_s - under_way.since_s])[0, 0])
    ends = under_way.ends_s[len(under_way.ends_s) - len(under_way.legs) :]
    begins, count = 0.0, 0
    for leg, end_s, corner in zip(under_way.legs, ends, under_way.corners, strict=False):
        begins += JointCurve.of_trajectory(leg.motion).length
        if end_s > from_s - KEPT_S or place <= begins + corner.after:
            break
        count += 1
    return count
