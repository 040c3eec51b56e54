"""A smooth joint path through joint angles at points of a TCP path. Between these points it also follows the
TCP path.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.errors import UnreachableError
from cobot.findings import Finding
from cobot.planners.path.tcp_path import TcpPath, angles_between
from cobot.planners.timing.path import JointCurve, spline_through
from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits

MAX_DEVIATION_M = 5e-5
MAX_DEVIATION_RAD = np.radians(0.01)
PATH_SHARE = 0.4
"""Share of the allowed deviation that the joint path may use. The remaining part is for the time
parameterization.
"""
POSE_SHARE = 0.5 * PATH_SHARE
"""Share of the allowed deviation at the points themselves, for an arm that reaches most poses
approximately.
"""
BETWEEN = np.array([0.25, 0.5, 0.75])
"""Points within each interval at which the deviation is checked, as shares of the interval."""
AT_ENDS = np.array([0.03, 0.08, 0.15])
"""Additional points that are checked, because a spline overshoots there first. They are measured from the
path's beginning in the first interval, and from its end in the last one.
"""
EVEN_STEP_RAD = 0.25
"""If the joints turn further than this between evenly spaced points, the parameter is the distance in joint
space instead.
"""
EVEN_SHARE = 1e-9
"""Maximum difference between the steps of evenly spaced points, as a share of the path."""
MAX_STEP_RAD = 0.12
THIN = 0.4
"""Minimum distance between points, as a share of their mean distance or of `MAX_STEP_RAD`."""
MIN_SHARE = 1e-9
"""Minimum distance between points, as a share of the path. If the joints turn too far within this distance,
the path is singular there, because the joints would jump.
"""
SHARE_RAD = 0.1
"""Growth of the path's parameter over the whole TCP path, in addition to the joint distance, rad. This makes
the parameter increase even where no joint moves.
"""
SWINGING = 1.5
"""If a curve through the points is longer than its chords by this factor, it oscillates between them."""
MAX_PLACES = 1500
ROUNDS = 12
HALVINGS, GAINED, GROWTHS = 4, 0.5, 5
"""No more places are added in two cases. First: after this number of halvings of the first interval, more
than this share of its deviation remains, because the joints jump there. Second: the number of spoiled
intervals has grown in as many consecutive rounds as the third value.
"""
INSIDE_RAD = 1e-6
"""Distance that the path keeps from the joint limits if it begins at them, because the time parameterization
deviates a little from the path.
"""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)

JointsAt = Callable[[float, Array], Array | None]
"""Function that returns joint angles at the given share of the path, close to the given
joint angles, or None."""


def through(
    robot: RobotDescription, path: TcpPath, shares: Array, rows: Array, joints_at: JointsAt
) -> JointCurve:
    """A joint path that passes through the configurations `rows` at the path shares `shares`. Shapes: (n,
    dof) and (n,). Points are added where they are needed for accuracy.

    It stays within the joint limits, and its TCP within `MAX_DEVIATION_*` of the TCP path.

    Raises:
        UnreachableError: the joints jump, a point has no joint angles, or `MAX_PLACES` are not enough.
    """
    limits = robot.limits  # a path may begin beyond them
    low = np.minimum(limits.min_position + INSIDE_RAD, rows[0])
    high = np.maximum(limits.max_position - INSIDE_RAD, rows[0])
    if (
        len(rows) > 1
        and np.abs(np.diff(rows, axis=0)).max() <= EVEN_STEP_RAD
        and np.ptp(np.diff(shares)) < EVEN_SHARE
    ):
        joint_path = JointCurve.through_even(rows)
        if not _find_spoiled(robot, path, joint_path, shares, shares, (low, high))[0].any():
            return joint_path
    shares, rows = _thin(*_refine_jumps(path, robot, shares, rows, joints_at))
    counts: list[int] = []
    at_start: list[float] = []
    for _ in range(ROUNDS):
        outside = np.argwhere((rows < low) | (rows > high))
        if len(outside):
            place, joint = outside[0]
            limit = np.clip(rows[place, joint], low[joint], high[joint])
            where = f"{path.name}: at {100 * shares[place]:.0f} % of the path"
            raise at_limit_of(
                where, limits, int(joint), float(rows[place, joint]), float(limit), float(shares[place])
            )
        parameters = _lengths(shares, rows)
        joint_path = JointCurve.through(parameters, rows)
        spoiled, deviation = _find_spoiled(robot, path, joint_path, parameters, shares, (low, high))
        if not spoiled.any():
            return joint_path
        counts.append(int(spoiled.sum()))
        at_start = [*at_start, deviation] if spoiled[0] else []
        if _is_futile(counts, at_start):
            break
        shares, rows = _halve(path, shares, rows, spoiled, joints_at)
    raise _inaccurate(path)


def _is_futile(counts: list[int], at_start: list[float]) -> bool:
    """Whether the joints jump at the start, or slide along a limit. Further halvings then help nothing.

    Args:
        counts: number of spoiled intervals in each round.
        at_start: deviation in the first interval in each of the last rounds in which it was spoiled.
    """
    jumps = len(at_start) > HALVINGS and at_start[-1] > GAINED * at_start[-1 - HALVINGS]
    return jumps or (len(counts) > GROWTHS and bool(np.diff(counts[-1 - GROWTHS :]).min() > 0))


def at_limit_of(
    where: str, limits: JointLimits, joint: int, value: float, limit: float, share: float
) -> UnreachableError:
    """The error for a path on which a joint reaches its limit."""
    name, unit = limits.names[joint], limits.unit(joint)
    return UnreachableError(
        f"{where} {name} reaches its limit of {limit:.4f} {unit}",
        findings=[Finding("limit", "position", value, limit, unit, share, (name,))],
    )


def jump_of(where: str, limits: JointLimits, joint: int, step: float, share: float) -> UnreachableError:
    """The error for a path that a joint could only follow with a jump."""
    name, unit = limits.names[joint], limits.unit(joint)
    return UnreachableError(
        f"{where} {name} would have to jump by {step:.2f} {unit}: the path leads through a singularity",
        findings=[Finding("singularity", "step", step, MAX_STEP_RAD, unit, share, (name,))],
    )


def _inaccurate(path: TcpPath) -> UnreachableError:
    most = float(MAX_PLACES)
    return UnreachableError(
        f"{path.name}: the joints cannot follow the path accurately",
        findings=[Finding("path", "places needed, more than", most, most, "")],
    )


def _refine_jumps(
    path: TcpPath, robot: RobotDescription, shares: Array, rows: Array, joints_at: JointsAt
) -> tuple[Array, Array]:
    """Add points where the joints turn far between two points."""
    while True:
        steps = np.abs(np.diff(rows, axis=0))
        far = steps.max(axis=1) > MAX_STEP_RAD
        if not far.any():
            return shares, rows
        jumps = np.flatnonzero(far & (np.diff(shares) < MIN_SHARE))
        if len(jumps):
            place, joint = int(jumps[0]), int(steps[jumps[0]].argmax())
            where = f"{path.name}: at {100 * shares[place]:.0f} % of the path"
            raise jump_of(where, robot.limits, joint, float(steps[place, joint]), float(shares[place]))
        shares, rows = _halve(path, shares, rows, far, joints_at)


def _thin(shares: Array, rows: Array) -> tuple[Array, Array]:
    """Remove points that are much closer together than most: a spline through them would overshoot."""
    steps = _chords(shares, rows)
    least = THIN * min(MAX_STEP_RAD, float(steps.sum()) / len(steps))
    kept, gone = [0], 0.0
    for index, step in enumerate(steps[:-1], start=1):
        gone += step
        if gone >= least:
            kept.append(index)
            gone = 0.0
    if gone + steps[-1] < least and len(kept) > 1:
        kept.pop()
    kept.append(len(rows) - 1)
    return shares[kept], rows[kept]


def _halve(
    path: TcpPath, shares: Array, rows: Array, which: Array, joints_at: JointsAt
) -> tuple[Array, Array]:
    """Add a point in the middle of each selected interval. The mask `which`, shape (n - 1,), selects the
    intervals.
    """
    chosen = np.flatnonzero(which)
    if len(rows) + len(chosen) > MAX_PLACES:
        raise _inaccurate(path)
    middles = 0.5 * (shares[chosen] + shares[chosen + 1])
    found = []
    for share, index in zip(middles, chosen, strict=True):
        joints = joints_at(float(share), 0.5 * (rows[index] + rows[index + 1]))
        if joints is None:
            raise UnreachableError(
                f"{path.name}: at {100 * share:.1f} % of the path no joint angles are within the limits",
                findings=[Finding("reach", "share of the path", float(share), 1.0, "", float(share))],
            )
        found.append(joints)
    return np.insert(shares, chosen + 1, middles), np.insert(rows, chosen + 1, np.array(found), axis=0)


def _lengths(shares: Array, rows: Array) -> Array:
    """The parameter of each point: the arc length from the first point, along a curve through all points.

    The curve is first parameterized by chord lengths, and then refined twice. Each length is the length in
    joint space plus a small share of the length along the TCP path.

    If a curve through the points would oscillate, chord lengths are used until there are more points.
    """
    points = np.column_stack([rows, SHARE_RAD * shares])
    parameters = np.concatenate([[0.0], np.cumsum(_chords(shares, rows))])
    for _ in range(2):
        curve = spline_through(parameters, points)
        knots = np.unique(curve.t)
        steps = np.diff(knots)
        places = knots[:-1, None] + 0.5 * steps[:, None] * (NODES + 1.0)
        speeds = np.sqrt((curve(places.ravel(), 1) ** 2).sum(axis=1)).reshape(places.shape)
        lengths = np.concatenate([[0.0], np.cumsum(0.5 * steps * (speeds @ WEIGHTS))])
        if lengths[-1] > SWINGING * parameters[-1]:
            break
        parameters = np.interp(parameters, knots, lengths)
    return np.asarray(parameters)


def _chords(shares: Array, rows: Array) -> Array:
    ways = np.diff(rows, axis=0)
    return np.asarray(np.sqrt((ways**2).sum(axis=1) + (SHARE_RAD * np.diff(shares)) ** 2))


def _find_spoiled(
    robot: RobotDescription,
    path: TcpPath,
    joint_path: JointCurve,
    parameters: Array,
    shares: Array,
    bounds: tuple[Array, Array],
) -> tuple[Array, float]:
    """Find the intervals in which the joint path leaves its bounds or the TCP leaves the TCP path. The second
    result is the largest deviation in the first of these intervals, as a share of the allowed deviation.
    """
    steps = np.diff(parameters)
    inner = np.concatenate(
        [
            (parameters[:-1, None] + BETWEEN * steps[:, None]).ravel(),
            parameters[0] + AT_ENDS * steps[0],
            parameters[-1] - AT_ENDS * steps[-1],
        ]
    )
    there = inner
    if parameters is not shares:
        # Clipped, because the path is extrapolated as a line beyond its ends, which would hide a deviation of
        # the TCP.
        there = np.clip(spline_through(parameters, shares[:, None])(inner)[:, 0], 0.0, 1.0)
    poses, targets = robot.model.poses(joint_path.at(inner)), path.poses(there)
    deviations = np.maximum(
        np.linalg.norm(poses[:, :3] - targets[:, :3], axis=1) / MAX_DEVIATION_M,
        angles_between(poses[:, 3:], targets[:, 3:], path.free) / MAX_DEVIATION_RAD,
    )
    wrong = np.concatenate([inner[deviations > PATH_SHARE], joint_path.places_outside(*bounds)])
    spoiled = np.zeros(len(steps), bool)
    spoiled[np.clip(np.searchsorted(parameters, wrong, side="right") - 1, 0, len(steps) - 1)] = True
    return spoiled, float(deviations[inner < parameters[1]].max())
