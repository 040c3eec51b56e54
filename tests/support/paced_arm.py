"""A device that gives the beat, on a clock of its own: its faults are plain attributes.

It stands for any device with packets: `beats` says which of them come, and nothing in it waits.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from cobot.config import Settings
from cobot.robot.device import Capabilities, DeviceStatus
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, BackendOptions, Measured


class PacedOptions(BackendOptions):
    address: str = "192.0.2.1"
    port: int = Field(default=30200, ge=1, le=65535)


class PacedArm:
    """Is where the last packet told it to be.

    Attributes:
        beats: whether each packet comes, in turn; after the last one all do.
        gone: why there is no connection, "" for one.
        report: what it says of itself.
        written: the positions that it was told, one for each packet that was answered.
        waited_s: the timeouts that it was given.
    """

    Options = PacedOptions
    capabilities = Capabilities(
        periods_s=(0.001, 0.005), measured=frozenset({"position", "velocity"}), stops={1: True, 2: False}
    )

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        self.options = settings.backend_options(PacedOptions)
        self.beats: Iterator[bool] = iter(())
        self.gone = ""
        self.report = DeviceStatus(connection="connected", quality="EXCELLENT")
        self.written: list[Array] = []
        self.waited_s: list[float] = []
        self._position, self._velocity = np.zeros((2, limits.dof))

    def open(self, initial_position: Array) -> None:
        self._position[:] = initial_position

    def enable(self) -> None: ...

    def wait(self, timeout_s: float) -> bool:
        self.waited_s.append(timeout_s)
        if self.gone:
            raise BackendError(self.gone)
        return next(self.beats, True)

    def read(self, measured: Measured) -> None:
        measured.position[:], measured.velocity[:] = self._position, self._velocity

    def write(self, command: Array) -> None:
        self.written.append(command[0].copy())
        self._position[:], self._velocity[:] = command[0], command[1]

    def status(self) -> DeviceStatus:
        return self.report

    def disable(self) -> None: ...

    def close(self) -> None: ...
