"""Rotation matrices for code that runs only once, when a robot's files are read."""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.types import Array


def matrix_of(quaternion: Array) -> Array:
    """The rotation matrix of a unit quaternion (w, x, y, z), shape (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def with_z_along(axis: Array) -> Array:
    """A rotation matrix whose last column is the axis direction, shape (3, 3)."""
    axis = axis / np.linalg.norm(axis)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(axis, across), axis])
