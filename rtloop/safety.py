"""The last thing before a command is written: the same code in every mode and for every backend.

A command within the limits passes bit for bit. What is not finite is refused and latches an e-stop;
what goes beyond position, velocity or acceleration is caught: from then on the output is a
jerk-limited pursuit of the request that stays within all limits, until the request can be reached
in one step again.
"""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.shm import Intervention
from cobot.types import Array, JointLimits

TOLERANCE = 0.01
"""Relative, on velocity and acceleration: planners drive exactly at the limits, and the differences of
three positions carry the rounding of numbers of the order of 1 rad, divided by the period squared."""
POSITION_TOLERANCE_RAD = 1e-5


class Safety:
    """Guards one arm's commands. Real-time safe.

    Attributes:
        position, velocity, acceleration: the command let through last, shape (dof,), rad, rad/s, rad/s².
        interventions: how often each kind of excess began, shape (len(Intervention),).
    """

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        dof = limits.dof
        self._limits = limits
        self._period_s = period_s
        self._low = limits.min_position - POSITION_TOLERANCE_RAD
        self._high = limits.max_position + POSITION_TOLERANCE_RAD
        self._max_velocity = limits.max_velocity * (1.0 + TOLERANCE)
        self._max_acceleration = limits.max_acceleration * (1.0 + TOLERANCE)
        self.position = np.zeros(dof)
        self.velocity = np.zeros(dof)
        self.acceleration = np.zeros(dof)
        self.interventions = np.zeros(len(Intervention), np.uint64)
        self._step = np.zeros(dof)  # the last change of position over the period
        self._new_step = np.zeros(dof)
        self._scratch = np.zeros(dof)
        self._generator = ruckig.Ruckig(dof, period_s)
        self._pursuit = ruckig.InputParameter(dof)
        self._pursuit.synchronization = ruckig.Synchronization.No
        self._pursuit.max_velocity = limits.max_velocity.tolist()
        self._pursuit.max_acceleration = limits.max_acceleration.tolist()
        self._pursuit.max_jerk = limits.max_jerk.tolist()
        self._output = ruckig.OutputParameter(dof)
        self._excess: Intervention | None = None  # what is being caught
        self.pursuing = False

    def reset(self, position: Array) -> None:
        """Start over at rest at a position, without a jump: the arm has to be there."""
        self.position[:] = position
        self.velocity[:] = 0.0
        self.acceleration[:] = 0.0
        self._step[:] = 0.0
        self.pursuing = False
        self._excess = None

    def apply(self, position: Array, velocity: Array, acceleration: Array) -> bool:
        """Let a command through, or the nearest that is safe; the result is in the attributes.

        Returns:
            False when the command is not finite: the caller has to latch an e-stop.
        """
        excess, finite = self._find_excess(position, velocity, acceleration)
        if excess is None:
            np.copyto(self.position, position)
            np.copyto(self.velocity, velocity)
            np.copyto(self.acceleration, acceleration)
            np.copyto(self._step, self._new_step)
            self.pursuing = False
            self._excess = None
            return True
        if excess is not self._excess:
            self.interventions[excess] += 1
            self._excess = excess
        if finite:
            self._pursue(np.clip(position, self._limits.min_position, self._limits.max_position))
        else:
            self.brake()
        return finite

    def brake(self) -> bool:
        """Come to rest from wherever the arm is, each joint for itself, as fast as the limits permit.

        Returns:
            Whether it is at rest.
        """
        self._pursuit.control_interface = ruckig.ControlInterface.Velocity
        self._pursuit.target_velocity = [0.0] * self._limits.dof
        self._follow_pursuit()
        return not self.velocity.any()

    def _find_excess(
        self, position: Array, velocity: Array, acceleration: Array
    ) -> tuple[Intervention | None, bool]:
        step, scratch = self._new_step, self._scratch
        np.subtract(position, self.position, out=step)
        step /= self._period_s
        np.subtract(step, self._step, out=scratch)
        scratch /= self._period_s
        total = float(step.sum() + velocity.sum() + acceleration.sum())
        if not np.isfinite(total):
            return Intervention.NOT_FINITE, False
        if (position < self._low).any() or (position > self._high).any():
            return Intervention.POSITION, True
        np.abs(scratch, out=scratch)
        if (scratch > self._max_acceleration).any():
            return Intervention.ACCELERATION, True
        np.abs(step, out=scratch)
        if (scratch > self._max_velocity).any():
            return Intervention.VELOCITY, True
        return None, True

    def _pursue(self, target: Array) -> None:
        self._pursuit.control_interface = ruckig.ControlInterface.Position
        self._pursuit.target_position = target.tolist()
        self._pursuit.target_velocity = [0.0] * self._limits.dof
        self._follow_pursuit()

    def _follow_pursuit(self) -> None:
        pursuit, output = self._pursuit, self._output
        pursuit.current_position = self.position.tolist()
        pursuit.current_velocity = self.velocity.tolist()
        pursuit.current_acceleration = self.acceleration.tolist()
        self._generator.update(pursuit, output)
        self._step[:] = output.new_position
        self._step -= self.position
        self._step /= self._period_s
        self.position[:] = output.new_position
        self.velocity[:] = output.new_velocity
        self.acceleration[:] = output.new_acceleration
        self.pursuing = True
