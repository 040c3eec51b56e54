"""The simulated arm as a real one, `robot.backend: panel_arm:PanelArm`: it says how it is, has to be
acknowledged, and fails as soon as the file that `fault_file` names has a reason in it.
"""

from __future__ import annotations

import contextlib
import tempfile
from dataclasses import replace
from pathlib import Path

from cobot.config import Settings
from cobot.robot.device import DeviceStatus
from cobot.robot.io_points import IoKind, IoPoint
from cobot.types import JointLimits
from rtloop.backends import BackendError
from rtloop.backends.mujoco import MujocoBackend

STATUS = DeviceStatus(
    connection="COMMANDING_ACTIVE",
    quality="GOOD",
    operation_mode="T1",
    drives="on",
    brakes="released",
    packets_lost=7,
)


def fault_file(robot: str) -> Path:
    return Path(tempfile.gettempdir()) / f"{robot}.fault"


class PanelArm(MujocoBackend):
    """Attributes:
    deaf: whether it does nothing with outputs that are set.
    refuses: why it takes none, "" if it does.
    """

    capabilities = replace(MujocoBackend.capabilities, hardware=True, brakes=True, io=True)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self._file = fault_file(settings.robot.name)
        self._io = {
            each.name: each
            for each in (
                IoPoint("Gripper.Close", IoKind.BOOLEAN, True, 0.0),
                IoPoint("Gripper.Force", IoKind.ANALOG, True, 2.5),
                IoPoint("Belt.Speed", IoKind.DIGITAL, True, 3.0),
                IoPoint("Part.There", IoKind.BOOLEAN, False, 1.0),
                IoPoint("Lamp.Green", IoKind.BOOLEAN, True, 0.0),
                IoPoint("Lamp.Red", IoKind.BOOLEAN, True, 0.0),
            )
        }
        self.deaf, self.refuses = False, ""

    def status(self) -> DeviceStatus:
        reason = ""
        with contextlib.suppress(FileNotFoundError):
            reason = self._file.read_text(encoding="utf-8")
        self.drive_fault = reason
        return STATUS

    def io(self) -> list[IoPoint]:
        return list(self._io.values())

    def set_output(self, name: str, value: float) -> None:
        if self.refuses:
            raise BackendError(self.refuses)
        if not self.deaf:
            self._io[name] = replace(self._io[name], value=value)
