"""A cobot backend for a device that executes whole motions, here a toy. Replace `ToyDevice` with your device.

cobot's document `docs/your-backend.md` explains each part.
"""

from __future__ import annotations

import time

import numpy as np
from pydantic import Field

from cobot.config import Settings
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, BackendOptions, Capabilities, DeviceStatus, Measured

STATE_PERIOD_S = 0.05
STOPPING_S = 0.3


class ToyDevice:
    """A simulated robot controller that executes a motion autonomously and reports its position on request.

    Attributes:
        faults: the faults that are active now, for tests.
    """

    def __init__(self, dof: int, *, realtime: bool = True) -> None:
        """
        Args:
            realtime: whether the device uses the computer's clock. If false, each call of `look` passes
                `STATE_PERIOD_S`.
        """
        self.faults: set[str] = set()
        self._realtime = realtime
        self._time_s = time.monotonic()
        self._position, self._velocity = np.zeros((2, dof))
        self._shown = self._position, self._velocity
        self._motion: Trajectory | None = None
        self._rate, self._done_s = 0.0, 0.0
        self._stopping = False
        self._stopped = ""

    def place(self, position: Array) -> None:
        """Set the position of the arm. This is possible only with a simulated arm."""
        self._position = np.array(position)

    def look(self) -> tuple[Array, Array]:
        """Return the positions and the velocities of the joints, each of shape (dof,), rad and rad/s."""
        self._answer()
        self._advance(time.monotonic() - self._time_s if self._realtime else STATE_PERIOD_S)
        if self._stopped:
            raise BackendError(self._stopped)
        if "nan" in self.faults:
            return np.full_like(self._position, np.nan), self._velocity
        if "frozen" not in self.faults:
            self._shown = self._position, self._velocity
        return self._shown

    def load(self, motion: Trajectory) -> None:
        self._answer()
        self._motion, self._done_s, self._rate = motion, 0.0, 0.0

    def start(self) -> None:
        self._answer()
        self._time_s, self._rate, self._stopping = time.monotonic(), 1.0, False

    def done_s(self) -> float:
        self._answer()
        return self._done_s

    def stop(self) -> None:
        self._answer()
        self._stopping = True

    def switch_on(self) -> None:
        """Switch the drives on at the current position."""
        self._answer()
        self._stopped = self._cause()
        if self._stopped:
            raise BackendError(self._stopped)

    @property
    def operation_mode(self) -> str:
        return "T1" if "operation_mode" in self.faults else "AUT"

    def _answer(self) -> None:
        if "disconnect" in self.faults:
            raise BackendError("the device does not answer")

    def _cause(self) -> str:
        if "e_stop" in self.faults:
            return "the emergency stop is pressed"
        return "a protective stop: the force was too great" if "protective_stop" in self.faults else ""

    def _advance(self, passed_s: float) -> None:
        self._time_s += passed_s
        self._stopped = self._stopped or self._cause()
        if self._stopped:
            self._rate = 0.0
        before = self._rate
        if self._stopping:
            self._rate = max(0.0, before - passed_s / STOPPING_S)
        if self._motion is None:
            return
        self._done_s = min(self._done_s + 0.5 * (before + self._rate) * passed_s, self._motion.duration_s)
        self._position = self._motion.sample([self._done_s])[0]
        self._velocity = self._rate * self._motion.sample([self._done_s], 1)[0]


class ToyOptions(BackendOptions):
    """The keys of `robot.backend` in the settings, in addition to `type`."""

    connect_s: float = Field(default=2.0, gt=0.0, le=15.0)


class ToyArm:
    """The backend: the methods of `TrajectoryDevice`, and `status`."""

    Options = ToyOptions
    capabilities = Capabilities(measured=frozenset({"position", "velocity"}), stops={2: False})
    state_period_s = STATE_PERIOD_S

    def __init__(self, settings: Settings, limits: JointLimits, device: ToyDevice | None = None) -> None:
        """
        Args:
            device: the device to use, for tests.
        """
        self._options = settings.backend_options(ToyOptions)
        self._is_new = device is None
        self._device = device or ToyDevice(limits.dof)

    def open(self, initial_position: Array) -> None:
        if self._is_new:
            self._device.place(initial_position)
        self._device.look()  # for a real device, wait here for its connection, at most `connect_s`

    def enable(self) -> None:
        self._device.switch_on()

    def state(self, measured: Measured) -> None:
        measured.position[:], measured.velocity[:] = self._device.look()

    def load(self, times_s: Array, rows: Array) -> None:
        self._device.load(from_hermite(times_s, *rows))

    def start(self) -> None:
        self._device.start()

    def progress(self) -> float:
        return self._device.done_s()

    def stop(self) -> None:
        self._device.stop()

    def disable(self) -> None:
        """Switch the device's drives off here. The toy has no drives."""

    def close(self) -> None:
        """Close the connection to the device here. The toy has none."""

    def status(self) -> DeviceStatus:
        return DeviceStatus(connection="connected", operation_mode=self._device.operation_mode)

    @classmethod
    def contract_rig(cls, settings: Settings, limits: JointLimits) -> ToyRig:
        """Create the rig for `cobot backend test`."""
        return ToyRig(cls, settings, limits)


class ToyRig:
    """The backend and its device in one process. Time is counted, not measured, so that tests are fast."""

    faults = frozenset({"disconnect", "frozen", "nan", "e_stop", "protective_stop", "operation_mode"})

    def __init__(self, kind: type[ToyArm], settings: Settings, limits: JointLimits) -> None:
        self._kind, self._settings, self._limits = kind, settings, limits
        self._device = ToyDevice(limits.dof, realtime=False)
        start = 0.4 * limits.min_position + 0.6 * limits.max_position
        self._device.place(np.where(np.isfinite(start), start, 0.0))

    def backend(self) -> ToyArm:
        return self._kind(self._settings, self._limits, self._device)

    def inject(self, fault: str) -> None:
        self._device.faults.add(fault)

    def clear(self, fault: str) -> None:
        self._device.faults.discard(fault)
