"""The TCP's own limits: of velocity, acceleration and jerk, linear and angular, by norm."""

from __future__ import annotations

import math

import numpy as np
import ruckig

from cobot.robot.quaternion import between, exp, normalised, product
from cobot.types import Array, CartesianLimits

TOLERANCE = 1e-3
"""Relative, of what passes as it is: differences of positions carry their rounding."""
NO_TWIST = np.zeros(6)
MIN_SHARE = 0.25
"""Of a limit that an axis across the direction of motion has for corrections."""
LEAD_S = 0.2
"""What is missing counts this much of a velocity when the direction of motion is chosen."""
SHARE = 0.9
"""Of the limits, while it catches up."""
REST = 1e-9


class PoseLimiter:
    """Follows a pose within the limits. Real-time safe.

    A request that keeps the limits passes bit for bit. One that does not is pursued in a frame that moves
    with it, so that it is caught up with, and one that stands still is not overshot. Each axis has its part
    of the limits, as the direction of motion needs it, so that the norms hold.

    Attributes:
        pose: shape (7,), m and (w, x, y, z).
        twist: its velocity, shape (6,), m/s and rad/s, in the base frame.
        limited: whether the pose is not the request.
    """

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
        self._rate = np.zeros(6)  # of the twist
        self._last = self.pose.copy()  # request
        self._own, self._own_rate = np.zeros((2, 6))  # velocity and its rate, of the requests
        self._differing = 0  # cycles in which these may still be others than the twist and its rate
        self._generator = ruckig.Ruckig(6, period_s)
        self._problem, self._output = ruckig.InputParameter(6), ruckig.OutputParameter(6)
        self._problem.target_position = self._problem.target_velocity = [0.0] * 6

    def begin(self, pose: Array, twist: Array = NO_TWIST) -> None:
        """Start here, with this motion."""
        self.pose[:] = self._last[:] = pose
        self.twist[:] = self._own[:] = twist
        self._rate[:] = self._own_rate[:] = 0.0
        self._differing = 0
        self.limited = False

    def step(self, pose: Array) -> None:
        """One period on, towards this pose."""
        step = _way(self.pose, pose)
        velocity = step / self._period_s
        rate = (velocity - self.twist) / self._period_s
        change = (rate - self._rate) / self._period_s
        own, own_rate = velocity, rate  # of the requests, where the last ones have passed
        if self._differing:
            self._differing -= 1
            own = _way(self._last, pose) / self._period_s
            own_rate = (own - self._own) / self._period_s
            change = np.maximum(np.abs(change), np.abs(rate - own_rate) / self._period_s)
        np.copyto(self._last, pose)
        np.copyto(self._own, own)
        np.copyto(self._own_rate, own_rate)
        norms = _norms(np.array([velocity, rate, change]))
        self.limited = not bool((norms <= (1.0 + TOLERANCE) * self._most + REST).all())
        if self.limited:
            self._differing = 3
            jumped = np.repeat((_norms(np.array([own, own_rate])) > self._most[:2]).any(axis=0), 3)
            moving = np.where(jumped, 0.0, own), np.where(jumped, 0.0, own_rate)
            if not self._pursue(step, *moving) and not self._pursue(step, np.zeros(6), np.zeros(6)):
                self._rate[:] = 0.0
                self._move(self._period_s * self.twist)
        else:
            np.copyto(self.pose, pose)
            np.copyto(self.twist, velocity)
            np.copyto(self._rate, rate)

    def _pursue(self, step: Array, own: Array, own_rate: Array) -> bool:
        """Bring the difference to a request that moves like this to zero; whether Ruckig has found a way."""
        period_s, problem, output = self._period_s, self._problem, self._output
        shares = _shares(own + step / LEAD_S)
        velocity_most, most, jerk = SHARE * np.repeat(self._most, 3, axis=1) * shares
        np.clip(own, -0.9 * velocity_most, 0.9 * velocity_most, out=own)
        np.clip(own_rate, -0.9 * most, 0.9 * most, out=own_rate)
        before = step - period_s * (own - 0.5 * period_s * own_rate)
        off = np.array([-before, self.twist - own + period_s * own_rate, self._rate - own_rate])
        problem.current_position, problem.current_velocity, problem.current_acceleration = off.tolist()
        problem.max_velocity = (velocity_most - own).tolist()
        problem.min_velocity = (-velocity_most - own).tolist()
        problem.max_acceleration = (most - own_rate).tolist()
        problem.min_acceleration = (-most - own_rate).tolist()
        problem.max_jerk = jerk.tolist()
        if not self._plan():
            return False
        self.twist[:] = own + output.new_velocity
        self._rate[:] = own_rate + output.new_acceleration
        self._move(step + output.new_position)
        return True

    def _move(self, move: Array) -> None:
        self.pose[:3] += move[:3]
        self.pose[3:] = normalised(product(exp(move[3:].tolist()), self.pose[3:].tolist()))

    def _plan(self) -> bool:
        """On a straight line if Ruckig finds a way to keep the axes in phase, else each axis for itself."""
        for synchronization in (ruckig.Synchronization.Phase, ruckig.Synchronization.No):
            self._problem.synchronization = synchronization
            try:
                self._generator.update(self._problem, self._output)
                return True
            except (ruckig.RuckigError, ValueError):  # ValueError: a result that its binding does not know
                continue
        return False


def _way(start: Array, end: Array) -> Array:
    """From one pose to another: m, and a rotation vector, in the base frame."""
    way = np.empty(6)
    np.subtract(end[:3], start[:3], out=way[:3])
    way[3:] = between(start[3:].tolist(), end[3:].tolist())
    return way


def _norms(rows: Array) -> Array:
    """Of the linear and the angular part of each row, shape (k, 2)."""
    norms: Array = np.sqrt(np.square(rows).reshape(len(rows), 2, 3).sum(axis=2))
    return norms


def _shares(direction: Array) -> Array:
    """The part of the limits for each axis, shape (6,): of norm 1 for the linear and for the angular ones."""
    shares = np.empty(6)
    for part in (slice(0, 3), slice(3, 6)):
        x, y, z = direction[part].tolist()
        norm = math.sqrt(x * x + y * y + z * z)
        least = MIN_SHARE * norm if norm > REST else 1.0
        x, y, z = max(abs(x), least), max(abs(y), least), max(abs(z), least)
        norm = math.sqrt(x * x + y * y + z * z)
        shares[part] = x / norm, y / norm, z / norm
    return shares
