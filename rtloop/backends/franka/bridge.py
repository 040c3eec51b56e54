"""Transition from the motion that the robot expects to the commanded one, without a jump in velocity or
acceleration.

If a command does not reach the robot, it continues at constant acceleration (Franka Control Interface,
"Control Interface Specification and Robot Limits"). Moreover, a motion must begin at the robot's own
reference, which is not exactly the measured position. In both cases the next command differs from the one
that the robot expects. This difference is added to the commands and then faded out.
"""

from __future__ import annotations

import numpy as np

from cobot.types import Array

MIN_DURATION_S, MAX_DURATION_S = 0.2, 1.0
MAX_ACCELERATION = 2.0
MAX_JERK = 1000.0
"""Maximum acceleration and jerk of the fade-out, rad/s² and rad/s³. They are slightly exceeded if the initial
difference already has higher values.
"""
JUMP_RAD = 1e-6
"""Maximum difference between a command and the extrapolation of the previous one, rad. A larger difference is
a jump. The value corresponds to a change in acceleration of 1 rad/s², or a jerk of 2000 rad/s³.
"""
PLACES = np.linspace(0.0, 1.0, 41)


class Bridge:
    """Adds an offset to the commands. The offset is an array of shape (3, dof) with the rows position,
    velocity and acceleration.
    """

    def __init__(self, dof: int, period_s: float) -> None:
        self._period_s = period_s
        self._coefficients = np.zeros((6, dof))
        self._duration_s = self._time_s = 0.0
        self._offset = np.zeros((3, dof))
        self._last = np.zeros((3, dof))
        self.sent = np.zeros((3, dof))

    def begin(self, position: Array) -> None:
        """Begin commands at rest at the robot's own reference, shape (dof,)."""
        self.sent[:] = 0.0
        self.sent[0] = position
        self._duration_s, self._offset[:] = -1.0, 0.0  # unknown until the first command

    def bridge(self, command: Array, periods: int) -> Array:
        """Return the command to send next. The array is reused by the next call, so do not keep a reference
        to it.

        Args:
            periods: number of the robot's periods since the last command. It is 1, or more if packets were
                lost.
        """
        if periods > 1 or self._duration_s < 0.0 or self._jumps(command):
            self._take_up(command, periods)
        elif self._time_s < self._duration_s:
            self._time_s += self._period_s
        left = self._time_s < self._duration_s
        self._offset[:] = self._rows(np.array([self._time_s]))[:, 0] if left else 0.0
        self._last[:] = command
        np.add(command, self._offset, out=self.sent)
        return self.sent

    def _jumps(self, command: Array) -> bool:
        """Whether the command jumps: its distance from the last command matches neither the new velocity nor
        the mean of the new and the last velocity. This happens after a fault, when rtloop continues from the
        arm's current position.
        """
        step = command[0] - self._last[0]
        by_last = np.abs(step - self._period_s * command[1])
        by_mean = np.abs(step - 0.5 * self._period_s * (self._last[1] + command[1]))
        return bool(np.minimum(by_last, by_mean).max() > JUMP_RAD)

    def _take_up(self, command: Array, periods: int) -> None:
        """Begin to fade out the difference from the position that the robot has reached on its own."""
        position, velocity, acceleration = self.sent
        ahead_s = periods * self._period_s
        expected = np.array(
            [
                position + ahead_s * velocity + 0.5 * ahead_s**2 * acceleration,
                velocity + ahead_s * acceleration,
                acceleration,
            ]
        )
        self._fit(expected - command)

    def _fit(self, start: Array) -> None:
        self._time_s, self._duration_s = 0.0, MIN_DURATION_S
        # A quintic that begins with an acceleration also reaches 0.36 times that in the opposite direction,
        # whatever its duration.
        along = np.maximum(MAX_ACCELERATION, np.abs(start[2])) * (1.0 + 1e-9)
        against = MAX_ACCELERATION + 0.4 * np.abs(start[2])
        sign = np.where(start[2] < 0.0, -1.0, 1.0)
        while True:
            self._solve(start, self._duration_s)
            rows = self._rows(PLACES * self._duration_s)
            jerk = np.abs(np.diff(rows[2], axis=0)).max() / (self._duration_s / (len(PLACES) - 1))
            signed = sign * rows[2]
            gentle = (signed <= along).all() and (signed >= -against).all() and jerk <= MAX_JERK
            if gentle or self._duration_s >= MAX_DURATION_S:
                return
            self._duration_s *= 1.5

    def _solve(self, start: Array, duration_s: float) -> None:
        """Calculate the quintic from `start` to zero."""
        p, v, a = start[0], start[1] * duration_s, start[2] * duration_s**2
        self._coefficients[:] = [
            p,
            v,
            0.5 * a,
            -10.0 * p - 6.0 * v - 1.5 * a,
            15.0 * p + 8.0 * v + 1.5 * a,
            -6.0 * p - 3.0 * v - 0.5 * a,
        ]

    def _rows(self, times_s: Array) -> Array:
        """Evaluate the quintic. Returns position, velocity and acceleration, shape (3, n, dof)."""
        duration_s = self._duration_s
        s = (times_s / duration_s)[:, None]
        _, c1, c2, c3, c4, c5 = self._coefficients[:, None, :]
        c0 = self._coefficients[0][None, :]
        return np.array(
            [
                c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5)))),
                (c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / duration_s,
                (2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / duration_s**2,
            ]
        )
