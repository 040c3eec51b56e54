"""What `cobot.planners.derivatives` does, said with numpy; the TCP's derivatives are differences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot.robot.chain import Chain
from cobot.types import Array

STEP = 2e-3
NEAR = STEP * np.arange(-3.0, 4.0)
FIRST = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * STEP)
SECOND = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / (180.0 * STEP**2)


def motions(chain: Chain, polynomials: Array) -> Array:
    """The TCP's twist and two derivatives, (3, n, 6), at 0 of joints that are cubics, (4, n, dof)."""
    twists = []
    for s in NEAR:
        powers = np.array([1.0, s, s**2 / 2.0, s**3 / 6.0])
        rates = np.array([0.0, 1.0, s, s**2 / 2.0])
        joints, velocities = (np.tensordot(each, polynomials, 1) for each in (powers, rates))
        twists.append(chain.twists(joints, velocities))
    weights = np.array([np.eye(7)[3], FIRST, SECOND])
    return np.tensordot(weights, np.array(twists), 1)


def frame(motion: Array) -> tuple[Array, Array, Array, Array]:
    """Speed, what of the acceleration is across, tangent and normal, of derivatives of shape (3, n, 3)."""
    speed = np.linalg.norm(motion[0], axis=1)
    tangent = motion[0] / np.maximum(speed, 1e-12)[:, None]
    across = motion[1] - (motion[1] * tangent).sum(axis=1)[:, None] * tangent
    bend = np.linalg.norm(across, axis=1)
    return speed, bend, tangent, across / np.maximum(bend, 1e-12)[:, None]


def coordinates(
    derivatives: Array, twists: Array, fastest: Array, directions: Sequence[Array]
) -> tuple[Array, Array]:
    """The derivatives of all coordinates, and the least time per s."""
    dof = derivatives.shape[2]
    slowness = (np.abs(derivatives[1]) / fastest[:, :dof]).max(axis=1)
    rows = [derivatives[1:]]
    for part, angles in enumerate(directions):
        motion = twists[:, :, 3 * part : 3 * part + 3]
        speed, _, tangent, normal = frame(motion)
        slowness = np.maximum(slowness, speed / fastest[:, dof + part])
        along, across = (motion * tangent).sum(axis=2), (motion * normal).sum(axis=2)
        rows.append(along[:, :, None] * np.cos(angles) + across[:, :, None] * np.sin(angles))
    return np.concatenate(rows, axis=2), slowness


def chained(derivatives: Array, law: Array) -> Array:
    """Derivatives by τ of derivatives by s and of s(τ): Faà di Bruno's formula."""
    first, second, third = derivatives
    u, v, w = law[1][:, None], law[2][:, None], law[3][:, None]
    return np.array([first * u, second * u**2 + first * v, third * u**3 + 3.0 * second * u * v + first * w])
