"""Straight TCP lines from pose to pose, with blends.

Each leg has a progress over the path parameter, and the TCP pose is the sum of all progresses: positions add
up, orientations turn in sequence. In a blend, the progress of one leg ends while the progress of the next leg
begins. Each progress is a quintic with two continuous derivatives, so the blend is a quintic Bezier curve
that stays between its legs.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from cobot.motions.requests import MotionRequest
from cobot.planners.path.cartesian import STANDING_M, STANDING_RAD, follow
from cobot.planners.path.ends import end_of, reachable
from cobot.planners.path.tcp_path import PLACES, TcpPath, least_turn, turn_between
from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, Pose

METRES_PER_RAD = 0.3
"""Length that is equivalent to a rotation by 1 rad, where a leg needs a single length."""
PLACES_PER_CORNER = 12
MAX_PLACES = 400
MAX_SHARE = 0.5
"""Largest share of a leg that a blend may use. The remaining part is for the blend at the other end."""


def plan_polyline(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """Plan from the current pose through all of `request.through` to the goal; None if the arm is already
    there.

    With a blend radius the TCP passes the poses without a stop; otherwise it stops at each pose.

    Raises:
        PlanningError: see `follow`, the message also names the leg; see also `end_of`.
    """
    assert isinstance(request.goal, Pose)
    poses = [robot.model.forward(request.start)]
    for pose in (*request.through, request.goal):
        poses.append(reachable(robot, request, poses[-1], pose))
    poses[-1], joints_at_end = end_of(robot, request, poses[-1])
    poses = _distinct(poses)
    if request.radius_m > 0.0 and len(poses) > 2:
        path = rounded(poses, request.radius_m, least_rad=least_turn(robot))
        return follow(robot, request, path, joints_at_end)
    whole: Trajectory | None = None
    legs = list(pairwise(poses))
    for number, (begin, end) in enumerate(legs, start=1):
        start = request.start if whole is None else whole.end
        leg = rounded([begin, end], 0.0, f"polyline, leg {number}", least_turn(robot))
        last = joints_at_end if number == len(legs) else None
        motion = follow(robot, replace(request, start=start), leg, last)
        if motion is not None:
            whole = motion if whole is None else whole.followed_by(motion)
    return whole


def _distinct(poses: list[Pose]) -> list[Pose]:
    """The poses without those that equal the previous pose."""
    kept = poses[:1]
    for pose in poses[1:]:
        across = np.linalg.norm(pose.position - kept[-1].position)
        if across >= STANDING_M or np.linalg.norm(turn_between(kept[-1], pose)) >= STANDING_RAD:
            kept.append(pose)
    return kept if len(kept) > 1 else [kept[0], kept[0]]


def rounded(
    poses: list[Pose], radius_m: float, name: str = "polyline", least_rad: float = quaternion.SMALL_RAD
) -> TcpPath:
    """The path with blends: it leaves the legs only within `radius_m` of the poses between start and goal."""
    ways = np.array([b.position - a.position for a, b in pairwise(poses)])
    turns = np.array([turn_between(a, b) for a, b in pairwise(poses)])
    lengths, angles = np.linalg.norm(ways, axis=1), np.linalg.norm(turns, axis=1)
    sizes = np.maximum(np.maximum(lengths, METRES_PER_RAD * angles), STANDING_M)
    # The part of each leg, in the parameter, that belongs to the blend at its end. It is the same on both
    # sides of a corner.
    free = np.minimum(MAX_SHARE, radius_m / np.maximum(lengths, 1e-9)) * sizes
    corners = np.concatenate([[0.0], np.minimum(free[:-1], free[1:]), [0.0]])
    ends = np.cumsum(sizes)
    start = poses[0]

    def at(shares: Array) -> Array:
        place = shares * ends[-1]
        positions = np.tile(start.position, (len(shares), 1))
        orientations = np.tile(start.quaternion, (len(shares), 1))
        for leg, (way, turn) in enumerate(zip(ways, turns, strict=True)):
            since = place - (ends[leg] - sizes[leg])
            progress = _progress(since, sizes[leg], corners[leg], corners[leg + 1])
            positions += progress[:, None] * way
            orientations = _turned(orientations, turn, progress, least_rad)
        return np.concatenate([positions, orientations], axis=1)

    places = int(np.clip(PLACES * ends[-1] / max(lengths.max(), 0.3), PLACES, MAX_PLACES))
    places = min(MAX_PLACES, places + PLACES_PER_CORNER * int((corners > 0.0).sum()))
    return TcpPath(name, at, float(lengths.sum()), float(angles.sum()), places)


def _progress(since: Array, size: float, first: float, last: float) -> Array:
    """Progress from 0 to 1 over a leg. It is even except in the blends at its ends; each blend extends
    equally far into the leg and beyond it.
    """
    progress = np.clip(since / size, 0.0, 1.0)
    for round_m, inside in ((first, since), (last, size - since)):
        if round_m > 0.0:
            share = np.clip((inside + round_m) / (2.0 * round_m), 0.0, 1.0)
            bent = round_m / size * share**3 * (2.0 - share)
            near = np.abs(inside) < round_m
            progress[near] = (bent if inside is since else 1.0 - bent)[near]
    return np.asarray(progress)


def _turned(orientations: Array, turn: Array, shares: Array, least_rad: float) -> Array:
    """Quaternions, shape (n, 4): each orientation turned by its share of a rotation vector."""
    angle = float(np.linalg.norm(turn))
    if angle < least_rad:
        return orientations
    half = 0.5 * angle * shares
    w, v = np.cos(half), np.sin(half)[:, None] * (turn / angle)
    scalars, vectors = orientations[:, 0], orientations[:, 1:]
    real = w * scalars - (v * vectors).sum(axis=1)
    imaginary = w[:, None] * vectors + scalars[:, None] * v + np.cross(v, vectors)
    return np.concatenate([real[:, None], imaginary], axis=1)
