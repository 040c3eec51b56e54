"""Arms with inputs and outputs that a test sets and reads: always where they are told to be, or simulated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from rig import Loopback, Rig
from virtual_service import VirtualService

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.robot.device import Capabilities
from cobot.robot.io_points import IoKind, IoPoint
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Measured
from rtloop.backends.mujoco import MujocoBackend

OUTPUTS = {"glue": IoKind.BOOLEAN, "speed": IoKind.DIGITAL, "pressure": IoKind.ANALOG}
INPUTS = {"part": IoKind.BOOLEAN, "distance": IoKind.ANALOG}


@dataclass(frozen=True)
class Setting:
    """An output that was set, and in which cycle: the number of commands that were written before it."""

    name: str
    value: float
    cycle: int


class Wires:
    """Attributes:
    set: all outputs that were set, in their order.
    inputs: the values that are read.
    refuses: why outputs are rejected; "" while they are not.
    broken: why inputs cannot be read.
    written: number of commands so far.
    """

    def wire(self) -> None:
        self.set: list[Setting] = []
        self.inputs = dict.fromkeys(INPUTS, 0.0)
        self.outputs = dict.fromkeys(OUTPUTS, 0.0)
        self.refuses = self.broken = ""
        self.written = 0

    def io(self) -> tuple[IoPoint, ...]:
        outputs = (IoPoint(name, kind, True, self.outputs[name]) for name, kind in OUTPUTS.items())
        inputs = (IoPoint(name, kind, False, self.inputs[name]) for name, kind in INPUTS.items())
        return (*outputs, *inputs)

    def set_output(self, name: str, value: float) -> None:
        if self.refuses:
            raise BackendError(self.refuses)
        self.outputs[name] = value
        self.set.append(Setting(name, value, self.written))

    def read_input(self, name: str) -> float:
        if self.broken:
            raise BackendError(self.broken)
        return self.inputs[name]


class WiredArm(Wires, Loopback):
    """Attributes:
    push: wrench at the TCP that is measured, N and N·m.
    """

    capabilities = Capabilities(impedance=True, io=True)

    def __init__(self, dof: int) -> None:
        Loopback.__init__(self, dof)
        self.wire()
        self.push: Array = np.zeros(6)

    def read(self, measured: Measured) -> None:
        super().read(measured)
        measured.wrench[:] = self.push

    def write(self, command: Array) -> None:
        super().write(command)
        self.written += 1


class WiredSimulation(Wires, MujocoBackend):
    """The simulated arm with these inputs and outputs."""

    capabilities = replace(MujocoBackend.capabilities, io=True)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        MujocoBackend.__init__(self, settings, limits)
        self.wire()


class WiredService(VirtualService):
    """The service on virtual time, with a `WiredSimulation`."""

    arm: WiredSimulation

    def _rig(self, settings: Settings, robot: RobotDescription, capacity: int, several: bool) -> Rig:
        self.arm = WiredSimulation(settings, robot.limits)
        return self._rig_with(self.arm, "wired", settings, robot, capacity)
