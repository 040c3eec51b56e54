"""Inverse kinematics: numeric, damped least squares with joint limits and restarts.

The step is Levenberg-Marquardt's with the damping of Sugihara (doi 10.1109/TRO.2011.2148230): it
shrinks with the remaining error, so that the last steps are Newton's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cobot.errors import UnreachableError
from cobot.robot import quaternion
from cobot.robot.frames import rotation_matrix
from cobot.robot.model import RobotModel
from cobot.types import Array, Pose

POSITION_TOLERANCE_M = 1e-9
ANGLE_TOLERANCE_RAD = 1e-9
STEPS = 60
ATTEMPTS = 60
ENOUGH_SOLUTIONS = 4
"""After so many solutions from random starts the nearest one is taken."""
APART_RAD = 1e-3
LARGEST_STEP_RAD = 0.5
BIAS = 1e-5
PIECE_M, PIECE_RAD = 0.05, 0.2
MAX_PIECES = 10
STEPS_ALONG = 20
BRANCH_RAD = 0.5
"""A continued motion is gone in pieces of this length, m and rad, no more than so many, each in so many
steps; in none may a joint turn further than the last of these, rad."""
PATIENCE = 12
"""Steps without a tenth of progress after which a descent is given up."""


@dataclass(frozen=True, slots=True)
class Descent:
    """Where one descent ended: at a solution, or as near to it as it came (m, rad)."""

    joints: Array
    solved: bool
    distance_m: float
    angle_rad: float


def inverse(model: RobotModel, pose: Pose, seed: Array, random_seed: int = 0) -> Array:
    """Joint angles, shape (dof,), rad, that bring the TCP to a pose: of those found, the nearest to `seed`.

    Raises:
        UnreachableError: none found; with how near the TCP came.
    """
    nearest = solve_near(model, pose, seed)
    if nearest.solved:
        return nearest.joints
    found = _from_anywhere(model, pose, nearest, random_seed)
    return min(found, key=lambda joints: float(np.linalg.norm(joints - seed)))


def inverse_all(model: RobotModel, pose: Pose, random_seed: int = 0) -> list[Array]:
    """Several joint angles, each shape (dof,), rad, that bring the TCP to a pose, apart from each other.

    Raises:
        UnreachableError: none found; with how near the TCP came.
    """
    middle = 0.5 * (model.limits.min_position + model.limits.max_position)
    nearest = solve_near(model, pose, middle)
    found = [nearest.joints] if nearest.solved else []
    found += _from_anywhere(model, pose, nearest, random_seed)
    apart: list[Array] = []
    for joints in found:
        if all(np.abs(joints - other).max() > APART_RAD for other in apart):
            apart.append(joints)
    return apart


def _from_anywhere(model: RobotModel, pose: Pose, nearest: Descent, random_seed: int) -> list[Array]:
    """Solutions from random starts; `nearest` is what is known before."""
    random = np.random.default_rng(random_seed)
    limits = model.limits
    found: list[Array] = []
    for _ in range(ATTEMPTS):
        descent = solve_near(model, pose, random.uniform(limits.min_position, limits.max_position))
        if descent.solved:
            found.append(descent.joints)
            if len(found) == ENOUGH_SOLUTIONS:
                break
        elif descent.distance_m + descent.angle_rad < nearest.distance_m + nearest.angle_rad:
            nearest = descent
    if not found and not nearest.solved:
        x, y, z = pose.position
        raise UnreachableError(
            f"the TCP cannot reach x {x:.6g}, y {y:.6g}, z {z:.6g} m in this orientation: "
            f"it comes as near as {1e3 * nearest.distance_m:.4g} mm and "
            f"{np.degrees(nearest.angle_rad):.2f} degrees"
        )
    return found


def continued(model: RobotModel, pose: Pose, joints: Array) -> Array:
    """Joint angles, shape (dof,), rad, at a pose, on the branch on which the arm stands with `joints`.

    What is far away is gone to on a straight line, in pieces, so that the branch cannot change unnoticed.

    Raises:
        UnreachableError: it is too far, out of reach, or only another branch leads there.
    """
    here = model.forward(joints)
    turn = np.array(quaternion.between(here.quaternion.tolist(), pose.quaternion.tolist()))
    way, angle = pose.position - here.position, float(np.linalg.norm(turn))
    pieces = max(1, math.ceil(float(np.linalg.norm(way)) / PIECE_M), math.ceil(angle / PIECE_RAD))
    if pieces > MAX_PIECES:
        raise UnreachableError(
            f"the pose is {float(np.linalg.norm(way)):.3f} m and {np.degrees(angle):.0f} degrees from the "
            f"last one, possible are {MAX_PIECES * PIECE_M:g} m and "
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
                f"the pose is out of reach from where the arm is: it comes as near as "
                f"{1e3 * descent.distance_m:.4g} mm and {np.degrees(descent.angle_rad):.2f} degrees"
            )
        step = float(np.abs(descent.joints - joints).max())
        if step > BRANCH_RAD:
            raise UnreachableError(
                f"the pose needs a joint to turn by {step:.3f} rad at once: it is on another branch of the "
                "inverse kinematics, or at a singularity"
            )
        joints = descent.joints
    return joints


def solve_near(model: RobotModel, pose: Pose, seed: Array, steps: int = STEPS) -> Descent:
    """One descent from `seed`, of so many steps at the most: the way to stay continuous along a path."""
    limits = model.limits
    target = rotation_matrix(pose.quaternion)
    joints = np.clip(seed, limits.min_position, limits.max_position)
    error = np.empty(6)
    eye = np.eye(model.dof)
    best = Descent(joints, False, np.inf, np.inf)
    stalled = 0
    for _ in range(steps):
        position, turn, jacobian = model.forward_and_jacobian(joints)
        error[:3] = pose.position - position
        error[3:] = _rotation_vector(target @ turn.T)
        distance_m, angle_rad = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        if distance_m < POSITION_TOLERANCE_M and angle_rad < ANGLE_TOLERANCE_RAD:
            return Descent(joints, True, distance_m, angle_rad)
        remaining, least = distance_m + angle_rad, best.distance_m + best.angle_rad
        stalled = stalled + 1 if remaining > 0.9 * least else 0
        if remaining < least:
            best = Descent(joints, False, distance_m, angle_rad)
        if stalled > PATIENCE:
            break
        # A joint that stands at its limit and would be pushed beyond takes no part in this step.
        gradient = jacobian.T @ error
        held = ((joints <= limits.min_position) & (gradient < 0)) | (
            (joints >= limits.max_position) & (gradient > 0)
        )
        free = np.where(held, 0.0, 1.0)
        reduced = jacobian * free
        damping = 0.5 * float(error @ error) + BIAS * min(1.0, remaining)
        step = np.linalg.solve(reduced.T @ reduced + damping * eye, gradient * free)
        largest = float(np.abs(step).max())
        if largest > LARGEST_STEP_RAD:
            step *= LARGEST_STEP_RAD / largest
        joints = np.clip(joints + step, limits.min_position, limits.max_position)
    return best


def _rotation_vector(matrix: Array) -> Array:
    """Axis times angle of a rotation matrix; scipy's takes ten times as long, in the inner loop."""
    axis = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine, cosine = 0.5 * float(np.linalg.norm(axis)), 0.5 * (float(np.trace(matrix)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-9:
        return axis * (0.5 * angle / sine)
    if cosine > 0.0:
        return 0.5 * axis
    # Half a turn: the axis is the largest column of R + 1.
    columns = matrix + np.eye(3)
    column = columns[:, int(np.argmax(np.abs(np.diag(columns))))]
    return np.asarray(np.pi * column / np.linalg.norm(column))
