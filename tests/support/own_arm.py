"""A backend of somebody's own, `robot.backend: own_arm:Arm`: plain Python, always where it is told to be."""

from __future__ import annotations

import numpy as np

from cobot.config import Settings
from cobot.types import Array, JointLimits
from rtloop.backends import Measured


class Arm:
    """Keeps what it was told, as rows of position, velocity and acceleration."""

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        self.commands: list[Array] = []
        self.calls: list[str] = []
        self._position, self._velocity = np.zeros((2, limits.dof))

    def open(self, initial_position: Array) -> None:
        self.calls.append("open")
        self._position[:] = initial_position

    def enable(self) -> None:
        self.calls.append("enable")

    def read(self, measured: Measured) -> None:
        measured.position[:], measured.velocity[:] = self._position, self._velocity

    def write(self, command: Array) -> None:
        self.commands.append(command.copy())
        self._position[:], self._velocity[:] = command[0], command[1]

    def disable(self) -> None:
        self.calls.append("disable")

    def close(self) -> None:
        self.calls.append("close")


class Boasts(Arm):
    capabilities = "yes"


class BoastsLater(Arm):
    @property
    def capabilities(self) -> dict[str, bool]:
        return {"hardware": True}
