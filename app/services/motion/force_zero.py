"""The zero of forces and torques: what is measured while nothing touches the arm."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace

import numpy as np

from app.services.state.link import RobotLink
from cobot.errors import ConflictError, NotSupportedError, UnavailableError
from cobot.ipc.device_record import DeviceReport
from cobot.motions.signals import Condition, Placed, Quantity
from cobot.robot.description import RobotDescription
from cobot.types import Array, LoopMode

SAMPLES, SAMPLE_S = 50, 0.004
"""The measurements whose mean is the zero, and the time between two of them, s."""
STILL_RAD_S = 0.01
"""Maximum velocity of a joint at rest. A force may push the arm aside, so it need not have settled."""
ROWS = {Quantity.FORCE: "wrench", Quantity.TORQUE: "wrench", Quantity.JOINT: "external_effort"}
"""What a device has to measure for a condition."""


@dataclass(frozen=True, slots=True)
class Zero:
    """Attributes:
    wrench: at the TCP in the base frame, shape (6,), N and N·m.
    torques: on the joints, shape (dof,), N·m.
    tool: version of the tool that the arm carried.
    """

    wrench: Array
    torques: Array
    tool: int


class ForceZero:
    """The zero of one robot. It is a setting until another one is made, or the service is restarted."""

    def __init__(self, robot: RobotDescription, link: RobotLink) -> None:
        self._robot = robot
        self._link = link
        self.zero: Zero | None = None

    async def make(self, timeout_s: float) -> Zero:
        """Measure the zero, while the arm rests and nothing touches it.

        Raises:
            NotSupportedError: the device measures no force.
            ConflictError: the arm moves.
            UnavailableError: the robot cannot be read.
        """
        self.require_measured(Quantity.FORCE, "the zero of the force")
        wrenches, torques = [], []
        for _ in range(SAMPLES):
            state = await self._link.await_measured_state(timeout_s)
            if state.mode is not LoopMode.HOLD or np.abs(state.velocity).max() > STILL_RAD_S:
                raise ConflictError(f"the arm moves (mode {state.mode.name}): the zero is measured at rest")
            wrenches.append(state.wrench)
            torques.append(state.external_effort)
            await asyncio.sleep(SAMPLE_S)
        tool = self._robot.model.carried.version
        self.zero = Zero(np.mean(wrenches, axis=0), np.mean(torques, axis=0), tool)
        return self.zero

    def applied(self, placed: Placed) -> Placed:
        """The signals of a motion that begins now, with the zero in them.

        Raises:
            ConflictError: they ask for the zero and there is none, or the tool has changed since.
        """
        until = placed.until
        if until is None or not until.from_zero:
            return placed
        return replace(placed, until=replace(until, condition=self._from_zero(until.condition)))

    def _from_zero(self, condition: Condition) -> Condition:
        found = self.zero
        if found is None:
            raise ConflictError("until.relative_to: there is no zero; POST /robot/force/zero makes one")
        if found.tool != self._robot.model.carried.version:
            raise ConflictError(
                "until.relative_to: the tool has changed since the zero; POST /robot/force/zero again"
            )
        joint = condition.quantity is Quantity.JOINT
        zero = (float(found.torques[condition.joint]),) if joint else tuple(found.wrench.tolist())
        return replace(condition, zero=zero)

    def require_measured(self, quantity: Quantity, what: str) -> DeviceReport:
        """See that the device measures what a condition compares; the device.

        Raises:
            NotSupportedError: it does not, with what it measures.
            UnavailableError: rtloop has not reported its robot.
        """
        named = self._link.device()
        if named is None:
            raise UnavailableError("the real-time loop has not reported its robot yet: try again in a second")
        backend, device = named
        row = ROWS.get(quantity)
        if row and (problem := device.capabilities.does_not_measure(backend, what, row)):
            raise NotSupportedError(problem)
        return device
