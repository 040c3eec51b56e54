"""The zero of forces and torques: their measured values while nothing touches the arm."""

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
"""Number of measurements whose mean is the zero, and their interval, s."""
STILL_RAD_S = 0.01
"""Maximum velocity of a joint that counts as at rest, rad/s. The arm need not have settled, because a force
may push it.
"""
ROWS = {Quantity.FORCE: "wrench", Quantity.TORQUE: "wrench", Quantity.JOINT: "external_effort"}
"""The measured values that a condition on a quantity requires from the device."""


@dataclass(frozen=True, slots=True)
class Zero:
    """
    Attributes:
        wrench: wrench at the TCP in the base frame, shape (6,), N and N·m.
        torques: external torques of the joints, shape (dof,), N·m.
        tool: version of the tool that the arm carried.
    """

    wrench: Array
    torques: Array
    tool: int


class ForceZero:
    """The zero of one robot. It is valid until it is set again or the service restarts."""

    def __init__(self, robot: RobotDescription, link: RobotLink) -> None:
        self._robot = robot
        self._link = link
        self.zero: Zero | None = None

    async def make(self, timeout_s: float) -> Zero:
        """Measure the zero. The arm must be at rest, and nothing may touch it.

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
                raise ConflictError(
                    f"the arm moves (mode {state.mode.name}): the zero is measured at rest",
                    details={"cause": "moving"},
                )
            wrenches.append(state.wrench)
            torques.append(state.external_effort)
            await asyncio.sleep(SAMPLE_S)
        tool = self._robot.model.carried.version
        self.zero = Zero(np.mean(wrenches, axis=0), np.mean(torques, axis=0), tool)
        return self.zero

    def applied(self, placed: Placed) -> Placed:
        """The signals of a motion that begins now, including the zero.

        Raises:
            ConflictError: the signals need the zero, but there is none or the tool has changed since.
        """
        until = placed.until
        if until is None or not until.from_zero:
            return placed
        return replace(placed, until=replace(until, condition=self._from_zero(until.condition)))

    def _from_zero(self, condition: Condition) -> Condition:
        found = self.zero
        if found is None:
            raise ConflictError("until.relative_to: there is no zero; POST /robot/force/zero sets it")
        if found.tool != self._robot.model.carried.version:
            raise ConflictError(
                "until.relative_to: the tool has changed since the zero; POST /robot/force/zero again"
            )
        joint = condition.quantity is Quantity.JOINT
        zero = (float(found.torques[condition.joint]),) if joint else tuple(found.wrench.tolist())
        return replace(condition, zero=zero)

    def require_measured(self, quantity: Quantity, what: str) -> DeviceReport:
        """Check that the device measures the quantity of a condition. Returns the device.

        Raises:
            NotSupportedError: the device does not measure it; the error lists what it measures.
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
