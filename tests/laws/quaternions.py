"""Quaternions (w, x, y, z) and rotation vectors (rad) as plain floats, for the cycle.

On four numbers the standard library's mathematics is several times as fast as numpy's. Rotations are
applied from the left, q = exp(r) q0: rotation vectors and angular velocities are in the base frame.
Source of the Jacobian: J. Solà, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in
robotics", 2018, equations 145 and 146.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

SMALL_RAD = 1e-4
"""Below it a series to the second order is exact to the last bit, and quotients of small numbers are not."""


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


def conjugate(q: Sequence[float]) -> Quaternion:
    """The inverse of a unit quaternion."""
    return q[0], -q[1], -q[2], -q[3]


def normalised(q: Sequence[float]) -> Quaternion:
    """The unit quaternion in the direction of one that is not zero."""
    w, x, y, z = q
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return w * scale, x * scale, y * scale, z * scale


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    """The vector product."""
    ax, ay, az = a
    bx, by, bz = b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def exp(r: Sequence[float]) -> Quaternion:
    """The unit quaternion that turns by a rotation vector."""
    x, y, z = r
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * angle
    scale = math.sin(half) / angle if angle > SMALL_RAD else 0.5 - angle * angle / 48.0
    return math.cos(half), x * scale, y * scale, z * scale


def log(q: Sequence[float]) -> Vector:
    """The rotation vector of a quaternion of any sign and length, at most π long: the shorter way."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    sine = math.sqrt(x * x + y * y + z * z)
    if sine > SMALL_RAD * w:
        scale = 2.0 * math.atan2(sine, w) / sine
    else:
        scale = 2.0 / w - 2.0 * sine * sine / (3.0 * w * w * w) if w > 0.0 else 0.0
    return x * scale, y * scale, z * scale


def between(start: Sequence[float], end: Sequence[float]) -> Vector:
    """The rotation vector that takes one orientation to the other, the shorter way, in the base frame."""
    return log(product(end, conjugate(start)))


def angular_velocity(r: Sequence[float], rate: Sequence[float]) -> Vector:
    """Of exp(r) while r changes at a rate: the left Jacobian of SO(3) at r, times the rate."""
    a, b = _jacobian(r)
    return _series(r, rate, a, b)


def rotation_rate(r: Sequence[float], velocity: Sequence[float]) -> Vector:
    """The rate of r at which exp(r) turns with an angular velocity: the inverse; |r| below 2π."""
    square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    angle = math.sqrt(square)
    c = 1.0 / 12.0 if angle < SMALL_RAD else 1.0 / square - 0.5 / (angle * math.tan(0.5 * angle))
    return _series(r, velocity, -0.5, c)


def angular_acceleration(r: Sequence[float], rate: Sequence[float], second: Sequence[float]) -> Vector:
    """Of exp(r), from the first two derivatives of r, without the terms of second order in r that come from
    the change of the Jacobian: they are below |r|² |rate|² / 12, and zero about a fixed axis."""
    a, b = _jacobian(r)
    x, y, z = _series(r, second, a, b)
    u, v, w = cross(rate, cross(r, rate))
    return x + b * u, y + b * v, z + b * w


def _jacobian(r: Sequence[float]) -> tuple[float, float]:
    """The factors of [r]× and [r]×² in the left Jacobian."""
    square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    angle = math.sqrt(square)
    if angle < 0.01:
        return 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    return (1.0 - math.cos(angle)) / square, (angle - math.sin(angle)) / (square * angle)


def _series(r: Sequence[float], v: Sequence[float], a: float, b: float) -> Vector:
    """v + a r × v + b r × (r × v)."""
    u = cross(r, v)
    w = cross(r, u)
    return v[0] + a * u[0] + b * w[0], v[1] + a * u[1] + b * w[1], v[2] + a * u[2] + b * w[2]


def rotated(q: Sequence[float], v: Sequence[float]) -> Vector:
    """A vector, turned by a unit quaternion."""
    u = cross(q[1:], v)
    w = cross(q[1:], u)
    s = 2.0 * q[0]
    return v[0] + s * u[0] + 2.0 * w[0], v[1] + s * u[1] + 2.0 * w[1], v[2] + s * u[2] + 2.0 * w[2]
