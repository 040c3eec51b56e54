"""What `rtloop.generators.pose_interpolation` computes, in numpy, of many poses at once: (7, count)."""

from __future__ import annotations

from typing import Any

import numpy as np
from laws import quaternions

from cobot.types import Array


class PoseInterpolator:
    """All in the same cycle, each with six coordinates of a chart, a law of 6 count coordinates."""

    def __init__(self, chart: Any, count: int) -> None:
        self.pose = np.zeros((7, count))
        self._chart = chart

    def begin(self, pose: Array, twist: Array, acceleration: Array) -> None:
        self.pose = pose.copy()
        self._last_position = pose[:3].copy()
        self._origin = self._last_orientation = quaternions.normalised(pose[3:])
        self._chart.begin(self._at_origin(twist, acceleration))

    def aim(self, pose: Array, twist: Array | None, duration_s: float) -> None:
        state = self._at_origin(self.twist, self.acceleration)
        self._origin = quaternions.normalised(self.pose[3:])
        last = np.vstack([self._last_position, quaternions.between(self._origin, self._last_orientation)])
        self._chart.rebase(state, last.ravel())
        turn = quaternions.between(self._origin, pose[3:])
        velocity = None
        if twist is not None:
            velocity = np.vstack([twist[:3], quaternions.rotation_rate(turn, twist[3:])]).ravel()
        self._chart.aim(np.vstack([pose[:3], turn]).ravel(), velocity, duration_s)
        self._last_position, self._last_orientation = pose[:3].copy(), pose[3:].copy()
        self._write()

    def advance(self) -> None:
        self._chart.advance()
        self._write()

    @property
    def _reference(self) -> Array:
        reference: Array = self._chart.reference.reshape(3, 6, -1)
        return reference

    @property
    def twist(self) -> Array:
        position, velocity, _ = self._reference
        return np.vstack([velocity[:3], quaternions.angular_velocity(position[3:], velocity[3:])])

    @property
    def acceleration(self) -> Array:
        position, velocity, acceleration = self._reference
        angular = quaternions.angular_acceleration(position[3:], velocity[3:], acceleration[3:])
        return np.vstack([acceleration[:3], angular])

    def _at_origin(self, twist: Array, acceleration: Array) -> Array:
        here = np.vstack([self.pose[:3], np.zeros_like(self.pose[:3])])
        return np.array([here, twist, acceleration]).reshape(3, -1)

    def _write(self) -> None:
        position = self._reference[0]
        turned = quaternions.product(quaternions.exp(position[3:]), self._origin)
        self.pose = np.vstack([position[:3], turned])


def min_jerk(start: Array, goal: Array, t: Array, duration_s: Array) -> tuple[Array, Array, Array]:
    """Pose, twist and acceleration at shares of the duration below 1, shape (count,)."""
    origin, end = quaternions.normalised(start[3:]), quaternions.normalised(goal[3:])
    end = np.where(np.sum(origin * end, axis=0) < 0.0, -end, end)
    way = np.vstack([goal[:3] - start[:3], quaternions.between(origin, end)])
    share = 10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5
    rate = (30.0 * t**2 - 60.0 * t**3 + 30.0 * t**4) / duration_s
    second = (60.0 * t - 180.0 * t**2 + 120.0 * t**3) / duration_s**2
    turned = quaternions.product(quaternions.exp(share * way[3:]), origin)
    return np.vstack([start[:3] + share * way[:3], turned]), rate * way, second * way
