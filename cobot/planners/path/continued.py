"""Joints along a TCP path, each solved from the previous ones, and the reason if they cannot continue."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from cobot.errors import CobotError, CollisionError, UnreachableError
from cobot.findings import Finding
from cobot.planners.path.joint_path import (
    MAX_DEVIATION_M,
    MAX_DEVIATION_RAD,
    MIN_SHARE,
    POSE_SHARE,
    JointsAt,
    at_limit_of,
    jump_of,
    through,
)
from cobot.planners.path.tcp_path import TcpPath, angles_between
from cobot.planners.timing.path import JointCurve
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import allowed, apart, cause_of, missing
from cobot.types import Array, JointLimits

STEP_RAD = 0.4
"""Maximum turn of a joint between two points, rad. If a joint would turn further, a point is added between
them.
"""
SAME_RAD = 1e-6
"""Joint positions that differ by less than this, rad, are considered equal."""
STEPS = 60
"""Maximum number of steps of a descent from one point to the next."""


def continued(
    robot: RobotDescription, start: Array, path: TcpPath, end: Array | None = None
) -> tuple[JointCurve | None, CobotError | None]:
    """The joints at evenly spaced points of a path, each solved by inverse kinematics from the previous one;
    or the reason why the joints cannot continue.

    Args:
        end: joints at the end, shape (dof,), with the TCP at the end of the path; None means any.
    """
    try:
        shares, rows = _chain(robot, start, path)
        if end is not None:
            rows = _ending_at(robot, path, shares, rows, end)
        return through(robot, path, shares, rows, joints_at(robot, path)), None
    except UnreachableError as exc:
        return None, exc


def _ending_at(robot: RobotDescription, path: TcpPath, shares: Array, rows: Array, end: Array) -> Array:
    """The joint positions of a path, changed so that they end at `end`. The change grows gradually along the
    path. Shape: (n, dof).
    """
    arm, drift = robot.model.kinematics(path.free), end - rows[-1]
    if np.abs(drift).max() > SAME_RAD:
        if not arm.redundant:
            joint = int(np.abs(drift).argmax())
            raise _other_end_error(path, robot.limits, joint, float(rows[-1, joint]), float(end[joint]))
        weights = shares**3 * (10.0 + shares * (6.0 * shares - 15.0))  # the motion is at rest at both ends
        guesses = rows + weights[:, None] * drift
        poses = path.poses(shares)
        rows = rows.copy()
        for place in range(1, len(rows) - 1):
            joints, solved, _, _ = arm.descend(poses[place], guesses[place], STEPS, share=POSE_SHARE)
            if not solved:
                at = float(shares[place])
                raise UnreachableError(
                    f"{path.name}: at {100 * at:.0f} % of the path no joint angles within the limits reach "
                    "the required end joints",
                    findings=[Finding("reach", "share of the path", at, 1.0, "", at)],
                )
            rows[place] = joints
    rows[-1] = end
    return rows


def _other_end_error(
    path: TcpPath, limits: JointLimits, joint: int, value: float, end: float
) -> UnreachableError:
    """The error for an arm without redundancy whose path does not end in the required joint angles."""
    name, unit = limits.names[joint], limits.unit(joint)
    return UnreachableError(
        f"{path.name}: the path ends with {name} at {value:.4f} {unit} instead of {end:.4f} {unit}, and this "
        "arm has no redundancy by which it could end there",
        findings=[Finding("redundancy", "position at the end", value, end, unit, 1.0, (name,))],
    )


def share_along(robot: RobotDescription, start: Array, path: TcpPath) -> float:
    """A quick estimate of the share of the path that the joints can follow from `start` without a collision.
    Only evenly spaced points are checked, so the result is no proof.
    """
    free = robot.collision.clearance.are_free(_carried(robot, start, path))
    return float(np.logical_and.accumulate(free).sum()) / path.places


def obstacle_along(robot: RobotDescription, start: Array, path: TcpPath) -> CobotError | None:
    """The reason why `share_along` is less than 1, or None if the reason is not clear."""
    for place, joints in enumerate(_carried(robot, start, path), start=1):
        share = place / path.places
        try:
            robot.collision.check_position(
                joints, f"{path.name}: the arm at {100 * share:.0f} % of the path", share
            )
        except CollisionError as exc:
            return exc
    return continued(robot, start, path)[1]


def _carried(robot: RobotDescription, start: Array, path: TcpPath) -> Array:
    """The joint positions at evenly spaced points along the path, up to the point where the joints can no
    longer follow it. Shape: (n, dof).
    """
    poses = path.poses(np.linspace(0.0, 1.0, path.places + 1)[1:])
    rows = robot.model.kinematics(path.free).carry(poses, start, STEPS, STEP_RAD, POSE_SHARE)
    return np.asarray(rows)


def joints_at(robot: RobotDescription, path: TcpPath) -> JointsAt:
    """Return a function that solves for the joint positions at a share of the path, starting from nearby
    positions.
    """
    descend = robot.model.kinematics(path.free).descend

    def at(share: float, near: Array) -> Array | None:
        joints, solved, _, _ = descend(path.poses(np.array([share]))[0], near, STEPS, share=POSE_SHARE)
        return joints if solved else None

    return at


def _chain(robot: RobotDescription, start: Array, path: TcpPath) -> tuple[Array, Array]:
    """Shares of the path, and the joint positions at these shares. Each is solved from the one before it."""
    arm = robot.model.kinematics(path.free)
    descend = partial(arm.descend, steps=STEPS, share=POSE_SHARE)
    even = np.linspace(0.0, 1.0, path.places + 1)
    targets = path.poses(even[1:])
    carried = arm.carry(targets, start, STEPS, STEP_RAD, POSE_SHARE)
    shares, rows = even[: len(carried) + 1].tolist(), [start, *carried]
    ahead = even[: len(carried) : -1].tolist()
    poses = dict(zip(even[1:].tolist(), targets, strict=True))
    while ahead:
        share = ahead[-1]
        pose = poses[share] if share in poses else path.poses(np.array([share]))[0]
        joints, solved, _, _ = descend(pose, rows[-1])
        step = np.abs(joints - rows[-1])
        at_limit = _at_limit(robot.limits, joints, step)
        if solved and not at_limit and step.max() <= STEP_RAD:
            shares.append(ahead.pop())
            rows.append(joints)
        elif share - shares[-1] > MIN_SHARE and not (solved and at_limit):
            ahead.append(0.5 * (shares[-1] + share))
        else:
            beyond = next(place for place in reversed(ahead) if place in poses)
            if not solved and arm.lacking:
                beyond = _farthest(
                    descend, {place: poses[place] for place in ahead if place in poses}, rows[-1]
                )
            if not solved:
                # The message describes the next of these points, where the distance from the path is
                # noticeable.
                joints = descend(poses[beyond], rows[-1])[0]
            raise _failure(robot, path, (share, beyond), joints, rows[-1], at_limit, solved)
    return np.array(shares), np.array(rows)


def _farthest(descend: Callable[..., Any], poses: dict[float, Array], near: Array) -> float:
    """The share of the path at which an arm with few joints misses the pose by the most, relative to lin's
    tolerance.
    """

    def excess(share: float) -> float:
        _, _, distance_m, angle_rad = descend(poses[share], near)
        return float(max(distance_m / MAX_DEVIATION_M, angle_rad / MAX_DEVIATION_RAD))

    return max(poses, key=excess)


def _at_limit(limits: JointLimits, joints: Array, step: Array) -> list[int]:
    """The joints that this step drives into a limit."""
    stuck = ((joints <= limits.min_position) | (joints >= limits.max_position)) & (step > 1e-9)
    return [int(joint) for joint in stuck.nonzero()[0]] if stuck.any() else []


def moving(limits: JointLimits, joint: int) -> str:
    return f"{limits.names[joint]} {'sliding' if limits.unit(joint) == 'm' else 'turning'}"


def _failure(
    robot: RobotDescription,
    path: TcpPath,
    shares: tuple[float, float],
    joints: Array,
    before: Array,
    at_limit: list[int],
    solved: bool,
) -> UnreachableError:
    """The error for a path along which the arm can only move up to the first of `shares`. If `solved` is
    false, `joints` is the closest that the arm gets to the pose at the second share.
    """
    share, next_share = shares
    place = f"{path.name}: at {100 * share:.0f} % of the path"
    limits = robot.limits
    for joint in at_limit:
        low, high = limits.min_position[joint], limits.max_position[joint]
        limit = low if joints[joint] - low < high - joints[joint] else high
        return at_limit_of(place, limits, joint, float(joints[joint]), float(limit), share)
    joint = int(np.abs(joints - before).argmax())
    name = limits.names[joint]
    if solved:
        return jump_of(place, limits, joint, abs(float(joints[joint] - before[joint])), share)
    pose, target = robot.model.forward(joints), path.pose_at(next_share)
    distance_m = float(np.linalg.norm(pose.position - target.position))
    angle = float(angles_between(pose.quaternion[None], target.quaternion[None], path.free)[0])
    cause = cause_of(robot.model, target, joints, path.free, share)
    if cause.finding is not None and cause.finding.check == "limit":
        beyond = limits.names.index(cause.finding.of[0])
        return at_limit_of(place, limits, beyond, cause.finding.value, cause.finding.limit, share)
    at = f" after {100 * next_share:.0f} %" if robot.model.inverse_kinematics.lacking else ""
    away = f"{apart(distance_m, angle)} away{at}{allowed(robot.model)}"
    return UnreachableError(
        f"{place} the TCP cannot continue: {cause.says}; it stays {away}, with {moving(limits, joint)} most, "
        f"to {joints[joint]:.3f} {limits.unit(joint)}",
        findings=[
            *([] if cause.finding is None else [cause.finding]),
            *missing(robot.model, distance_m, angle, "path", share, (name,)),
        ],
    )
