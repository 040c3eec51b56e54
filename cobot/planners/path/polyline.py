"""Straight lines of the TCP from pose to pose, with round corners.

Each leg has a progress over the path's parameter, and the TCP is where all progresses together have brought
it: the positions add up, the orientations turn one after the other. At a round corner the progress of the one
leg ends while that of the next begins, each a quintic that goes on from its even part with two derivatives,
so the corner is a quintic Bezier curve that stays between its legs.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from cobot.motions.requests import MotionRequest
from cobot.planners.path.cartesian import STANDING_M, STANDING_RAD, follow
from cobot.planners.path.ends import end_of
from cobot.planners.path.path_goals import reachable
from cobot.planners.path.tcp_path import PLACES, TcpPath, least_turn, turn_between
from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, Pose

METRES_PER_RAD = 0.3
"""What a turn counts beside a way where a leg's length is needed."""
PLACES_PER_CORNER = 12
MAX_PLACES = 400
LARGEST_SHARE = 0.5
"""Of a leg that a corner may take; the others are its neighbour's."""


def plan_polyline(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """From the present pose through all of `request.through` to the goal; None if it is there already.

    With a radius it goes through without a stop, else it stops at each pose.

    Raises:
        PlanningError: from `follow`, saying on which leg, and from `end_of`.
    """
    assert isinstance(request.goal, Pose)
    poses = [robot.model.forward(request.start)]
    for pose in (*request.through, request.goal):
        poses.append(reachable(robot, request, poses[-1], pose))
    joints_at_end = end_of(robot, request, poses[-1])
    if joints_at_end is not None:
        poses[-1] = robot.model.forward(joints_at_end)
    poses = _apart(poses)
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


def _apart(poses: list[Pose]) -> list[Pose]:
    """Without those that are where the one before is."""
    kept = poses[:1]
    for pose in poses[1:]:
        across = np.linalg.norm(pose.position - kept[-1].position)
        if across >= STANDING_M or np.linalg.norm(turn_between(kept[-1], pose)) >= STANDING_RAD:
            kept.append(pose)
    return kept if len(kept) > 1 else [kept[0], kept[0]]


def rounded(
    poses: list[Pose], radius_m: float, name: str = "polyline", least_rad: float = quaternion.SMALL_RAD
) -> TcpPath:
    """The path itself: it leaves the legs within `radius_m` of the poses between start and goal."""
    ways = np.array([b.position - a.position for a, b in pairwise(poses)])
    turns = np.array([turn_between(a, b) for a, b in pairwise(poses)])
    lengths, angles = np.linalg.norm(ways, axis=1), np.linalg.norm(turns, axis=1)
    sizes = np.maximum(np.maximum(lengths, METRES_PER_RAD * angles), STANDING_M)
    # So much of each leg, in the parameter, is round at the corner after it: the same on both sides.
    free = np.minimum(LARGEST_SHARE, radius_m / np.maximum(lengths, 1e-9)) * sizes
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
    """From 0 to 1 over a leg's size, even but for its round ends, which reach beyond it by as much."""
    progress = np.clip(since / size, 0.0, 1.0)
    for round_m, inside in ((first, since), (last, size - since)):
        if round_m > 0.0:
            share = np.clip((inside + round_m) / (2.0 * round_m), 0.0, 1.0)
            bent = round_m / size * share**3 * (2.0 - share)
            near = np.abs(inside) < round_m
            progress[near] = (bent if inside is since else 1.0 - bent)[near]
    return np.asarray(progress)


def _turned(orientations: Array, turn: Array, shares: Array, least_rad: float) -> Array:
    """Quaternions, shape (n, 4), each turned by its share of a rotation vector."""
    angle = float(np.linalg.norm(turn))
    if angle < least_rad:
        return orientations
    half = 0.5 * angle * shares
    w, v = np.cos(half), np.sin(half)[:, None] * (turn / angle)
    scalars, vectors = orientations[:, 0], orientations[:, 1:]
    real = w * scalars - (v * vectors).sum(axis=1)
    imaginary = w[:, None] * vectors + scalars[:, None] * v + np.cross(v, vectors)
    return np.concatenate([real[:, None], imaginary], axis=1)
