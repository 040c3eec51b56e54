"""A cobot backend: a class that drives an arm, here a toy. Replace `ToyDevice` with your device.

cobot's document `docs/your-backend.md` explains each part.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from cobot.config import Settings
from cobot.robot.io_points import IoKind, IoPoint
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, BackendOptions, Capabilities, DeviceStatus, Measured
from rtloop.contract import FAULTS

T1_SPEED = 0.25
GRIPPER = "gripper closed"


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet from the device, which sends one per period.

    Attributes:
        number: sequence number, which increases by 1 with each packet.
        position, velocity: joint positions and velocities, shape (dof,), rad and rad/s.
        operation_mode: the selected operation mode, "T1" or "AUT".
        stopped: reason why the device's drives are off; "" if they are on.
    """

    number: int
    position: Array
    velocity: Array
    operation_mode: str
    stopped: str


class ToyDevice:
    """A simulated robot controller. It sends a packet in each period, and moves to the target in the last
    answer.

    Attributes:
        faults: the faults that are active now, for tests.
        wire: all positions that were sent to the device, for tests.
        gripper_closed: state of the device's only output.
    """

    def __init__(self, dof: int, period_s: float, *, realtime: bool = True) -> None:
        """
        Args:
            realtime: whether the device's periods take real time. If false, each call of `receive` passes one
                period.
        """
        self.faults: set[str] = set()
        self.wire: list[Array] = []
        self._period_s, self._realtime = period_s, realtime
        self._due_s = time.monotonic()
        self._number = 0
        self.gripper_closed = False
        self._position, self._velocity = np.zeros((2, dof))
        self._target: Array | None = None
        self._stopped = ""
        self._late: list[Packet] = []
        self._shown = self._position

    def place(self, position: Array) -> None:
        """Set the position of the arm. This is possible only with a simulated arm."""
        self._position = np.array(position)

    def receive(self, timeout_s: float) -> list[Packet]:
        """Return the packets that arrive within the timeout."""
        if self._realtime:
            remaining_s = self._due_s - time.monotonic()
            time.sleep(max(0.0, min(remaining_s, timeout_s)))
            if remaining_s > timeout_s:
                return []
            self._due_s = max(self._due_s, time.monotonic() - 0.1) + self._period_s
        self._advance()
        if "disconnect" in self.faults:
            return []
        if "frozen" not in self.faults:
            self._shown = self._position
        position = np.full_like(self._shown, np.nan) if "nan" in self.faults else self._shown
        velocity = np.zeros_like(position) if "frozen" in self.faults else self._velocity
        mode = "T1" if "operation_mode" in self.faults else "AUT"
        return self._through_the_network(Packet(self._number, position, velocity, mode, self._stopped))

    def send(self, position: Array) -> None:
        if "disconnect" not in self.faults:
            self.wire.append(position.copy())
            self._target = position.copy()

    def switch_on(self) -> None:
        """Switch the drives on at the current position.

        Raises:
            BackendError: the drives cannot be switched on now; the error gives the reason.
        """
        if "disconnect" in self.faults:
            raise BackendError("the device does not answer")
        self._stopped = self._cause()
        self._target = None
        if self._stopped:
            raise BackendError(self._stopped)

    def switch_off(self) -> None:
        self._target = None

    def _cause(self) -> str:
        if "e_stop" in self.faults:
            return "the emergency stop is pressed"
        return "a protective stop: the force was too great" if "protective_stop" in self.faults else ""

    def _advance(self) -> None:
        """Simulate one period."""
        self._number += 1
        self._stopped = self._stopped or self._cause()
        target = self._position if self._stopped or self._target is None else self._target
        self._velocity = (target - self._position) / self._period_s
        self._position = target

    def _through_the_network(self, packet: Packet) -> list[Packet]:
        unlucky = packet.number % 20 == 0
        if "loss" in self.faults and unlucky:
            return []
        if {"reorder", "pile_up"} & self.faults and unlucky:
            self._late.append(packet)
            return []
        late, self._late = self._late, []
        return [*late, packet] if "pile_up" in self.faults else [packet, *late]


