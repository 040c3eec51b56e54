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
from cobot.types import JointLimits
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
    capabilities = replace(MujocoBackend.capabilities, hardware=True, brakes=True)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self._file = fault_file(settings.robot.name)

    def status(self) -> DeviceStatus:
        reason = ""
        with contextlib.suppress(FileNotFoundError):
            reason = self._file.read_text(encoding="utf-8")
        self.drive_fault = reason
        return STATUS
