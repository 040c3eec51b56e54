"""The simulated arm with the inputs and outputs of docs/programs.md: a belt brings a part while it runs."""

from __future__ import annotations

from dataclasses import replace

from rig import Rig
from virtual_service import VirtualService

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.robot.io_points import IoKind, IoPoint
from cobot.types import JointLimits
from rtloop.backends.mujoco import MujocoBackend


class CellArm(MujocoBackend):
    """Attributes:
    was_set: each output that was set, with its value.
    """

    capabilities = replace(MujocoBackend.capabilities, io=True)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self.was_set: list[tuple[str, float]] = []
        self.outputs = {"belt": 0.0, "lamp": 0.0}

    def io(self) -> list[IoPoint]:
        outputs = [IoPoint(name, IoKind.BOOLEAN, True, value) for name, value in self.outputs.items()]
        part = IoPoint("part_there", IoKind.BOOLEAN, False, self.outputs["belt"])
        return [*outputs, part, IoPoint("pressure", IoKind.ANALOG, False, 0.7)]

    def set_output(self, name: str, value: float) -> None:
        self.was_set.append((name, value))
        self.outputs[name] = value


class ServiceOfCell(VirtualService):
    """A service with that arm."""

    arm: CellArm

    def _rig(self, settings: Settings, robot: RobotDescription, capacity: int, several: bool) -> Rig:
        self.arm = CellArm(settings, robot.limits)
        return self._rig_with(self.arm, "cell_arm", settings, robot, capacity)
