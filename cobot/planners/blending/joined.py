"""Blending: joins motions into one that rounds each corner within a radius, without stopping.

At a corner the first path is cut where the TCP enters the radius, and the second where the TCP leaves it. A
quintic in joint space connects the two ends with two continuous derivatives. The whole path is timed at once.
The limits of the first motion apply up to the middle of the blend, and those of the second from there on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cobot.errors import CobotError, InputError, LimitError, PlanningError
from cobot.motions.planners import Way
from cobot.motions.requests import Blended, MotionRequest
from cobot.motions.stretches import Corner, Leg
from cobot.planners.blending.leg_limits import largest, largest_rates, rates
from cobot.planners.held import ALLOWANCE, LOOK_S, MAX_LOOKS, Held
from cobot.planners.path.cartesian import tcp_limits
from cobot.planners.timing.coordinates import Zones
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_motion
from cobot.trajectory import Notice, Trajectory, from_hermite
from cobot.trajectory_parts import cut
from cobot.types import Array

SHARES = (1.0, 0.8, 0.6, 0.4, 0.2, 0.1)
"""Shares of the blend radius. They are tried in this order until a blend is possible."""
BETWEEN_CORNERS, AT_AN_END = 0.49, 0.95
"""Share of a motion that one blend may use: first if the motion is blended at both ends, second if at one end
only.
"""
INSIDE = 0.998
"""Share of the radius within which the samples of a blend must be. The curve between the samples may use
the remaining part.
"""
SAMPLES = 400
MIN_RADIUS_M = 1e-6
"""Minimum blend radius, m. A smaller radius is treated as 0, because no arm is that accurate, and rounding
would determine the blend.
"""
TOLD = 0.9
"""Share of a blend radius. A note reports each blend that uses less of its radius."""


@dataclass(frozen=True, slots=True)
class Part:
    """The motions between two stops, joined into one motion.

    Attributes:
        blended: the joined motion.
        path, progress: the path of the joined motion, and the path parameter over time; None if the arm stops
            at each corner.
    """

    blended: Blended
    path: JointCurve | None = None
    progress: Trajectory | None = None


def leg_of(robot: RobotDescription, request: MotionRequest, motion: Trajectory) -> Leg:
    """A motion together with its limits."""
    of_tcp = tcp_limits(robot, request) if request.traits.way is Way.PATH else None
    return Leg(motion, request.scaled_limits(robot), of_tcp, request.constraints)


def joined(robot: RobotDescription, legs: Sequence[Leg], radii_m: Sequence[float]) -> Blended:
    """One motion through all legs. It stops at a corner without a radius, or where blending is impossible or
    saves no time.

    Args:
        legs: each begins where the previous one ends.
        radii_m: blend radius of each corner, one fewer than legs.

    Raises:
        InputError: the wrong number of radii, or a negative one.
        PlanningError: see `time_optimal`.
    """
    check_radii(legs, radii_m)
    paths = [JointCurve.of_trajectory(leg.motion) for leg in legs]
    corners = corners_of(robot, legs, paths, [0.0, *radii_m, 0.0])
    stops = [index + 1 for index, corner in enumerate(corners) if corner is None]
    whole: Trajectory | None = None
    ends: list[float] = []
    blended: list[bool] = []
    used: list[float] = []
    for begin, end in pairwise([0, *stops, len(legs)]):
        inner = [corner for corner in corners[begin : end - 1] if corner is not None]
        part = part_of(robot, legs[begin:end], paths[begin:end], inner).blended
        since = 0.0 if whole is None else whole.duration_s
        if whole is not None:
            blended.append(False)
            used.append(0.0)
        ends += [since + each for each in part.ends_s]
        blended += part.blended
        used += part.used_m
        whole = part.trajectory if whole is None else whole.followed_by(part.trajectory)
    assert whole is not None
    notes = [whole.note, *radius_notes(radii_m, used)]
    notices = (*whole.notices, *radius_notices(radii_m, used))
    whole = replace(whole, note="; ".join(filter(None, notes)), notices=notices)
    return Blended(whole, tuple(ends), tuple(blended), tuple(used))


def check_radii(legs: Sequence[Leg], radii_m: Sequence[float]) -> None:
    if len(radii_m) != len(legs) - 1:
        raise InputError(f"radii: {len(legs)} motions have {len(legs) - 1} corners, got {len(radii_m)} radii")
    for index, radius in enumerate(radii_m):
        if not 0.0 <= radius < np.inf:
            raise InputError(f"radii[{index}]: is {radius:g} m; it must be 0 or more")


def radius_notes(radii_m: Sequence[float], used_m: Sequence[float]) -> list[str]:
    """Notes on corners that do not use their radius."""
    return [
        f"motion {number}: its blend uses {1e3 * used:.3g} mm of its radius of {1e3 * radius:.4g} mm"
        if used > 0.0
        else f"motion {number}: stops at its end, because no blend is possible within {1e3 * radius:.4g} mm"
        for number, (radius, used) in enumerate(zip(radii_m, used_m, strict=True), start=1)
        if used < TOLD * radius
    ]


def radius_notices(radii_m: Sequence[float], used_m: Sequence[float]) -> list[Notice]:
    """The notes of `radius_notes` in a form for programs."""
    return [
        Notice("radius", {"motion": number, "radius_m": radius, "used_m": used})
        for number, (radius, used) in enumerate(zip(radii_m, used_m, strict=True), start=1)
        if used < TOLD * radius
    ]


def corners_of(
    robot: RobotDescription, legs: Sequence[Leg], paths: Sequence[JointCurve], radii_m: Sequence[float]
) -> list[Corner | None]:
    """The blends between paths; None where the arm must stop.

    Args:
        paths: the path of each leg.
        radii_m: blend radii before the first path, between the paths, and after the last.
    """
    found = []
    for index, (first, second) in enumerate(pairwise(paths), start=1):
        round_ = [radius >= MIN_RADIUS_M for radius in radii_m[index - 1 : index + 2]]
        before, after = (BETWEEN_CORNERS if round_[side] else AT_AN_END for side in (0, 2))
        free = before * first.length, after * second.length
        helds = _held(robot, legs[index - 1]), _held(robot, legs[index])
        found.append(_corner(robot, first, second, radii_m[index], free, helds) if round_[1] else None)
    return found


def _held(robot: RobotDescription, leg: Leg) -> Held | None:
    return None if leg.constraints is None else Held(robot, leg.constraints, leg.motion.start)


def _corner(
    robot: RobotDescription,
    first: JointCurve,
    second: JointCurve,
    radius_m: float,
    free: tuple[float, float],
    helds: tuple[Held | None, Held | None],
) -> Corner | None:
    """The largest blend from `SHARES` that is within the radius and the limits, is collision-free and
    satisfies the constraints.

    The first half of the blend keeps the constraints of the first motion, and the second half keeps those of
    the second motion.
    """
    middle = robot.model.forward(second.at(np.zeros(1))[0]).position
    along = [np.linspace(0.0, most, SAMPLES + 1) for most in free]
    away = [
        _away(robot, middle, path.at(places))
        for path, places in ((first, first.length - along[0]), (second, along[1]))
    ]
    ways = [_within(*each, INSIDE * radius_m) for each in zip(along, away, strict=True)]
    if min(ways) <= 0.0:  # because of rounding, the ends of the motions are farther apart than the radius
        return None
    for share in SHARES:
        before, after = share * ways[0], share * ways[1]
        curve = _curve(first, second, before, after)
        rows = curve.sample(np.linspace(0.0, curve.duration_s, SAMPLES))
        used_m = float(_away(robot, middle, rows).max())
        low, high = robot.limits.min_position, robot.limits.max_position
        if used_m > 0.5 * (1.0 + INSIDE) * radius_m:
            continue
        halves = zip(helds, np.array_split(rows, 2), strict=True)
        if any(held is not None and held.excess(half).max() > ALLOWANCE for held, half in halves):
            continue
        if len(JointCurve(curve.breakpoints_s, curve.coefficients).places_outside(low, high)):
            continue
        try:
            robot.collision.check_trajectory(curve)
        except CobotError:
            continue
        return Corner(curve, before, after, used_m)
    return None


def _away(robot: RobotDescription, middle: Array, rows: Array) -> Array:
    return np.asarray(np.linalg.norm(robot.model.poses(rows)[:, :3] - middle, axis=1))


def _within(places: Array, away: Array, radius_m: float) -> float:
    """The path parameter up to which the TCP stays within the radius; 0 if it starts outside."""
    outside = np.flatnonzero(away > radius_m)
    if not len(outside):
        return float(places[-1])
    index = int(outside[0])
    if index == 0:
        return 0.0
    return float(np.interp(radius_m, away[index - 1 : index + 1], places[index - 1 : index + 1]))


def _curve(first: JointCurve, second: JointCurve, before: float, after: float) -> Trajectory:
    """The blend over the path parameter instead of time."""
    begin, end = first.derivatives(np.array([first.length - before])), second.derivatives(np.array([after]))
    position, velocity, acceleration, _ = np.concatenate([begin, end], axis=1)
    return from_hermite(np.array([0.0, before + after]), position, velocity, acceleration)


def part_of(
    robot: RobotDescription,
    legs: Sequence[Leg],
    paths: Sequence[JointCurve],
    corners: Sequence[Corner],
    *,
    one_law: bool = False,
) -> Part:
    """The motions with all their blends, or with stops if blending is no faster.

    Args:
        one_law: time even a single motion like a path with blends.
    """
    stopping = with_stops(legs)
    if not corners and not one_law:
        return Part(stopping)
    path, zones, middles = path_of(robot, legs, paths, corners)
    limits, of_tcp = largest(robot, legs)
    timed = time_optimal(robot, path, limits, of_tcp, zones)
    if timed.trajectory.duration_s >= stopping.trajectory.duration_s and corners:
        return Part(stopping)
    try:
        check_motion(robot, timed.trajectory, limits)
    except LimitError as exc:
        raise PlanningError(f"round corners: {exc}") from exc
    progress = timed.progress
    reached = np.interp(middles, progress.sample(progress.breakpoints_s)[:, 0], progress.breakpoints_s)
    if any(_breaks(robot, *each) for each in zip(legs, _between(timed.trajectory, reached), strict=True)):
        return Part(stopping)
    trajectory = replace(timed.trajectory, note=stopping.trajectory.note, notices=stopping.trajectory.notices)
    used = tuple(corner.used_m for corner in corners)
    times = (*reached.tolist(), trajectory.duration_s)
    return Part(Blended(trajectory, times, (True,) * len(corners), used), path, progress)


def _between(motion: Trajectory, times_s: Array) -> list[Array]:
    """Samples of a motion, as one array of shape (n, dof) for each part. The given times split the motion
    into parts.
    """
    count = min(MAX_LOOKS, int(motion.duration_s / LOOK_S) + 2)
    looks_s = np.linspace(0.0, motion.duration_s, count)
    return np.split(motion.sample(looks_s), np.searchsorted(looks_s, times_s))


def _breaks(robot: RobotDescription, leg: Leg, rows: Array) -> bool:
    held = _held(robot, leg)
    return held is not None and len(rows) > 0 and bool(held.excess(rows).max() > ALLOWANCE)


def with_stops(legs: Sequence[Leg]) -> Blended:
    """The motions in sequence, with a stop at each corner."""
    whole = legs[0].motion
    ends = [whole.duration_s]
    for leg in legs[1:]:
        whole = whole.followed_by(leg.motion)
        ends.append(whole.duration_s)
    corners = len(legs) - 1
    return Blended(whole, tuple(ends), (False,) * corners, (0.0,) * corners)


def path_of(
    robot: RobotDescription, legs: Sequence[Leg], paths: Sequence[JointCurve], corners: Sequence[Corner]
) -> tuple[JointCurve, Zones, Array]:
    """Return three things: the path with its blends, the zones in which different limits apply, and the path
    parameter in the middle of each blend.
    """
    parts: list[Trajectory] = []
    for index, path in enumerate(paths):
        begin = corners[index - 1].after if index else 0.0
        end = path.length - (corners[index].before if index < len(corners) else 0.0)
        parts.append(cut(Trajectory(path.breakpoints, path.coefficients), begin, end))
        parts += [corner.curve for corner in corners[index : index + 1]]
    ends = np.cumsum([part.duration_s for part in parts])
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.followed_by(part)
    middles = ends[1::2] - 0.5 * np.array([corner.curve.duration_s for corner in corners])
    greatest = largest_rates(robot, legs)
    shares = np.stack([rates(robot, leg) / greatest for leg in legs], axis=1)
    zones = Zones(np.append(middles, ends[-1]), shares)
    return JointCurve(whole.breakpoints_s, whole.coefficients), zones, middles
