"""Orientations: KUKA ABC angles and quaternions (w, x, y, z).

KUKA's ABC angles turn about z by A, then about the new y by B, then about the new x by C:
R = Rz(A) Ry(B) Rx(C).
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, remainder, sin, tau

import numpy as np

from cobot.robot import quaternion as quaternions
from cobot.types import Array, Pose, vector

GIMBAL_LOCK_RAD = 1e-7
"""A value of B this close to ±π/2 counts as ±π/2."""


def quaternion_from_abc(a: float, b: float, c: float) -> Array:
    """Convert KUKA angles, rad, to a quaternion (w, x, y, z).

    Raises:
        InputError: an angle is not finite.
    """
    a, b, c = vector([a, b, c], 3, name="angles").tolist()
    about_z = (cos(0.5 * a), 0.0, 0.0, sin(0.5 * a))
    about_y = (cos(0.5 * b), 0.0, sin(0.5 * b), 0.0)
    about_x = (cos(0.5 * c), sin(0.5 * c), 0.0, 0.0)
    return np.array(quaternions.product(quaternions.product(about_z, about_y), about_x))


def abc_from_quaternion(quaternion: Array) -> Array:
    """Convert a quaternion to KUKA angles (A, B, C), rad, with B in [−π/2, π/2]. At B = ±π/2, where A and C
    are not unique, C is 0.

    Source: E. Bernardes, S. Viollet, "Quaternion to Euler angles conversion: A direct, general and
    computationally efficient method", PLoS ONE 17(11), 2022. Unlike a conversion by the rotation matrix, A +
    C and A − C are as accurate near B = ±π/2 as elsewhere.
    """
    w, x, y, z = quaternion.tolist()
    half_sum, half_difference = atan2(x + z, w - y), atan2(z - x, w + y)
    b = 2.0 * atan2(hypot(w + y, z - x), hypot(w - y, x + z)) - 0.5 * pi
    if 0.5 * pi - abs(b) > GIMBAL_LOCK_RAD:
        a, c = half_sum + half_difference, half_sum - half_difference
    else:
        a, c = 2.0 * (half_difference if b > 0.0 else half_sum), 0.0
    return np.array([remainder(a, tau), b, remainder(c, tau)])


def pose_from_abc(x: float, y: float, z: float, a: float, b: float, c: float) -> Pose:
    """Make a pose from a position in metres and KUKA angles in rad."""
    return Pose(np.array([x, y, z]), quaternion_from_abc(a, b, c))


def angle_between(first: Array, second: Array) -> float:
    """The angle, rad, of the rotation that takes one orientation to the other. Both are quaternions (w, x, y,
    z).
    """
    return hypot(*quaternions.between(first.tolist(), second.tolist()))
