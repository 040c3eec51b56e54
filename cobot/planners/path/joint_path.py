"""From joint angles at some places of a path to a smooth path of the joints that keeps to it everywhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.errors import UnreachableError
from cobot.findings import Finding
from cobot.planners.path.tcp_path import TcpPath, angles_between
from cobot.planners.timing.path import Path, spline_through
from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits

LARGEST_DEVIATION_M = 5e-5
LARGEST_DEVIATION_RAD = np.radians(0.01)
PATH_SHARE = 0.4
"""Of the deviation, what the joints' path may have; the rest is for the time law's quintics."""
POSE_SHARE = 0.5 * PATH_SHARE
"""Of the deviation, what the joints may have at the places of an arm that comes near most poses only."""
BETWEEN = np.array([0.25, 0.5, 0.75])
"""Where in each interval between places the deviation is looked at."""
AT_ENDS = np.array([0.03, 0.08, 0.15])
"""And in the first, from its beginning, and the last, from its end: a spline swings there soonest."""
EVEN_STEP_RAD = 0.25
"""Where the joints turn further than this between even places, their own way is the path's parameter."""
LARGEST_STEP_RAD = 0.12
THIN = 0.4
"""Places are no nearer to each other than this share of the mean, or of `LARGEST_STEP_RAD`."""
SHORTEST_SHARE = 1e-9
"""Joints that turn further between two places this near to each other jump: the path is singular there."""
SHARE_RAD = 0.1
"""What the whole path counts as in its parameter, beside the joints' way, so that it always increases."""
SWINGING = 1.5
"""A curve through the places that is so many times as long as its chords swings beside them."""
MAX_PLACES = 1500
ROUNDS = 12
INSIDE_RAD = 1e-6
"""The joints stay so far from limits, if they begin there: the time law's quintics are near this path."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)

JointsAt = Callable[[float, Array], Array | None]
"""Joint angles at a share of the path near given ones; None if there are none."""


def through(robot: RobotDescription, path: TcpPath, shares: Array, rows: Array, joints_at: JointsAt) -> Path:
    """A path of the joints through rows, shape (n, dof), at shares, shape (n,), and more where it needs them.

    It is within the joints' limits everywhere, and its TCP within `LARGEST_DEVIATION_*` of the path.

    Raises:
        UnreachableError: the joints jump, there are none somewhere, or more than `MAX_PLACES` are needed.
    """
    if len(rows) > 1 and np.abs(np.diff(rows, axis=0)).max() <= EVEN_STEP_RAD and _is_even(shares):
        joint_path = Path.through_even(rows)
        if not _spoiled(robot, path, joint_path, shares, shares, rows[0]).any():
            return joint_path
    low, high = _bounds(robot, rows[0])
    shares, rows = _thinned(*_without_jumps(path, robot, shares, rows, joints_at))
    for _ in range(ROUNDS):
        outside = np.argwhere((rows < low) | (rows > high))
        if len(outside):
            place, joint = outside[0]
            limit = np.clip(rows[place, joint], low[joint], high[joint])
            where = f"{path.name}: at {100 * shares[place]:.0f} % of the path"
            raise at_limit_of(
                where, robot.limits, int(joint), float(rows[place, joint]), float(limit), float(shares[place])
            )
        parameters = _lengths(shares, rows)
        joint_path = Path.through(parameters, rows)
        spoiled = _spoiled(robot, path, joint_path, parameters, shares, rows[0])
        if not spoiled.any():
            return joint_path
        shares, rows = _halved(path, shares, rows, spoiled, joints_at)
    raise _inaccurate(path)


def at_limit_of(
    where: str, limits: JointLimits, joint: int, value: float, limit: float, share: float
) -> UnreachableError:
    """A joint that a path drives into its limit."""
    name, unit = limits.names[joint], limits.unit(joint)
    return UnreachableError(
        f"{where} {name} reaches its limit of {limit:.4f} {unit}",
        findings=[Finding("limit", "position", value, limit, unit, share, (name,))],
    )


def jump_of(where: str, limits: JointLimits, joint: int, step: float, share: float) -> UnreachableError:
    """A joint that could follow a path only by a jump."""
    name, unit = limits.names[joint], limits.unit(joint)
    return UnreachableError(
        f"{where} {name} would have to jump by {step:.2f} {unit}: the path leads through a singularity",
        findings=[Finding("singularity", "step", step, LARGEST_STEP_RAD, unit, share, (name,))],
    )


def _inaccurate(path: TcpPath) -> UnreachableError:
    most = float(MAX_PLACES)
    return UnreachableError(
        f"{path.name}: the joints cannot follow the path accurately",
        findings=[Finding("path", "places needed, more than", most, most, "")],
    )


def _is_even(shares: Array) -> bool:
    steps = shares[1:] - shares[:-1]
    return bool(steps.max() - steps.min() < 1e-9)


def _without_jumps(
    path: TcpPath, robot: RobotDescription, shares: Array, rows: Array, joints_at: JointsAt
) -> tuple[Array, Array]:
    """More places where the joints turn far between two."""
    while True:
        steps = np.abs(np.diff(rows, axis=0))
        far = steps.max(axis=1) > LARGEST_STEP_RAD
        if not far.any():
            return shares, rows
        jumps = np.flatnonzero(far & (np.diff(shares) < SHORTEST_SHARE))
        if len(jumps):
            place, joint = int(jumps[0]), int(steps[jumps[0]].argmax())
            where = f"{path.name}: at {100 * shares[place]:.0f} % of the path"
            raise jump_of(where, robot.limits, joint, float(steps[place, joint]), float(shares[place]))
        shares, rows = _halved(path, shares, rows, far, joints_at)


def _thinned(shares: Array, rows: Array) -> tuple[Array, Array]:
    """Without places that are much nearer to each other than most: a spline through such ones swings."""
    steps = _chords(shares, rows)
    least = THIN * min(LARGEST_STEP_RAD, float(steps.sum()) / len(steps))
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


def _halved(
    path: TcpPath, shares: Array, rows: Array, which: Array, joints_at: JointsAt
) -> tuple[Array, Array]:
    """With a place in the middle of these intervals, a mask of shape (n - 1,)."""
    chosen = np.flatnonzero(which)
    if len(rows) + len(chosen) > MAX_PLACES:
        raise _inaccurate(path)
    middles = 0.5 * (shares[chosen] + shares[chosen + 1])
    found = []
    for share, index in zip(middles, chosen, strict=True):
        joints = joints_at(float(share), 0.5 * (rows[index] + rows[index + 1]))
        if joints is None:
            raise UnreachableError(
                f"{path.name}: at {100 * share:.1f} % of the path no joint angles within the limits go on",
                findings=[Finding("reach", "share of the path", float(share), 1.0, "", float(share))],
            )
        found.append(joints)
    return np.insert(shares, chosen + 1, middles), np.insert(rows, chosen + 1, np.array(found), axis=0)


def _lengths(shares: Array, rows: Array) -> Array:
    """The way to each place, of the joints and, a little, of the path: chords, then twice the true arcs.

    Chords alone where a curve through the places would swing far out, until there are more places.
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


