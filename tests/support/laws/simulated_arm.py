"""What the simulated arm computes in a cycle, stated in numpy for many states at once.

All arrays have a state per row: joint vectors are shape (n, dof), wrenches (n, 6), Jacobians (n, 6, dof),
inertias (n, dof, dof). SI units.
"""

from __future__ import annotations

import numpy as np

from cobot.types import Array

NATURAL_FREQUENCY_RAD_S, DAMPING_RATIO = 60.0, 0.7
OBSERVER_HZ, MIN_SINGULAR = 100.0, 0.01
NULL_STIFFNESS_SHARE = 0.04
MIN_SQUARED_FREQUENCY = 1.0


def times(matrices: Array, vectors: Array) -> Array:
    """A matrix by a vector, in each row."""
    return np.einsum("nij,nj->ni", matrices, vectors)


def transposed(matrices: Array) -> Array:
    return np.swapaxes(matrices, 1, 2)


def stiff_pull(error: Array, velocity_error: Array, inertia: Array) -> Array:
    """Torques of position control, in which M⁻¹ tau is the same for every arm.

    Args:
        error, velocity_error: commanded less measured; the measured velocity is half a period old.
    """
    acceleration = NATURAL_FREQUENCY_RAD_S**2 * error
    acceleration += 2.0 * DAMPING_RATIO * NATURAL_FREQUENCY_RAD_S * velocity_error
    return times(inertia, acceleration)


def dampers(velocity_error: Array, mobility: Array, stiffness: Array, damping_ratio: Array) -> Array:
    """Of springs that act on an inertia, the inverse of `mobility`, by double diagonalisation."""
    roots = np.sqrt(stiffness)
    values, axes = np.linalg.eigh(mobility * roots[..., :, None] * roots[..., None, :])
    scaled = np.sqrt(2.0 * damping_ratio) * roots
    along = times(transposed(axes), scaled * velocity_error)
    return scaled * times(axes, along / np.sqrt(np.maximum(values, MIN_SQUARED_FREQUENCY)))


def joint_springs(
    error: Array, velocity_error: Array, inertia: Array, stiffness: Array, damping_ratio: Array
) -> Array:
    """tau = K (q_cmd - q) + D (dq_cmd - dq)."""
    return stiffness * error + dampers(velocity_error, np.linalg.inv(inertia), stiffness, damping_ratio)


def tcp_springs(
    pose_error: Array,
    velocity_error: Array,
    null_torques: Array,
    inertia: Array,
    jacobian: Array,
    stiffness: Array,
    damping_ratio: Array,
    stiffest: Array,
) -> Array:
    """tau = J' (K e + D J (dq_cmd - dq)) + (1 - J' L J M⁻¹) tau_null."""
    response = transposed(np.linalg.solve(inertia, transposed(jacobian)))
    mobility = response @ transposed(jacobian)
    damping = dampers(times(jacobian, velocity_error), mobility, stiffness, damping_ratio)
    heavier = mobility + MIN_SQUARED_FREQUENCY * np.diag(1.0 / stiffest)
    kept = np.linalg.solve(heavier, times(response, null_torques)[:, :, None])[:, :, 0]
    return null_torques + times(transposed(jacobian), stiffness * pose_error + damping - kept)


def observed_effort(
    effort: Array,
    momentum: Array,
    bias: Array,
    damping: Array,
    torque: Array,
    friction: Array,
    period_s: float,
) -> Array:
    """The momentum observer's torques after a period.

    Args:
        effort: before it.
        momentum: M (dq' - dq).
        bias, damping, torque, friction: the joints' torques in it.
    """
    share = 1.0 - np.exp(-OBSERVER_HZ * period_s)
    external = momentum / period_s + bias + damping - torque - friction
    return share * external + (1.0 - share) * effort


def felt_wrench(effort: Array, jacobian: Array) -> Array:
    """The damped least squares' solution of J' wrench = effort."""
    square = jacobian @ transposed(jacobian) + MIN_SINGULAR**2 * np.eye(6)
    return np.linalg.solve(square, times(jacobian, effort)[:, :, None])[:, :, 0]
