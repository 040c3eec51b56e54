"""Orientations as quaternions (w, x, y, z), in Python alone: a client has neither compiled modules nor scipy.

`cobot.robot.quaternion` and `cobot.robot.frames` say the same; a test holds them together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
GIMBAL_LOCK = 1e-7
"""Where cos B is smaller, only the sum or the difference of A and C is known."""


def product(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """The rotation b, then a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def inverse(q: Sequence[float]) -> Quaternion:
    """Of a unit quaternion."""
    w, x, y, z = q
    return w, -x, -y, -z


def normalised(q: Sequence[float]) -> Quaternion:
    """The unit quaternion in the direction of one that is not zero."""
    w, x, y, z = q
    length = math.hypot(w, x, y, z)
    return w / length, x / length, y / length, z / length


def rotated(q: Sequence[float], v: Sequence[float]) -> Vector:
    """A vector, turned by a unit quaternion."""
    _, x, y, z = product(product(q, (0.0, *v)), inverse(q))
    return x, y, z


def kuka_angles(q: Sequence[float]) -> Vector:
    """(A, B, C) of a unit quaternion, rad: R = Rz(A) Ry(B) Rx(C), B in [−π/2, π/2].

    At B = ±π/2, where A and C are not unique, C is 0.
    """
    (xx, yx, zx), (xy, yy, zy), (_, _, zz) = (rotated(q, axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    cos_b = math.hypot(xx, yx)
    b = math.atan2(-zx, cos_b)
    if cos_b < GIMBAL_LOCK:
        return math.atan2(-xy, yy), b, 0.0
    return math.atan2(yx, xx), b, math.atan2(zy, zz)
