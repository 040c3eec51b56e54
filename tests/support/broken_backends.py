"""Backends that break the contract, each in one way."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cobot.config import Settings
from cobot.robot.device import DeviceStatus
from cobot.robot.io_points import IoPoint
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Capabilities, Measured
from rtloop.contract import toy_trajectory
from rtloop.contract.toy import ToyArm, ToyRig


class InDegrees(ToyArm):
    def read(self, measured: Measured) -> None:
        super().read(measured)
        measured.position[:] = np.degrees(measured.position)


class ClaimsTorques(ToyArm):
    capabilities = Capabilities(periods_s=(0.001,), measured=frozenset({"position", "velocity", "effort"}))


class ClaimsAForce(ToyArm):
    capabilities = replace(ToyArm.capabilities, wrench=True)


class ForgetsOutputs(ToyArm):
    def set_output(self, name: str, value: float) -> None:
        if name != "gripper closed":
            super().set_output(name, value)


class TakesAnyOutput(ToyArm):
    def set_output(self, name: str, value: float) -> None:
        self._device.gripper_closed = bool(value)


class HasASlash(ToyArm):
    def io(self) -> list[IoPoint]:
        return [replace(each, name="gripper/closed") for each in super().io()]


class ClaimsOutputs(toy_trajectory.ToyArm):
    capabilities = replace(toy_trajectory.ToyArm.capabilities, io=True)


class SendsTheLast(ToyArm):
    """Has a queue of one command."""

    last: Array | None = None

    def write(self, command: Array) -> None:
        if self.last is not None:
            self._device.send(self.last)
        self.last = command[0].copy()


class Jumps(ToyArm):
    """A while after a reset it sends one command that leads aside."""

    cycles = -1

    def enable(self) -> None:
        self.cycles = -1 if self.cycles < 0 and not self._lost else 100
        super().enable()

    def write(self, command: Array) -> None:
        self.cycles -= 1
        self._device.send(command[0] + (1e-4 if self.cycles == 0 else 0.0))


class Raises(ToyArm):
    def read(self, measured: Measured) -> None:
        raise KeyError("joint8")


class Mute(Exception):
    def __str__(self) -> str:
        raise SystemExit(3)


class RaisesTheUnspeakable(ToyArm):
    def read(self, measured: Measured) -> None:
        raise Mute


class EndsTheProcess(ToyArm):
    def write(self, command: Array) -> None:
        raise SystemExit(1)


class ReportsForEver(ToyArm):
    def io(self) -> Iterator[IoPoint]:  # type: ignore[override]
        return itertools.cycle(super().io())


class NamesAnEscape(ToyArm):
    def io(self) -> list[IoPoint]:
        return [replace(each, name="\x1b[2J") for each in super().io()]


class Coarse(ToyArm):
    """Sends hundredths of degrees."""

    def write(self, command: Array) -> None:
        self._device.send(np.radians(np.round(np.degrees(command[0]), 2)))


class StrangeMode(ToyArm):
    def status(self) -> DeviceStatus:
        return replace(super().status(), operation_mode="MANUAL")


class SaysAlwaysAuto(ToyArm):
    def status(self) -> DeviceStatus:
        return replace(super().status(), operation_mode="AUT")


class HidesStops(ToyArm):
    def read(self, measured: Measured) -> None:
        assert self._newest is not None
        self._newest = replace(self._newest, stopped="")
        super().read(measured)


class Impatient(ToyArm):
    """Takes one lost packet for the end of its connection."""

    def wait(self, timeout_s: float) -> bool:
        if not super().wait(timeout_s):
            raise BackendError("a packet was lost")
        return True


class NeedsARestart(ToyArm):
    """Has to be opened again after a stop."""

    stopped = False

    def read(self, measured: Measured) -> None:
        assert self._newest is not None
        self.stopped = self.stopped or bool(self._newest.stopped)
        super().read(measured)

    def enable(self) -> None:
        if self.stopped:
            raise BackendError("open it again")
        super().enable()


class GoesHome(ToyArm):
    """Is put where the settings say, wherever it is."""

    def open(self, initial_position: Array) -> None:
        super().open(initial_position)
        self._device.place(np.zeros_like(initial_position))


class CannotHold(ToyArm):
    """Releases its arm, and does not follow commands again."""

    capabilities = replace(ToyArm.capabilities, freedrive=True)

    def begin_guiding(self) -> None: ...

    def end_guiding(self) -> None: ...

    def follow_commands(self) -> None:
        raise BackendError("its brakes are closed")


class Real:
    """Moves something, and has no device to be tried on."""

    capabilities = Capabilities(hardware=True)


class StrangeRig(ToyArm):
    @classmethod
    def contract_rig(cls, settings: Settings, limits: JointLimits) -> ToyRig:
        rig = super().contract_rig(settings, limits)
        rig.faults = frozenset({"lightning"})
        return rig


class StopsNot(toy_trajectory.ToyArm):
    def stop(self) -> None:
        """It goes on."""


class SaysItIsThere(toy_trajectory.ToyArm):
    def progress(self) -> float:
        return super().progress() + 0.5


class OneForAll(ToyArm):
    def read(self, measured: Measured) -> None:
        super().read(measured)
        measured.position = measured.position[:1]
