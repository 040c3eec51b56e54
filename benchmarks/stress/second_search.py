"""Checks whether a rejection was right: the named configuration, all branches, or a whole grid."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.planning.lines import PLACES, STEP_RAD, exhaustive
from benchmarks.stress.cases import Case
from benchmarks.stress.judge import END_M, NEAR_M, Judge
from cobot.errors import CobotError, CollisionError, LimitError, UnreachableError
from cobot.motions.planners import Way
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.path.circ import arc, helix
from cobot.planners.path.lin import straight_line
from cobot.planners.path.polyline import rounded
from cobot.planners.path.tcp_path import TcpPath
from cobot.types import Array, PlannerName, Pose

TRIES = 80
ROUNDED_M = 2.5e-3
"""Joints in messages have three digits."""
DRAWS, PLACES_OF_DRAWS = 150, 40
FINE = 600
LONG_M = 0.5
"""Longer paths are looked at in more places."""


def confirmed(judge: Judge, case: Case, exc: CobotError, random: np.random.Generator) -> bool | None:
    """Whether no such motion exists; None if no search can decide this."""
    text = str(exc)
    if case.timed is not None or case.kind == "joined":
        return _named(judge, text)
    request = case.requests[0]
    if "the start is in collision" in text:
        return judge.distance(request.start) < judge.robot.collision.margin_m
    if isinstance(exc, LimitError) and not isinstance(request.goal, Pose):
        limits = judge.robot.limits
        return bool(((request.goal < limits.min_position) | (request.goal > limits.max_position)).any())
    if "breaks constraints" in text:
        return _breaks(judge, request, text)
    if request.constraints is not None and "constraints" in text:
        return None
    if "the goal" in text and isinstance(exc, CollisionError):
        return not any(_is_free(judge, joints) for joints in _goals(judge, request, random))
    if request.traits.way is Way.PATH and isinstance(exc, UnreachableError | CollisionError):
        return _no_line(judge, request)
    if (
        isinstance(exc, UnreachableError)
        and isinstance(request.goal, Pose)
        and request.traits.way is not Way.PATH
    ):
        return not _goals(judge, request, random)
    if request.planner is PlannerName.CHOMP or "no free path" in text:
        return _no_way(judge, request)
    return _named(judge, text)


def _goals(judge: Judge, request: MotionRequest, random: np.random.Generator) -> list[Array]:
    """All joint positions that are found for the goal."""
    if not isinstance(request.goal, Pose):
        return [request.goal]
    found = judge.solutions(request.goal, random, TRIES)
    return [joints for joints in found if judge.off(joints, request.goal) < END_M]


def _is_free(judge: Judge, joints: Array) -> bool:
    return judge.distance(joints) >= judge.robot.collision.margin_m


def _named(judge: Judge, text: str) -> bool | None:
    """Whether the configuration in an error message is in collision."""
    named = re.search(r"at (-?\d+) mm after .*?at joints \[([^]]*)\]", text)
    if named is None:
        return None
    joints = np.array([float(word) for word in named[2].split(",")])
    return judge.distance(joints) < judge.robot.collision.margin_m + ROUNDED_M


def _breaks(judge: Judge, request: MotionRequest, text: str) -> bool | None:
    assert request.constraints is not None
    if text.startswith("the start"):
        return judge.broken(request.constraints, request.start[None], request.start) > 0.0
    if "the goal" in text:
        goals = _goals(judge, request, np.random.default_rng(1))
        return all(judge.broken(request.constraints, q[None], request.start) > 0.0 for q in goals)
    try:
        motion = plan(judge.robot, replace(request, constraints=None))
    except CobotError:
        return None
    if motion is None:
        return None
    rows = motion.sample(np.linspace(0.0, motion.duration_s, 300))
    return judge.broken(request.constraints, rows, request.start) > 0.0


def _no_way(judge: Judge, request: MotionRequest) -> bool | None:
    """Whether ompl, with different random numbers and more time, finds no path either."""
    other = replace(request, planner=PlannerName.OMPL, seed=request.seed + 1000, timeout_s=20.0)
    try:
        plan(judge.robot, other)
    except CobotError:
        return True
    return False


def _no_line(judge: Judge, request: MotionRequest) -> bool | None:
    """Whether no line exists. S-R-S arms: a grid of arm angles along the path. Six joints: the only possible
    joint path, followed in small steps.
    """
    robot, path = judge.robot, _path(judge, request)
    fineness = max(1, int(np.ceil(path.length_m / LONG_M)))
    if robot.model.inverse_kinematics.arm_angle is not None:
        places = np.linspace(0.0, 1.0, fineness * PLACES + 1)[1:]
        return not exhaustive(robot, request.start, path.poses(places))
    if robot.limits.dof > 6:
        places = np.linspace(0.0, 1.0, fineness * PLACES_OF_DRAWS + 1)[1:]
        return not _drawn_along(judge, request.start, path.poses(places))
    return not _followed(judge, request.start, path.poses(np.linspace(0.0, 1.0, fineness * FINE + 1)[1:]))


def _path(judge: Judge, request: MotionRequest) -> TcpPath:
    """The requested path of the TCP. `shape` computes this path independently."""
    position, turn = judge.tcp(request.start)
    here = Pose(position, Rotation.from_matrix(turn).as_quat(scalar_first=True))
    if request.arc is not None and request.arc.angle_rad is not None:
        return helix(here, request.arc, request.arc.angle_rad)
    assert isinstance(request.goal, Pose)
    if request.planner is PlannerName.POLYLINE:
        return rounded([here, *request.through, request.goal], request.radius_m)
    if request.via is not None:
        return arc(here, request.via, request.goal)
    return straight_line(here, request.goal)


def _drawn_along(judge: Judge, start: Array, poses: Array) -> bool:
    """Random configurations from place to place. Each is within one step of a configuration at the previous
    place.
    """
    robot, random, rows = judge.robot, np.random.default_rng(5), start[None]
    descend, limits = robot.model.inverse_kinematics.descend, robot.limits
    for pose in poses:
        found = []
        for _ in range(DRAWS):
            before = rows[random.integers(len(rows))]
            drawn = before + random.choice([0.0, 0.02, 0.08]) * random.normal(size=limits.dof)
            joints, solved, _, _ = descend(pose, np.clip(drawn, limits.min_position, limits.max_position), 30)
            if solved and np.abs(joints - before).max() <= STEP_RAD and _is_free(judge, joints):
                found.append(joints)
        if not found:
            return False
        rows = np.array(found)
    return True


def _followed(judge: Judge, start: Array, poses: Array) -> bool:
    """Follow the path from place to place with Newton's method, without jumps or collisions and within the
    limits.
    """
    limits, joints = judge.robot.limits, start.copy()
    for pose in poses:
        before, wanted = joints, Rotation.from_quat(pose[3:], scalar_first=True)
        for _ in range(8):
            at, now = judge.tcp(joints)
            angles = (wanted * Rotation.from_matrix(now).inv()).as_rotvec()
            error = np.concatenate([pose[:3] - at, angles])
            if np.abs(error).max() < 1e-9:
                break
            joints = joints + np.linalg.lstsq(judge.jacobian(joints), error, rcond=1e-6)[0]
        outside = (joints < limits.min_position) | (joints > limits.max_position)
        if np.abs(error).max() > 1e-7 or outside.any() or np.abs(joints - before).max() > 0.3:
            return False
        if judge.distance(joints) < min(NEAR_M, judge.robot.collision.margin_m):
            return False
    return True
