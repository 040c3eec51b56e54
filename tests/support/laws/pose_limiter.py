"""What `rtloop.generators.pose_limiter` computes, in numpy.

The profiles are those of `rtloop.generators.otg`, which has Ruckig for its oracle: of states that are all but
zero Ruckig itself makes profiles that are off by its tolerances, and here there are many.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from laws.quaternions import cross

from cobot.robot.quaternion import between, exp, normalised, product
from cobot.types import Array, CartesianLimits
from rtloop.generators import otg

TOLERANCE, REST = 1e-3, 1e-9
MIN_SHARE, LEAD_S, TURN, TURNING = 0.25, 0.2, 0.25, 2.0
SHARE, ALONG = 0.9, 0.9
MIN_ACROSS = 1e-3


@dataclass
class _Course:
    """Axes of a pursuit, one a row, with their shares of the limits, and what they were chosen for."""

    axes: Array
    shares: Array
    expected: Array
    scale: float
    strayed: Array = field(default_factory=lambda: np.zeros(3))


class PoseLimiter:
    """Follows a pose within the limits."""

    def __init__(self, period_s: float, limits: CartesianLimits) -> None:
        self.pose, self.twist = np.array([0.0, 0, 0, 1, 0, 0, 0]), np.zeros(6)
        self.limited = False
        self._period_s = period_s
        self._most = np.array(
            [
                [limits.max_linear_velocity, limits.max_angular_velocity],
                [limits.max_linear_acceleration, limits.max_angular_acceleration],
                [limits.max_linear_jerk, limits.max_angular_jerk],
            ]
        )
        self.acceleration, self.speed = np.zeros(6), np.zeros(6)
        self._last = self.pose.copy()
        self._own = np.zeros(6)
        self._differing = 0
        self._courses: list[_Course | None] = [None, None]

    def begin(self, pose: Array, twist: Array) -> None:
        self.pose[:] = self._last[:] = pose
        self.twist[:] = self._own[:] = self.speed[:] = twist
        self.acceleration[:] = 0.0
        self._differing = 0
        self._courses = [None, None]
        self.limited = False

    def step(self, pose: Array) -> None:
        step = _way(self.pose, pose)
        velocity = step / self._period_s
        rate = (velocity - self.twist) / self._period_s
        change = (rate - self.acceleration) / self._period_s
        own, own_rate = velocity, rate
        if self._differing:
            self._differing -= 1
            own = _way(self._last, pose) / self._period_s
            own_rate = (own - self._own) / self._period_s
            gap = (velocity - own) / self._period_s
            changes = [change, *np.array([rate - own_rate, rate - own_rate + gap, gap]) / self._period_s]
            change = np.abs(changes).max(axis=0)
        self._last, self._own = pose.copy(), own
        norms = _norms(np.array([velocity, rate, change]))
        self.limited = not bool((norms <= (1.0 + TOLERANCE) * self._most + REST).all())
        if self.limited:
            self._differing = 3
            jumped = np.repeat((_norms(np.array([own, own_rate])) > self._most[:2]).any(axis=0), 3)
            moving = np.where(jumped, 0.0, own), np.where(jumped, 0.0, own_rate)
            self._align(step, own, *moving)
            if not self._pursue(step, *moving) and not self._pursue(step, np.zeros(6), np.zeros(6)):
                self.acceleration[:] = 0.0
                self._move(self._period_s * self.speed)
        else:
            self._courses = [None, None]
            self.pose, self.twist, self.acceleration = pose.copy(), velocity, rate
            self.speed = velocity + 0.5 * self._period_s * rate

    def _align(self, step: Array, own: Array, moving: Array, moving_rate: Array) -> None:
        for part in (0, 1):
            rows = slice(3 * part, 3 * part + 3)
            course = self._courses[part]
            if course is not None:
                course.strayed += self._period_s * (own[rows] - course.expected)
                if np.linalg.norm(course.strayed) <= TURN * course.scale:
                    continue
            gap = self.speed[rows] - moving[rows]
            axes = _axes(moving[rows] + step[rows] / LEAD_S, gap)
            turning = TURNING * moving_rate[rows]
            rates = np.array([gap, self.speed[rows], self.acceleration[rows], turning]) @ axes.T
            shares = np.abs(rates / self._most[[0, 0, 1, 1], part][:, None]).max(axis=0)
            shares = np.clip(shares, MIN_SHARE, 1.0)
            shares[0] = 1.0
            scale = max(np.linalg.norm(step[rows]), LEAD_S * np.linalg.norm(gap))
            self._courses[part] = _Course(
                axes, shares / np.linalg.norm(shares), moving[rows].copy(), float(scale)
            )

    def _pursue(self, step: Array, own: Array, own_rate: Array) -> bool:
        ahead = np.zeros((3, 6))
        for part in (0, 1):
            rows = slice(3 * part, 3 * part + 3)
            course = self._courses[part]
            assert course is not None
            motion = np.array([step[rows], own[rows], own_rate[rows]]) @ course.axes.T
            here = np.array([self.speed[rows], self.acceleration[rows]]) @ course.axes.T
            found = self._planned(motion, here, *self._bounds(part, here, motion[1], course.shares))
            if found is None:
                return False
            ahead[:, rows] = found @ course.axes
        self.speed, self.acceleration = ahead[1], ahead[2]
        self._move(ahead[0])
        return True

    def _bounds(self, part: int, here: Array, own: Array, shares: Array) -> Array:
        """Velocity, acceleration and jerk for each axis."""
        velocity, acceleration, jerk = SHARE * self._most[:, part]
        moving = np.square(own / ALONG)
        rest = max(velocity**2 - moving.sum(), (MIN_SHARE * velocity) ** 2)
        velocities = np.sqrt(moving + rest * shares**2)
        peaks = here[0] + 0.5 * here[1] * np.abs(here[1]) / (jerk * shares)
        peaks = np.maximum(np.abs(peaks), np.abs(here[0]))[1:]
        left = np.sqrt(max(velocity**2 - np.sum(peaks**2), 0.0))
        velocities[0] = max(left, np.sqrt(moving[0]), MIN_SHARE * velocity)
        return np.array([velocities, acceleration * shares, jerk * shares])

    def _planned(
        self, motion: Array, here: Array, velocity: Array, acceleration: Array, jerk: Array
    ) -> Array | None:
        period_s = self._period_s
        step = motion[0]
        own = motion[1] + 0.5 * period_s * motion[2]  # Its steps have its velocity of half a period ago.
        own = np.clip(own, -ALONG * velocity, ALONG * velocity)
        own_rate = np.clip(motion[2], -ALONG * acceleration, ALONG * acceleration)
        before = step - period_s * (own - 0.5 * period_s * own_rate)
        off = np.array([-before, here[0] - own + period_s * own_rate, here[1] - own_rate])
        lowest, highest = (
            [-velocity - own, -acceleration - own_rate],
            [velocity - own, acceleration - own_rate],
        )
        zero = np.zeros(3)
        rows = [*off, zero, zero, lowest[0], highest[0], lowest[1], highest[1], jerk]
        found = [otg.step(row, period_s) for row in np.transpose(rows).tolist()]
        if any(result for result, _ in found):
            return None
        return np.asarray(np.transpose([ahead for _, ahead in found]) + np.array([step, own, own_rate]))

    def _move(self, move: Array) -> None:
        self.twist = move / self._period_s
        self.pose[:3] += move[:3]
        self.pose[3:] = normalised(product(exp(move[3:].tolist()), self.pose[3:].tolist()))


def _axes(direction: Array, velocity: Array) -> Array:
    """The first row along the direction, the second across it as the velocity is."""
    norm = np.linalg.norm(direction)
    if not norm > REST:
        return np.eye(3)
    along = direction / norm
    across = velocity - (along @ velocity) * along
    if not np.linalg.norm(across) > MIN_ACROSS:
        least = np.argmin(np.abs(along))
        across = np.eye(3)[least] - along[least] * along
    across = across / np.linalg.norm(across)
    return np.array([along, across, cross(along, across)])


def _way(start: Array, end: Array) -> Array:
    return np.concatenate([end[:3] - start[:3], between(start[3:].tolist(), end[3:].tolist())])


def _norms(rows: Array) -> Array:
    """Of the linear and the angular part of each row, shape (k, 2)."""
    return np.asarray(np.sqrt(np.square(rows).reshape(len(rows), 2, 3).sum(axis=2)))
