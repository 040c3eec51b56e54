"""Poses between streamed poses, and the slow move to a single one.

A pose is shape (7,): x, y, z in m and a quaternion (w, x, y, z); a twist is shape (6,): linear and angular
velocity, m/s and rad/s; both in the base frame.
"""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import Interpolation
from cobot.robot import quaternion
from cobot.types import Array
from rtloop.generators.interpolation import make_interpolator

MIN_DURATION_S = 1e-3
"""Of a move: what is to take less, or no time at all, takes this long."""
NO_TWIST = np.zeros(6)


class PoseInterpolator:
    """An `Interpolator` of poses. Real-time safe.

    It works in a chart: position, and the rotation vector from where the tool pointed when the newest
    command arrived. A straight line through the chart's origin is a turn about a fixed axis at a constant
    speed, so `Linear` is a straight line and a spherical interpolation. The limits hold for each axis
    of the chart.

    Attributes:
        pose: of this cycle. The quaternion's sign does not jump.
    """

    def __init__(
        self,
        kind: Interpolation,
        period_s: float,
        max_linear_velocity: float,
        max_linear_acceleration: float,
        max_linear_jerk: float,
        max_angular_velocity: float,
        max_angular_acceleration: float,
        max_angular_jerk: float,
    ) -> None:
        self.pose = np.array([0.0, 0, 0, 1, 0, 0, 0])
        self._chart = make_interpolator(
            kind,
            6,
            period_s,
            np.repeat([max_linear_velocity, max_angular_velocity], 3),
            np.repeat([max_linear_acceleration, max_angular_acceleration], 3),
            np.repeat([max_linear_jerk, max_angular_jerk], 3),
        )
        self._state = np.zeros((3, 6))
        self._last, self._target, self._velocity = np.zeros((3, 6))  # in the chart
        self._last_orientation = self._origin = (1.0, 0.0, 0.0, 0.0)

    def begin(self, pose: Array, twist: Array = NO_TWIST, acceleration: Array = NO_TWIST) -> None:
        """Start here, forget all commands, and hold (what moves is brought to rest)."""
        self.pose[:] = pose
        self._last[:3] = pose[:3]
        self._origin = self._last_orientation = quaternion.normalised(pose[3:].tolist())
        self._chart.begin(self._at_origin(twist, acceleration))

    def aim(self, pose: Array, twist: Array | None, duration_s: float) -> None:
        """A new command, to be reached `duration_s` from now: one command period.

        Args:
            twist: at the pose, as the sender states it; None: estimated where it is needed.
        """
        state = self._at_origin(self.twist, self.acceleration)
        self._origin = quaternion.normalised(self.pose[3:].tolist())
        self._last[3:] = quaternion.between(self._origin, self._last_orientation)
        self._chart.rebase(state, self._last)
        orientation = pose[3:].tolist()
        turn = quaternion.between(self._origin, orientation)
        self._target[:3], self._target[3:] = pose[:3], turn
        velocity = None
        if twist is not None:
            velocity = self._velocity
            velocity[:3], velocity[3:] = twist[:3], quaternion.rotation_rate(turn, twist[3:].tolist())
        self._chart.aim(self._target, velocity, duration_s)
        self._last[:3], self._last_orientation = pose[:3], orientation
        self._write()

    def advance(self) -> None:
        """One period on."""
        self._chart.advance()
        self._write()

    @property
    def twist(self) -> Array:
        """Of this cycle, shape (6,): m/s and rad/s."""
        position, velocity, _ = self._chart.reference.tolist()
        return np.array([*velocity[:3], *quaternion.angular_velocity(position[3:], velocity[3:])])

    @property
    def acceleration(self) -> Array:
        """Of this cycle, shape (6,): m/s² and rad/s². Of the angular part, terms are missing that are of
        second order in the turn since the newest command.
        """
        position, velocity, acceleration = self._chart.reference.tolist()
        angular = quaternion.angular_acceleration(position[3:], velocity[3:], acceleration[3:])
        return np.array([*acceleration[:3], *angular])

    def _at_origin(self, twist: Array, acceleration: Array) -> Array:
        """Where the reference is, in a chart that begins there: its Jacobian is the identity."""
        state = self._state
        state[0, :3], state[0, 3:] = self.pose[:3], 0.0
        state[1], state[2] = twist, acceleration
        return state

    def _write(self) -> None:
        position = self._chart.reference[0].tolist()
        self.pose[:] = *position[:3], *quaternion.product(quaternion.exp(position[3:]), self._origin)


class MinJerkMove:
    """From rest to rest along a straight line and about a fixed axis, the shorter way. Real-time safe.

    With s = 10 t³ - 15 t⁴ + 6 t⁵ of the share t of the duration, velocity and acceleration are zero at both
    ends (T. Flash, N. Hogan, "The coordination of arm movements", 1985).

    Attributes:
        pose, twist: of this cycle.
        acceleration: of this cycle, shape (6,), m/s² and rad/s².
        done: whether the pose is the goal.
    """

    def __init__(self, start: Array, goal: Array, duration_s: float, period_s: float) -> None:
        """A move that lasts no less than `MIN_DURATION_S`; any quaternion but zero will do."""
        self.pose, self.twist, self.acceleration = np.array(start, float), np.zeros(6), np.zeros(6)
        self.done = False
        self._start = self.pose[:3].copy()
        self._origin = quaternion.normalised(self.pose[3:].tolist())
        end = quaternion.normalised(goal[3:].tolist())
        if sum(a * b for a, b in zip(self._origin, end, strict=True)) < 0.0:
            end = (-end[0], -end[1], -end[2], -end[3])
        self._goal = np.array([*goal[:3], *end])
        self._turn = quaternion.between(self._origin, end)
        self._way = np.array([*(self._goal[:3] - self._start), *self._turn])
        self._duration_s = duration_s if duration_s > MIN_DURATION_S else MIN_DURATION_S
        self._period_s = period_s
        self._cycle = 0

    def advance(self) -> None:
        """One period on."""
        self._cycle += 1
        t = self._cycle * self._period_s / self._duration_s
        if t >= 1.0:
            self.pose[:], self.twist[:], self.acceleration[:] = self._goal, 0.0, 0.0
            self.done = True
            return
        share = t * t * t * (10.0 + t * (6.0 * t - 15.0))
        rate = 30.0 * t * t * (1.0 - t) * (1.0 - t) / self._duration_s
        second = 60.0 * t * (1.0 - t) * (1.0 - 2.0 * t) / self._duration_s**2
        x, y, z = self._turn
        turned = quaternion.product(quaternion.exp((share * x, share * y, share * z)), self._origin)
        self.pose[:3] = self._start + share * self._way[:3]
        self.pose[3:] = turned
        np.multiply(self._way, rate, out=self.twist)
        np.multiply(self._way, second, out=self.acceleration)
