"""The zero of forces and torques: the values measured while nothing touches the arm."""

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
"""Number of measurements that are averaged, and the interval between them, s."""
STILL_RAD_S = 0.01
"""A joint is at rest up to this velocity, rad/s. The arm need not have settled, because a force may be
pushing it.
"""
ROWS = {Quantity.FORCE: "wrench", Quantity.TORQUE: "wrench", Quantity.JOINT: "external_effort"}
"""For each quantity in a condition, the measured values that the device must report."""


@dataclass(frozen=True, slots=True)
class Zero:
    """
    Attributes:
        wrench: wrench at the TCP in the base frame, shape (6,), N and N·m.
        torques: external joint torques, shape (dof,), N·m.
        tool: version of the tool that the arm carried during the measurement.
    """

    wrench: Array
    torques: Array
    tool: int


class ForceZero:
    """Keeps the zero point of one robot, until it is measured again or the service restarts."""

    def __init__(self, robot: RobotDescription, link: RobotLink) -> None:
        self._robot = robot
        self._link = link
        self.zero: Zero | None = None

    async def make(self, timeout_s: float) -> Zero:
        """Measure the zero point. The arm must be at rest, and nothing may touch it.

        Raises:
            NotSupportedError: the device measures no force.
            ConflictError: the arm is moving.
            UnavailableError: the robot cannot be read.
        """
        self.require_measured(Quantity.FORCE, "the zero of the force")
        wrenches, torques = [], []
        for _ in range(SAMPLES):
            state = await self._link.await_measured_state(timeout_s)
            if state.mode is not LoopMode.HOLD or np.abs(state.velocity).max() > STILL_RAD_S:
                raise ConflictError(
                    f"the arm is moving (mode {state.mode.name}); the zero can be measured only at rest",
                    details={"cause": "moving"},
                )
            wrenches.append(state.wrench)
            torques.append(state.external_effort)
            await asyncio.sleep(SAMPLE_S)
        tool = self._robot.model.carried.version
        self.zero = Zero(np.mean(wrenches, axis=0), np.mean(torques, axis=0), tool)
        return self.zero

    def applied(self, placed: Placed) -> Placed:
        """Return the signals of a motion that begins now, including the zero point.

        Raises:
            ConflictError: the signals need the zero point, but it has not been measured, or the tool has
                changed since the measurement.
        """
        until = placed.until
        if until is None or not until.from_zero:
            return placed
        return replace(placed, until=replace(until, condition=self._from_zero(until.condition)))

    def _from_zero(self, condition: Condition) -> Condition:
        found = self.zero
        if found is None:
            raise ConflictError("until.relative_to: the zero is not set; set it with POST /robot/force/zero")
        if found.tool != self._robot.model.carried.version:
            raise ConflictError(
                "until.relative_to: the tool has changed since the zero was set; set it again with "
                "POST /robot/force/zero"
            )
        joint = condition.quantity is Quantity.JOINT
        zero = (float(found.torques[condition.joint]),) if joint else tuple(found.wrench.tolist())
        return replace(condition, zero=zero)

    def require_measured(self, quantity: Quantity, what: str) -> DeviceReport:
        """Check that the device measures the quantity in a condition, and return the device's report.

        Raises:
            NotSupportedError: the device does not measure the quantity. The error lists what it measures.
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
