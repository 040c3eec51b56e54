"""What `rtloop.sources.target_checks` computes, in numpy, of many targets at once: (n, dof) and (n, 7)."""

from __future__ import annotations

import numpy as np
from laws import quaternions

from cobot.types import Array

JOINT_VELOCITY, LINEAR_VELOCITY, ANGULAR_VELOCITY = 10.0, 10.0, 50.0
INTERVALS_S = (0.001, 0.1)
"""What the interval between two commands is taken for, at the least and at the most."""
SLACK_S = 0.01


def clamped_interval(interval_s: Array | float) -> Array:
    return np.clip(interval_s, *INTERVALS_S)


def joint_steps(
    target: Array, last: Array, interval_s: Array, max_velocity: Array | None
) -> tuple[Array, Array, Array]:
    """The first joint that jumps, -1 for none, shape (n,); and each one's step and what is allowed, rad."""
    within_s = clamped_interval(interval_s)[:, None]
    step = np.abs(target - last)
    allowed = np.broadcast_to(JOINT_VELOCITY * within_s, step.shape)
    if max_velocity is not None:
        allowed = np.minimum(allowed, max_velocity * (within_s + SLACK_S))
    inside = step <= allowed  # false for what is no number, too
    return np.where(inside.all(axis=1), -1, inside.argmin(axis=1)), step, allowed


def joint_jumps(target: Array, last: Array, interval_s: float, max_velocity: Array) -> bool:
    """Of one target, shape (dof,)."""
    joint, _, _ = joint_steps(target[None], last[None], np.array([interval_s]), max_velocity)
    return bool(joint[0] >= 0)


def distance(pose: Array, last: Array) -> Array:
    return np.asarray(np.linalg.norm(pose[:, :3] - last[:, :3], axis=1))


def angle(pose: Array, last: Array) -> Array:
    """In [0, π], of orientations in the last four columns."""
    return np.asarray(np.linalg.norm(quaternions.between(pose[:, -4:].T, last[:, -4:].T), axis=0))


def pose_jumps(pose: Array, last: Array, interval_s: float, max_linear: float, max_angular: float) -> bool:
    """Of one pose, shape (7,)."""
    within_s = clamped_interval(interval_s)
    near = distance(pose[None], last[None])[0] <= max_linear * within_s
    turned = angle(pose[None], last[None])[0] <= max_angular * within_s
    return not (near and turned)
