"""The last thing before a command is written: the same code in every mode and for every backend.

A command within the limits passes bit for bit. What is not finite is refused and latches an e-stop;
what goes beyond position, velocity or acceleration is caught: from then on the output is a
jerk-limited pursuit of the request that stays within all limits, until the request can be reached
in one step again.
"""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.layout import Intervention
from cobot.types import Array, JointLimits

TOLERANCE = 0.01
"""Relative, on velocity and acceleration: planners drive exactly at the limits, and the differences of
three positions carry the rounding of numbers of the order of 1 rad, divided by the period squared."""
POSITION_TOLERANCE_RAD = 1e-5
ROUNDING = 1e-9
"""Of velocity and acceleration at the end of a brake profile: this is rest."""

KINDS = (
    Intervention.POSITION,
    Intervention.VELOCITY,
    Intervention.ACCELERATION,
    Intervention.VELOCITY,
    Intervention.ACCELERATION,
)
"""Of the rows that are checked: the position, its first and second difference, and the rates that the
command states."""


class Safety:
    """Guards one arm's commands. Real-time safe.

    Few numpy calls on whole matrices: on seven joints a call costs more than its arithmetic.

    Attributes:
        command: the command let through last, shape (3, dof): rad, rad/s, rad/s².
        position, velocity, acceleration: its rows.
        interventions: how often each kind of excess began, shape (len(Intervention),).
        pursuing: whether the output is not the request but follows it.
    """

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        dof = limits.dof
        self._limits = limits
        self._period_s = period_s
        low, high = limits.min_position - POSITION_TOLERANCE_RAD, limits.max_position + POSITION_TOLERANCE_RAD
        velocity, acceleration = (
            rate * (1.0 + TOLERANCE) for rate in (limits.max_velocity, limits.max_acceleration)
        )
        self._largest_step = limits.max_jerk * period_s  # of the acceleration, from cycle to cycle
        self._low = np.array([low, -velocity, -acceleration, -velocity, -acceleration])
        self._high = np.array([high, velocity, acceleration, velocity, acceleration])
        self._checked = np.zeros((5, dof))
        self._above = np.zeros((5, dof))
        self._below = np.zeros((5, dof))
        # position, first and second difference from the newest three positions
        rate = 1.0 / period_s
        self._differences = np.array(
            [[1.0, 0.0, 0.0], [rate, -rate, 0.0], [rate**2, -2.0 * rate**2, rate**2]]
        )
        self._history = np.zeros((4, dof))  # positions: what is requested, and what was let through before
        self.command = np.zeros((3, dof))
        self.position, self.velocity, self.acceleration = self.command
        self.interventions = np.zeros(len(Intervention), np.uint64)
        self._generator = ruckig.Ruckig(dof, period_s)
        self._pursuit = ruckig.InputParameter(dof)
        self._pursuit.synchronization = ruckig.Synchronization.No
        self._pursuit.max_velocity = limits.max_velocity.tolist()
        self._pursuit.max_acceleration = limits.max_acceleration.tolist()
        self._pursuit.max_jerk = limits.max_jerk.tolist()
        self._output = ruckig.OutputParameter(dof)
        self._caught: set[Intervention] = set()  # in this pursuit
        self.pursuing = False

    def reset(self, position: Array) -> None:
        """Start over at rest at a position, without a jump: the arm has to be there."""
        self.command[:] = 0.0
        self.position[:] = position
        self._history[:] = position
        self.pursuing = False
        self._caught.clear()

    def apply(self, request: Array) -> bool:
        """Let a command through, or the nearest that is safe; the result is in `command`.

        Args:
            request: shape (3, dof): rad, rad/s, rad/s².

        Returns:
            False when the request is not finite: the caller has to latch an e-stop.
        """
        checked, history = self._checked, self._history
        np.copyto(history[0], request[0])
        with np.errstate(over="ignore", invalid="ignore"):
            np.dot(self._differences, history[:3], out=checked[:3])
            np.copyto(checked[3:], request[1:])
            np.subtract(self._high, checked, out=self._above)
            np.subtract(checked, self._low, out=self._below)
            np.minimum(self._above, self._below, out=self._above)
            inside = bool(self._above.min() >= 0.0)  # false for a NaN too
        if inside and (not self.pursuing or self._meets(request)):
            np.copyto(self.command, request)
            self.pursuing = False
            self._caught.clear()
            self._remember()
            return True
        finite = inside or bool(np.isfinite(request).all())
        if not inside:
            self._count(
                Intervention.NOT_FINITE if not finite else KINDS[(self._above.min(axis=1) < 0.0).argmax()]
            )
        if finite:
            self._pursue(request[0])
        else:
            self.brake()
        return finite

    def _count(self, kind: Intervention) -> None:
        """Once in each pursuit."""
        if kind not in self._caught:
            self._caught.add(kind)
            self.interventions[kind] += 1

    def _meets(self, request: Array) -> bool:
        """Whether the pursuit has come so close that going over to the request keeps the jerk limits."""
        acceleration = self._checked[2]
        step = np.maximum(np.abs(acceleration - self.acceleration), np.abs(acceleration - request[2]))
        return bool((step <= self._largest_step).all())

    def brake(self) -> bool:
        """Come to rest from wherever the arm is, each joint for itself, as fast as the limits permit.

        Returns:
            Whether it is at rest.
        """
        self._pursuit.control_interface = ruckig.ControlInterface.Velocity
        self._pursuit.target_velocity = [0.0] * self._limits.dof
        self._follow_pursuit()
        if np.abs(self.command[1:]).max() > ROUNDING:
            return False
        self.command[1:] = 0.0
        return True

    def _pursue(self, target: Array) -> None:
        target = target.clip(self._limits.min_position, self._limits.max_position)
        self._pursuit.control_interface = ruckig.ControlInterface.Position
        self._pursuit.target_position = target.tolist()
        self._pursuit.target_velocity = [0.0] * self._limits.dof
        self._follow_pursuit()

    def _follow_pursuit(self) -> None:
        pursuit, output = self._pursuit, self._output
        if not self.pursuing:
            # What the arm really does, whatever was stated: from the last three positions, which give
            # the velocity half a period ago.
            np.dot(self._differences, self._history[1:], out=self.command)
            self.velocity += 0.5 * self._period_s * self.acceleration
        pursuit.current_position = self.position.tolist()
        pursuit.current_velocity = self.velocity.tolist()
        pursuit.current_acceleration = self.acceleration.tolist()
        self._generator.update(pursuit, output)
        self.position[:] = output.new_position
        self.velocity[:] = output.new_velocity
        self.acceleration[:] = output.new_acceleration
        self.pursuing = True
        self._remember()

    def _remember(self) -> None:
        history = self._history
        history[2:] = history[1:3]
        np.copyto(history[1], self.position)