class ToyOptions(BackendOptions):
    """The keys of `robot.backend` in the settings, in addition to `type`."""

    connect_s: float = Field(default=2.0, gt=0.0, le=15.0)


class ToyArm:
    """The backend. It implements the six methods of `Backend`, `wait` because the device is externally
    clocked, and `status` and `io`.
    """

    Options = ToyOptions
    capabilities = Capabilities(
        periods_s=(0.001, 0.002, 0.004),
        measured=frozenset({"position", "velocity"}),
        io=True,
        stops={2: False},
    )

    def __init__(self, settings: Settings, limits: JointLimits, device: ToyDevice | None = None) -> None:
        """
        Args:
            device: the device to use, for tests.
        """
        self._options = settings.backend_options(ToyOptions)
        self._period_s = settings.rt.period_s
        self._is_new = device is None
        self._device = device or ToyDevice(limits.dof, self._period_s)
        self._newest: Packet | None = None
        self._missed = self._lost = 0

    def open(self, initial_position: Array) -> None:
        if self._is_new:
            self._device.place(initial_position)
        for _ in range(round(self._options.connect_s / self._period_s)):
            if self.wait(self._period_s):
                return
        raise BackendError(f"no packet from the device in {self._options.connect_s:g} s: is it switched on?")

    def enable(self) -> None:
        if self._missed:
            raise BackendError(
                f"no packet has arrived from the device for {self._missed * self._period_s:.3f} s"
            )
        self._device.switch_on()
        self.wait(self._period_s)

    def wait(self, timeout_s: float) -> bool:
        for packet in self._device.receive(timeout_s):
            if self._newest is not None and packet.number <= self._newest.number:
                continue  # this packet arrived after its successor
            self._newest, self._missed = packet, -1
        self._missed += 1
        self._lost += self._missed > 0
        return self._missed == 0

    def read(self, measured: Measured) -> None:
        if self._newest is None:
            raise BackendError("no packet has arrived from the device yet")
        if self._newest.stopped:
            raise BackendError(self._newest.stopped)
        measured.position[:], measured.velocity[:] = self._newest.position, self._newest.velocity

    def write(self, command: Array) -> None:
        self._device.send(command[0])

    def disable(self) -> None:
        self._device.switch_off()

    def close(self) -> None:
        """Close the connection to the device here. The toy has none."""

    def status(self) -> DeviceStatus:
        if self._newest is None:
            return DeviceStatus(connection="no packet yet")
        by_hand = self._newest.operation_mode == "T1"
        return DeviceStatus(
            connection="silent" if self._missed else "connected",
            operation_mode=self._newest.operation_mode,
            safety_stop=self._newest.stopped,
            drives="off" if self._newest.stopped else "on",
            speed_scaling=T1_SPEED if by_hand else 1.0,
            packets_lost=self._lost,
        )

    def io(self) -> list[IoPoint]:
        return [IoPoint(GRIPPER, IoKind.BOOLEAN, is_output=True, value=float(self._device.gripper_closed))]

    def set_output(self, name: str, value: float) -> None:
        if name != GRIPPER:
            raise BackendError(f"{name} is not an output of this device")
        self._device.gripper_closed = bool(value)

    @classmethod
    def contract_rig(cls, settings: Settings, limits: JointLimits) -> ToyRig:
        """Create the rig for `cobot backend test`."""
        return ToyRig(cls, settings, limits)


class ToyRig:
    """The backend and its device in one process. Periods are counted, not timed, so that tests are fast."""

    faults = frozenset(FAULTS)

    def __init__(self, kind: type[ToyArm], settings: Settings, limits: JointLimits) -> None:
        self._kind, self._settings, self._limits = kind, settings, limits
        self._device = ToyDevice(limits.dof, settings.rt.period_s, realtime=False)
        start = 0.4 * limits.min_position + 0.6 * limits.max_position
        self._device.place(np.where(np.isfinite(start), start, 0.0))

    @property
    def wire(self) -> list[Array]:
        return self._device.wire

    def backend(self) -> ToyArm:
        return self._kind(self._settings, self._limits, self._device)

    def inject(self, fault: str) -> None:
        self._device.faults.add(fault)

    def clear(self, fault: str) -> None:
        self._device.faults.discard(fault)
