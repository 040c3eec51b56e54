"""A simulated cell around an arm whose controller is simulated in a separate process.

The simulator knows only the arm. This module simulates the cell, and the cell's arm follows the joints that
the simulator reports. So the hand, parts, switches, outputs and contact forces are the same as with the
`mujoco` backend.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.robot.device import DeviceStatus
from cobot.robot.io_points import IoPoint
from cobot.robot.tool import Tool
from cobot.types import Array, JointLimits
from rtloop.backends.cell import CellBackend
from rtloop.backends.compiled import Measured
from rtloop.backends.guarded import NAMES
from rtloop.backends.protocols import Backend, BackendError, Reporting, capabilities_of

MAX_STEP_S = 0.001
"""Maximum step of the simulated cell, s."""
FOLLOW_RAD_S = 40.0
"""Frequency of the critically damped filter between the reported joints and the cell's arm, rad/s. The
positions of polled devices change in steps, which would act as forces on a held part without the filter.
"""
NOTE = "hand, parts, switches and contact forces are simulated next to it (robot.backend.simulator)"

log = logging.getLogger("cobot.rtloop")


class DeviceInCell:
    """The backend of a device with a simulated cell around it. It implements `HasIo`, `ReadsInputs`,
    `HasCell`, `CarriesTool` and `Reporting`, and all other protocols that the device implements.

    Attributes:
        device: the backend without the cell.
        part_names: see `HasCell`.
    """

    def __init__(self, device: Backend, settings: Settings, limits: JointLimits) -> None:
        """
        Raises:
            ConfigError: the cell file is invalid, or does not fit the arm.
        """
        self.device = device
        period_s = settings.rt.period_s
        self._steps = max(1, math.ceil(period_s / MAX_STEP_S - 1e-9))
        self._step_s = period_s / self._steps
        rt = settings.rt.model_copy(update={"period_s": self._step_s})
        self._cell = CellBackend(settings.model_copy(update={"rt": rt}), limits)
        self._felt = Measured(limits.dof)
        self._rows = np.zeros((3, limits.dof))
        self._place, self._speed = np.zeros(limits.dof), np.zeros(limits.dof)
        self._begun = False
        self._names = {point.name for point in self._cell.io()}
        able = capabilities_of(device)
        self.capabilities = replace(able, io=True, measured=able.measured | {"wrench"})
        self.report_period_s = min(getattr(device, "report_period_s", math.inf), CellBackend.report_period_s)
        self.part_names = self._cell.part_names
        self.part_poses, self.reset_cell = self._cell.part_poses, self._cell.reset_cell
        self.mount = self._cell.mount
        for name in NAMES:
            if hasattr(device, name) and not hasattr(self, name):
                setattr(self, name, getattr(device, name))
        log.warning("%s: %s", settings.robot.backend.type, NOTE)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)

    def open(self, initial_position: Array) -> None:
        self._begun = False
        self.device.open(initial_position)

    def read(self, measured: Measured) -> None:
        measured.wrench[:] = 0.0  # the device may leave this row unset
        self.device.read(measured)
        if not np.isfinite(measured.joints[:2]).all():
            return  # the cycle checks for this itself
        self._place[:], self._speed[:] = measured.position, measured.velocity
        if not self._begun:
            self._begin()
        self._cell.read(self._felt)
        measured.wrench += self._felt.wrench

    def write(self, command: Array) -> None:
        self.device.write(command)  # the device first, because this may be the answer to a packet
        if self._begun:
            self._follow()

    def set_tool(self, tool: Tool) -> None:
        if hasattr(self.device, "set_tool"):
            self.device.set_tool(tool)
        self._cell.set_tool(tool)

    def status(self) -> DeviceStatus:
        """Return the device's own status, with a note that the hand is simulated."""
        own = self.device.status() if isinstance(self.device, Reporting) else DeviceStatus()
        return replace(own, text=f"{own.text}; {NOTE}" if own.text else NOTE)

    def io(self) -> Sequence[IoPoint]:
        """Return the inputs and outputs of the device and of the cell. If a name exists in both, only the
        cell's is used, so that a simulated switch can replace the real input of the same name.
        """
        own = self.device.io() if hasattr(self.device, "io") else ()
        return *(point for point in own if point.name not in self._names), *self._cell.io()

    def set_output(self, name: str, value: float) -> None:
        self._with(name).set_output(name, value)

    def read_input(self, name: str) -> float:
        owner = self._with(name)
        if hasattr(owner, "read_input"):
            return float(owner.read_input(name))
        for point in owner.io():
            if point.name == name:
                return float(point.value)
        raise BackendError(f"there is no input {name!r}")

    def _with(self, name: str) -> Any:
        """Return the device or the cell, depending on which has the input or output with this name. Unknown
        names go to the cell, which rejects them.
        """
        is_of_device = name not in self._names and hasattr(self.device, "io")
        return self.device if is_of_device else self._cell

    def _begin(self) -> None:
        self._rows[:] = 0.0
        self._rows[0] = self._place
        self._cell.open(self._place)
        self._begun = True

    def _follow(self) -> None:
        """Advance the cell by one period. Its arm follows the reported joints."""
        place, speed, acceleration = self._rows
        for _ in range(self._steps):
            acceleration[:] = FOLLOW_RAD_S**2 * (self._place - place) + 2.0 * FOLLOW_RAD_S * (
                self._speed - speed
            )
            speed += self._step_s * acceleration
            place += self._step_s * speed
            self._cell.write(self._rows)
