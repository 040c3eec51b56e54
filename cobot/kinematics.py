"""Inverse kinematics: numeric, damped least squares with joint limits and restarts.

The step is Levenberg-Marquardt's with the damping of Sugihara (doi 10.1109/TRO.2011.2148230): it
shrinks with the remaining error, so that the last steps are Newton's.
"""

from __future__ import annotations

import numpy as np

from cobot.errors import UnreachableError
from cobot.frames import rotation
from cobot.model import RobotModel
from cobot.types import Array, Pose

POSITION_TOLERANCE_M = 1e-7
ANGLE_TOLERANCE_RAD = 1e-7
STEPS = 60
ATTEMPTS = 60
ENOUGH_SOLUTIONS = 4
"""After so many solutions from random starts the nearest one is taken."""
LARGEST_STEP_RAD = 0.5
BIAS = 1e-5


def inverse(model: RobotModel, pose: Pose, seed: Array, random_seed: int = 0) -> Array:
    """Joint angles, shape (dof,), rad, that bring the TCP to a pose: of those found, the nearest to `seed`.

    Raises:
        UnreachableError: none found; with how near the TCP came.
    """
    solution, nearest = _descend(model, pose, seed)
    if solution is not None:
        return solution
    random = np.random.default_rng(random_seed)
    limits = model.limits
    found: list[Array] = []
    for _ in range(ATTEMPTS):
        start = random.uniform(limits.min_position, limits.max_position)
        solution, error = _descend(model, pose, start)
        nearest = min(nearest, error)
        if solution is not None:
            found.append(solution)
            if len(found) == ENOUGH_SOLUTIONS:
                break
    if not found:
        x, y, z = pose.position
        raise UnreachableError(
            f"the TCP cannot reach x {x:.4f}, y {y:.4f}, z {z:.4f} m in this orientation: "
            f"it comes as near as {1e3 * nearest[0]:.1f} mm and {np.degrees(nearest[1]):.2f} degrees"
        )
    return min(found, key=lambda joints: float(np.linalg.norm(joints - seed)))


def solve_near(model: RobotModel, pose: Pose, seed: Array) -> tuple[Array | None, tuple[float, float]]:
    """One descent from `seed`, for following a path: the solution or None, and the remaining (m, rad)."""
    return _descend(model, pose, seed)


def _descend(model: RobotModel, pose: Pose, seed: Array) -> tuple[Array | None, tuple[float, float]]:
    limits = model.limits
    target = rotation(pose.quaternion).as_matrix()
    joints = np.clip(seed, limits.min_position, limits.max_position)
    error = np.empty(6)
    best = (np.inf, np.inf)
    eye = np.eye(model.dof)
    stalled = 0
    for _ in range(STEPS):
        position, turn, jacobian = model.forward_and_jacobian(joints)
        error[:3] = pose.position - position
        error[3:] = _rotation_vector(target @ turn.T)
        remaining = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        if remaining[0] < POSITION_TOLERANCE_M and remaining[1] < ANGLE_TOLERANCE_RAD:
            return joints, remaining
        stalled = stalled + 1 if sum(remaining) > 0.9 * sum(best) else 0
        best = min(best, remaining, key=sum)
        if stalled > 12:
            break
        # A joint that stands at its limit and would be pushed beyond takes no part in this step.
        gradient = jacobian.T @ error
        held = ((joints <= limits.min_position) & (gradient < 0)) | (
            (joints >= limits.max_position) & (gradient > 0)
        )
        free = np.where(held, 0.0, 1.0)
        reduced = jacobian * free
        damping = 0.5 * float(error @ error) + BIAS * min(1.0, sum(remaining))
        step = np.linalg.solve(reduced.T @ reduced + damping * eye, gradient * free)
        largest = float(np.abs(step).max())
        if largest > LARGEST_STEP_RAD:
            step *= LARGEST_STEP_RAD / largest
        joints = np.clip(joints + step, limits.min_position, limits.max_position)
    return None, best


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
