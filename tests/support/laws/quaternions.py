"""What `cobot.robot.quaternion` computes, in numpy, on columns: shape (4, n) and (3, n)."""

from __future__ import annotations

import numpy as np

from cobot.types import Array

SMALL_RAD = 1e-4


def product(a: Array, b: Array) -> Array:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def conjugate(q: Array) -> Array:
    return np.vstack([q[:1], -q[1:]])


def normalised(q: Array) -> Array:
    return np.asarray(q / np.linalg.norm(q, axis=0))


def cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def exp(r: Array) -> Array:
    angle = np.linalg.norm(r, axis=0)
    small = angle <= SMALL_RAD
    scale = np.where(small, 0.5 - angle**2 / 48.0, np.sin(0.5 * angle) / np.where(small, 1.0, angle))
    return np.vstack([np.cos(0.5 * angle), r * scale])


def log(q: Array) -> Array:
    w, *v = np.where(q[0] >= 0.0, q, -q)
    sine = np.linalg.norm(v, axis=0)
    small = sine <= SMALL_RAD * w
    by_angle = 2.0 * np.arctan2(sine, w) / np.where(small, 1.0, sine)
    positive = np.where(w > 0.0, w, 1.0)
    series = np.where(w > 0.0, 2.0 / positive - 2.0 * sine**2 / (3.0 * positive**3), 0.0)
    return np.asarray(np.array(v) * np.where(small, series, by_angle))


def between(start: Array, end: Array) -> Array:
    return log(product(end, conjugate(start)))


def angular_velocity(r: Array, rate: Array) -> Array:
    a, b = _jacobian(r)
    return _series(r, rate, a, b)


def rotation_rate(r: Array, velocity: Array) -> Array:
    angle = np.linalg.norm(r, axis=0)
    usual = np.where(angle < SMALL_RAD, 1.0, angle)
    c = np.where(angle < SMALL_RAD, 1.0 / 12.0, 1.0 / usual**2 - 0.5 / (usual * np.tan(0.5 * usual)))
    return _series(r, velocity, -0.5, c)


def angular_acceleration(r: Array, rate: Array, second: Array) -> Array:
    a, b = _jacobian(r)
    return _series(r, second, a, b) + b * cross(rate, cross(r, rate))


def rotated(q: Array, v: Array) -> Array:
    u = cross(q[1:], v)
    return np.asarray(v + 2.0 * q[0] * u + 2.0 * cross(q[1:], u))


def _jacobian(r: Array) -> tuple[Array, Array]:
    square = np.sum(r**2, axis=0)
    angle = np.sqrt(square)
    usual = np.where(angle < 0.01, 1.0, angle)
    a = np.where(angle < 0.01, 0.5 - square / 24.0, (1.0 - np.cos(usual)) / usual**2)
    b = np.where(angle < 0.01, 1.0 / 6.0 - square / 120.0, (usual - np.sin(usual)) / usual**3)
    return a, b


def _series(r: Array, v: Array, a: Array | float, b: Array) -> Array:
    u = cross(r, v)
    return np.asarray(v + a * u + b * cross(r, u))
