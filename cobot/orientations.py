"""Orientations as quaternions (w, x, y, z), in pure Python, because clients have neither compiled modules nor
scipy.

The compiled cycle uses `cobot.robot.quaternion`. A test compares both modules.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
GIMBAL_LOCK_RAD = 1e-7
"""If B is this close to ±π/2, it is treated as ±π/2."""


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

    Source: E. Bernardes, S. Viollet, "Quaternion to Euler angles conversion: A direct, general and
    computationally efficient method", PLoS ONE 17(11), 2022. Unlike a conversion by the rotation matrix, A +
    C and A − C are as accurate near B = ±π/2 as elsewhere.
    """
    w, x, y, z = q
    half_sum, half_difference = math.atan2(x + z, w - y), math.atan2(z - x, w + y)
    b = 2.0 * math.atan2(math.hypot(w + y, z - x), math.hypot(w - y, x + z)) - 0.5 * math.pi
    if 0.5 * math.pi - abs(b) > GIMBAL_LOCK_RAD:
        a, c = half_sum + half_difference, half_sum - half_difference
    else:
        a, c = 2.0 * (half_difference if b > 0.0 else half_sum), 0.0
    return math.remainder(a, math.tau), b, math.remainder(c, math.tau)


def kuka_quaternion(a: float, b: float, c: float) -> Quaternion:
    """Return the unit quaternion for KUKA angles, rad. R = Rz(A) Ry(B) Rx(C)."""
    (cz, sz), (cy, sy), (cx, sx) = ((math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (a, b, c))
    return (
        cz * cy * cx + sz * sy * sx,
        cz * cy * sx - sz * sy * cx,
        cz * sy * cx + sz * cy * sx,
        sz * cy * cx - cz * sy * sx,
    )
