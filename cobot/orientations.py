"""Orientations as quaternions (w, x, y, z), in pure Python, because clients have neither compiled modules nor
scipy.

The compiled cycle uses `cobot.robot.quaternion`. A test compares both modules.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
GIMBAL_LOCK = 1e-7
"""If cos B is below this, only the sum or the difference of A and C is defined."""


def product(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """Multiply two quaternions. The product is the rotation b followed by the rotation a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def inverse(q: Sequence[float]) -> Quaternion:
    """Invert the rotation of a unit quaternion."""
    w, x, y, z = q
    return w, -x, -y, -z


def normalised(q: Sequence[float]) -> Quaternion:
    """Return the unit quaternion of the same rotation. The argument must not be zero."""
    w, x, y, z = q
    length = math.hypot(w, x, y, z)
    return w / length, x / length, y / length, z / length


def rotated(q: Sequence[float], v: Sequence[float]) -> Vector:
    """Rotate a vector by a unit quaternion."""
    _, x, y, z = product(product(q, (0.0, *v)), inverse(q))
    return x, y, z


def matrix(q: Sequence[float]) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the rotation matrix of a unit quaternion."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def kuka_angles(q: Sequence[float]) -> Vector:
    """Return the KUKA angles (A, B, C) of a unit quaternion, rad. R = Rz(A) Ry(B) Rx(C), with B in [−π/2,
    π/2].

    At B = ±π/2, where A and C are not unique, C is 0.
    """
    (xx, xy, _), (yx, yy, _), (zx, zy, zz) = matrix(q)
    cos_b = math.hypot(xx, yx)
    b = math.atan2(-zx, cos_b)
    if cos_b < GIMBAL_LOCK:
        return math.atan2(-xy, yy), b, 0.0
    return math.atan2(yx, xx), b, math.atan2(zy, zz)


def kuka_quaternion(a: float, b: float, c: float) -> Quaternion:
    """Return the unit quaternion for KUKA angles, rad. R = Rz(A) Ry(B) Rx(C)."""
    about_z = (math.cos(a / 2.0), 0.0, 0.0, math.sin(a / 2.0))
    about_y = (math.cos(b / 2.0), 0.0, math.sin(b / 2.0), 0.0)
    about_x = (math.cos(c / 2.0), math.sin(c / 2.0), 0.0, 0.0)
    return product(product(about_z, about_y), about_x)
