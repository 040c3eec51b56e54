"""Orientations: KUKA ABC angles and quaternions (w, x, y, z).

KUKA's ABC turns about z by A, then about the new y by B, then about the new x by C, so that
R = Rz(A) Ry(B) Rx(C).
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.spatial.transform import Rotation

from cobot.types import Array, Pose


def rotation(quaternion: Array) -> Rotation:
    """scipy's rotation for a (w, x, y, z) quaternion."""
    return Rotation.from_quat(quaternion, scalar_first=True)


def quaternion_from_abc(a: float, b: float, c: float) -> Array:
    """(w, x, y, z) for KUKA angles in rad."""
    return np.asarray(Rotation.from_euler("ZYX", [a, b, c]).as_quat(scalar_first=True), dtype=np.float64)


def abc_from_quaternion(quaternion: Array) -> Array:
    """(A, B, C) in rad, B in [−π/2, π/2]; at B = ±π/2, where A and C are not unique, C is 0."""
    with warnings.catch_warnings():  # scipy warns of the gimbal lock that the docstring states
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(rotation(quaternion).as_euler("ZYX"), dtype=np.float64)


def pose_from_abc(x: float, y: float, z: float, a: float, b: float, c: float) -> Pose:
    """A pose from metres and KUKA angles in rad."""
    return Pose(np.array([x, y, z]), quaternion_from_abc(a, b, c))


def angle_between(first: Array, second: Array) -> float:
    """The angle in rad of the rotation that takes one (w, x, y, z) orientation to the other."""
    return float((rotation(first).inv() * rotation(second)).magnitude())
