"""Inverse kinematics: the best joint angles for a TCP pose according to a criterion, for any arm.

`RobotModel.inverse_kinematics` is the best `Arm` that the model's geometry permits. S-R-S arms (over the arm
angle, `arm_angle`) and the usual six-axis arms are solved in closed form with all branches. All other arms
are solved numerically. Every solution is within the joint limits. By forward kinematics it is at the pose
within 1e-9 m and 1e-9 rad.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from cobot.errors import InputError, UnreachableError
from cobot.robot import quaternion
from cobot.robot.inverse_kinematics.arm import Arm
from cobot.robot.inverse_kinematics.geometry import recognised
from cobot.robot.inverse_kinematics.reach import (
    MIN_GAP_M,
    Descent,
    allowed,
    apart,
    cause_of,
    freer,
    missing,
    nearest_to,
    out_of_reach,
    reach_gap,
    row_of,
    seems_reachable,
    solve_near,
)
from cobot.robot.inverse_kinematics.six_axis import SixAxisArm
from cobot.robot.inverse_kinematics.srs import SrsArm
from cobot.types import Array, FreeAxis, Pose

if TYPE_CHECKING:
    from cobot.robot.model import RobotModel

__all__ = [
    "MIN_GAP_M",
    "Arm",
    "Criterion",
    "Descent",
    "SixAxisArm",
    "SrsArm",
    "allowed",
    "apart",
    "by_distance",
    "cause_of",
    "continued",
    "freer",
    "inverse",
    "inverse_all",
    "missing",
    "nearest_to",
    "reach_gap",
    "recognised",
    "seems_reachable",
    "solve_near",
]

SOLUTIONS = 24
"""Number of successful descents for an arm without a closed form. The best of their results, or all of them,
are returned.
"""
CLEARANCE_SPREAD = 12
APART_RAD = 1e-3
PIECE_M, PIECE_RAD = 0.05, 0.2
MAX_PIECES = 10
STEPS_ALONG = 20
BRANCH_RAD = 0.5
"""Maximum length of the pieces into which a continued motion is split, m and rad. The other values are the
maximum number of pieces, the maximum number of steps per piece, and the largest turn of a joint in a
piece, rad.
"""

Clearance = Callable[[Array], float]


class Criterion(StrEnum):
    """The criterion that selects among the joints for a pose."""

    NEAREST = "nearest"  # smallest Euclidean distance of the joints from the seed
    LIMITS = "limits"  # largest distance to the nearest limit, as a share of the joint's range
    MANIPULABILITY = "manipulability"  # √det(J Jᵀ), in m and rad (Yoshikawa 1985)
    CLEARANCE = "clearance"  # largest value of the function that the caller passes


COMPILED = {
    Criterion.NEAREST: 0,
    Criterion.LIMITS: 1,
    Criterion.MANIPULABILITY: 2,
    Criterion.CLEARANCE: 0,
}


def inverse(
    model: RobotModel,
    pose: Pose,
    seed: Array,
    criterion: Criterion = Criterion.NEAREST,
    clearance: Clearance | None = None,
    random_seed: int = 0,
    free: tuple[FreeAxis, ...] = (),
) -> Array:
    """The best joint angles that bring the TCP to a pose. Shape: (dof,), in rad.

    With a closed form this is the best of all solutions. Otherwise, if the nearest solution is requested, it
    is the result of a descent from the seed; for other criteria, it is the best result of several descents
    from random starts.

    Args:
        clearance: function from joints, shape (dof,), to their distance from obstacles, m; for the criterion
            of the same name.
        free: rotations of the TCP that the pose leaves free: none, one or all three.

    Raises:
        UnreachableError: no joint angles were found; reports the reason and the smallest distance of the TCP.
    """
    arm, row = model.kinematics(free), row_of(pose)
    if criterion is Criterion.CLEARANCE or not (arm.closed_form or criterion is Criterion.NEAREST):
        return inverse_all(model, pose, seed, criterion, clearance, CLEARANCE_SPREAD, random_seed, free)[0]
    joints = arm.solve(row, seed, COMPILED[criterion], random_seed)
    if joints is None:
        raise out_of_reach(model, pose, seed, random_seed, free)
    if criterion is Criterion.NEAREST and arm.is_vague(joints):
        # At such joints, rounding errors move the solution of a closed form. A descent ends near the seed.
        near = solve_near(model, pose, seed)
        if near.solved and np.linalg.norm(near.joints - seed) < np.linalg.norm(joints - seed):
            return near.joints
    return joints


def inverse_all(
    model: RobotModel,
    pose: Pose,
    seed: Array | None = None,
    criterion: Criterion = Criterion.NEAREST,
    clearance: Clearance | None = None,
    spread: int = 1,
    random_seed: int = 0,
    free: tuple[FreeAxis, ...] = (),
) -> list[Array]:
    """Distinct joint angles that bring the TCP to a pose, best first. Each has shape (dof,), in rad.

    With a closed form these are the best solutions of each branch in each permitted interval of arm angles.
    Otherwise they are the results of descents from random starts.

    Args:
        seed: joint angles from which the distance of a solution is measured; by default the middle of the
            limits.
        spread: for an S-R-S arm, number of solutions per interval, evenly spaced along the arm angle.
        free: see `inverse`.

    Raises:
        UnreachableError: no joint angles were found; reports the reason and the smallest distance of the TCP.
    """
    limits = model.limits
    arm, row = model.kinematics(free), row_of(pose)
    near = 0.5 * (limits.min_position + limits.max_position) if seed is None else seed
    found = arm.solve_all(row, near, COMPILED[criterion], SOLUTIONS, random_seed)
    if not found:
        raise out_of_reach(model, pose, near, random_seed, free)
    if spread > 1 and isinstance(arm, SrsArm):
        found += _along_the_arm_angle(arm, row, spread)
    if clearance is not None and criterion is Criterion.CLEARANCE:
        found.sort(key=clearance, reverse=True)
    elif criterion is Criterion.CLEARANCE:
        raise InputError("the criterion clearance needs a function that returns the clearance of joints")
    elif criterion is Criterion.NEAREST:
        return _distinct(by_distance(np.array(found), near))
    else:
        found.sort(key=lambda joints: _cost(model, joints, criterion))
    return _distinct(np.array(found))


def by_distance(rows: Array, seed: Array) -> Array:
    """The joint positions in `rows`, sorted by their distance from the seed. Shape: (n, dof)."""
    away = rows - seed
    return np.asarray(rows[np.argsort(np.sqrt([each.dot(each) for each in away]), kind="stable")])


def _distinct(rows: Array) -> list[Array]:
    """The rows without duplicates."""
    same = np.ones((len(rows), len(rows)), bool)
    for joint in rows.T:
        same &= np.abs(joint[:, None] - joint) <= APART_RAD
    before, kept = np.tril(same, -1), np.ones(len(rows), bool)
    for index in np.flatnonzero(before.any(axis=1)):
        kept[index] = not (before[index] & kept).any()
    return list(rows[kept])


def _along_the_arm_angle(arm: SrsArm, row: Array, spread: int) -> list[Array]:
    found = []
    for branch in range(arm.BRANCHES):
        for begin, end in arm.intervals(row, branch):
            for angle in np.linspace(begin, end, spread + 2)[1:-1]:
                joints = arm.joints(row, float(angle), branch)
                if joints is not None:
                    found.append(joints)
    return found


def _cost(model: RobotModel, joints: Array, criterion: Criterion) -> float:
    """The cost of joint positions, either by manipulability or by distance from the joint limits."""
    if criterion is Criterion.MANIPULABILITY:
        return -model.inverse_kinematics.manipulability(joints)
    limits = model.limits
    middle = 0.5 * (limits.min_position + limits.max_position)
    return float(np.abs((joints - middle) / (limits.max_position - middle)).max())


def continued(model: RobotModel, pose: Pose, joints: Array) -> Array:
    """Joint angles for a pose, on the same branch of the inverse kinematics as `joints`. Shape: (dof,), in
    rad.

    A distant pose is approached on a straight line, in pieces, so that the branch cannot change unnoticed.

    Raises:
        UnreachableError: the pose is too far away, out of reach, or only reachable on a different branch.
    """
    here = model.forward(joints)
    turn = np.array(quaternion.between(here.quaternion.tolist(), pose.quaternion.tolist()))
    way, angle = pose.position - here.position, float(np.linalg.norm(turn))
    pieces = max(1, math.ceil(float(np.linalg.norm(way)) / PIECE_M), math.ceil(angle / PIECE_RAD))
    if pieces > MAX_PIECES:
        raise UnreachableError(
            f"the pose is {float(np.linalg.norm(way)):.3f} m and {np.degrees(angle):.0f} degrees from "
            f"the last pose, allowed: {MAX_PIECES * PIECE_M:g} m and "
            f"{np.degrees(MAX_PIECES * PIECE_RAD):.0f} degrees"
        )
    for piece in range(1, pieces + 1):
        share = piece / pieces
        between = pose
        if piece < pieces:
            part = quaternion.product(quaternion.exp((share * turn).tolist()), here.quaternion.tolist())
            between = Pose(here.position + share * way, np.array(part))
        descent = solve_near(model, between, joints, STEPS_ALONG)
        if not descent.solved:
            raise UnreachableError(
                f"the pose is out of reach from the current position: the TCP gets as near as "
                f"{apart(descent.distance_m, descent.angle_rad)}"
            )
        step = float(np.abs(descent.joints - joints).max())
        if step > BRANCH_RAD:
            raise UnreachableError(
                f"the pose needs a joint to turn by {step:.3f} rad at once, so it is on another branch "
                "of the inverse kinematics, or at a singularity"
            )
        joints = descent.joints
    return joints