def _spoiled(
    robot: RobotDescription, path: TcpPath, joint_path: Path, parameters: Array, shares: Array, start: Array
) -> Array:
    """In which of the intervals between places the path leaves a limit, or its TCP the TCP's path."""
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
        # Beyond its ends a path would go on as a line does, and the TCP would not be found beside it.
        there = np.clip(spline_through(parameters, shares[:, None])(inner)[:, 0], 0.0, 1.0)
    poses, targets = robot.model.poses(joint_path.at(inner)), path.poses(there)
    far = np.linalg.norm(poses[:, :3] - targets[:, :3], axis=1) > PATH_SHARE * LARGEST_DEVIATION_M
    far |= angles_between(poses[:, 3:], targets[:, 3:], path.free) > PATH_SHARE * LARGEST_DEVIATION_RAD
    wrong = np.concatenate([inner[far], joint_path.places_outside(*_bounds(robot, start))])
    spoiled = np.zeros(len(steps), bool)
    spoiled[np.clip(np.searchsorted(parameters, wrong, side="right") - 1, 0, len(steps) - 1)] = True
    return spoiled


def _bounds(robot: RobotDescription, start: Array) -> tuple[Array, Array]:
    limits = robot.limits
    low, high = limits.min_position + INSIDE_RAD, limits.max_position - INSIDE_RAD
    return np.minimum(low, start), np.maximum(high, start)
