"""The last thing before a command is written: the same code in every mode and for every backend.

A command within the limits passes bit for bit. What is not finite is refused and latches an e-stop;
what goes beyond position, velocity, acceleration or jerk is caught: from then on the output is a
jerk-limited pursuit of the request that stays within all limits, until the request can be reached
in one step again.
"""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.layout import Intervention
from cobot.types import Array, JointLimits

TOLERANCE = 0.01
"""Relative, on the rates: planners drive exactly at the limits, and the differences of four positions
carry the rounding of numbers of the order of 1 rad, divided by the period cubed."""
POSITION_TOLERANCE_RAD = 1e-5
ROUNDING = 1e-9
"""Of velocity and acceleration at the end of a brake profile: this is rest."""

KINDS = (
    Intervention.POSITION,
    Intervention.VELOCITY,
    Intervention.ACCELERATION,
    Intervention.JERK,
    Intervention.VELOCITY,
    Intervention.ACCELERATION,
)
"""Of the rows that are checked: the position, its first to third difference, and the rates that the
command states."""
ROWS = len(KINDS)
PAST = 3


class Safety:
    """Guards one arm's commands. Real-time safe.

    On seven joints a numpy call costs more than its arithmetic, so the check is one matrix product: past
    positions, command and limits lie in one block, and the product gives all distances to all limits.

    Attributes:
        command: the command let through last, shape (3, dof): rad, rad/s, rad/s².
        position, velocity, acceleration: its rows.
        interventions: how often each kind of excess was caught, shape (len(Intervention),).
        counted: their sum.
        pursuing: whether the output is not the request but follows it.
    """

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        dof = limits.dof
        self._limits = limits
        self._period_s = period_s
        self._largest_step = limits.max_jerk * period_s  # of the acceleration, from cycle to cycle
        velocity, acceleration, jerk = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        rates = (1.0 + TOLERANCE) * np.array([velocity, acceleration, jerk, velocity, acceleration])
        self._block = np.vstack([np.zeros((PAST + 3, dof)), np.zeros(dof), rates, np.zeros(dof), -rates])
        self._highest, self._lowest = self._block[PAST + 3], self._block[PAST + 3 + ROWS]
        self._past = self._block[:PAST]  # the positions let through before, the newest last
        self.command = self._block[PAST : PAST + 3]
        self.position, self.velocity, self.acceleration = self.command
        rate = 1.0 / period_s
        # of the last three positions, in the order of `_block`: the oldest first
        self._differences = np.array(
            [[0.0, 0.0, 1.0], [0.0, -rate, rate], [rate**2, -2.0 * rate**2, rate**2]]
        )
        values = np.zeros((ROWS, PAST + 3))
        values[:3, 1:4] = self._differences
        values[3, :4] = rate**3 * np.array([-1.0, 3.0, -3.0, 1.0])
        values[4:, 4:] = np.eye(2)
        one, none = np.eye(ROWS), np.zeros((ROWS, ROWS))
        self._distances = np.block([[-values, one, none], [values, none, -one]])
        self._distance = np.zeros((2 * ROWS, dof))
        self.interventions = np.zeros(len(Intervention), np.uint64)
        self.counted = 0
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
        """Start over at rest at a position, without a jump: the arm has to be there.

        A position beyond the limits, where it was pushed, is held, and left only towards them.
        """
        reach = self._limits.including(position)
        self._lowest[:] = reach.min_position - POSITION_TOLERANCE_RAD
        self._highest[:] = reach.max_position + POSITION_TOLERANCE_RAD
        self.command[:] = 0.0
        self.position[:] = position
        self._past[:] = position
        self.pursuing = False
        self._caught.clear()

    def apply(self, request: Array) -> bool:
        """Let a command through, or the nearest that is safe; the result is in `command`.

        Args:
            request: shape (3, dof): rad, rad/s, rad/s².

        Returns:
            False when the request is not finite: the caller has to latch an e-stop.
        """
        np.copyto(self.command, request)
        np.dot(self._distances, self._block, out=self._distance)
        inside = self._distance.min() >= 0.0  # false for a NaN too
        if inside and (not self.pursuing or self._meets()):
            self.pursuing = False
            self._past[:] = self._block[1 : PAST + 1]
            return True
        return self._catch(request, inside=bool(inside))

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

    def count(self, kind: Intervention) -> None:
        """One more intervention."""
        self.interventions[kind] += 1
        self.counted += 1

    def _catch(self, request: Array, *, inside: bool) -> bool:
        if not self.pursuing:
            self._caught.clear()
        finite = inside or bool(np.isfinite(request).all())
        if not inside:
            distance = self._distance.reshape(2, ROWS, -1).min(axis=(0, 2))
            kind = KINDS[(distance < 0.0).argmax()] if finite else Intervention.NOT_FINITE
            if kind not in self._caught:
                self._caught.add(kind)
                self.count(kind)
        if not finite:
            self.brake()
            return False
        target = request[0].clip(self._lowest, self._highest)
        self._pursuit.control_interface = ruckig.ControlInterface.Position
        self._pursuit.target_position = target.tolist()
        self._pursuit.target_velocity = [0.0] * self._limits.dof
        self._follow_pursuit()
        return True

    def _meets(self) -> bool:
        """Whether the pursuit has come so close that going over to the request keeps the jerk limits."""
        acceleration = self._differences[2] @ self._block[1 : PAST + 1]
        before = np.array(self._output.new_acceleration)
        step = np.maximum(np.abs(acceleration - before), np.abs(acceleration - self.acceleration))
        return bool((step <= self._largest_step).all())

    def _follow_pursuit(self) -> None:
        """One period on, from where the arm is."""
        pursuit, output = self._pursuit, self._output
        if self.pursuing:
            output.pass_to_input(pursuit)
        else:
            # What the arm really does, whatever was stated: from the last three positions, which give
            # the velocity half a period ago.
            position, velocity, acceleration = self._differences @ self._past
            pursuit.current_position = position.tolist()
            pursuit.current_velocity = (velocity + 0.5 * self._period_s * acceleration).tolist()
            pursuit.current_acceleration = acceleration.tolist()
        self._generator.update(pursuit, output)
        self.command[:] = output.new_position, output.new_velocity, output.new_acceleration
        self.pursuing = True
        self._past[:] = self._block[1 : PAST + 1]
