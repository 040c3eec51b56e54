"""A test rig for the `fri` backend, with a simulated cabinet in the same process."""

from __future__ import annotations

import numpy as np

from cobot.config import Settings
from cobot.robot.srdf import load_named_positions
from cobot.types import Array, JointLimits
from rtloop.backends.fri.backend import FriBackend
from rtloop.backends.fri.codec import decode_command
from rtloop.backends.fri.messages import CommandMessage, IoDirection, IoType, IoValue, OperationMode
from rtloop.backends.fri.simulator.cabinet import Cabinet
from rtloop.backends.fri.simulator.network import FriNetwork
from rtloop.backends.fri.simulator.options import CabinetOptions
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.lockstep import RESTART_S, LockStep, LockStepRig
from rtloop.contract import FAULTS


class FriRig(LockStepRig[LockStep[Cabinet]]):
    """A `ContractRig` with the `fri` backend and a simulated cabinet."""

    faults = frozenset(FAULTS)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        self._settings, self._limits = settings, limits
        names = settings.robot
        start = load_named_positions(names.srdf, limits.names, names.group)[names.start_position].joints
        io = tuple(IoValue(f"Cell.{each.name}", each, IoDirection.OUTPUT) for each in IoType)
        cell = CabinetOptions(period_ms=round(settings.rt.period_s * 1e3), io=io)
        arm = ControllerArm(settings, limits, np.array(start), cell.springs)
        self._channel = LockStep(Cabinet(arm, cell), FriNetwork())

    @property
    def wire(self) -> list[Array]:
        """Return the positions of all answers."""
        decoded = map(decode_command, self._channel.answers)
        return [
            np.array(each.position) for each in decoded if isinstance(each, CommandMessage) and each.position
        ]

    def backend(self) -> FriBackend:
        for _ in range(round(RESTART_S / self._channel.controller.period_s)):
            self._channel.receive(0.0)
        return FriBackend(self._settings, self._limits, channel=self._channel, clock=self._channel.clock)

    def _set_controller(self, fault: str, *, active: bool) -> None:
        cabinet = self._channel.controller
        if fault == "operation_mode":
            cabinet.switch_mode(OperationMode.T1 if active else OperationMode.AUT)
        else:
            cabinet.stop_safely((0 if fault == "e_stop" else 1) if active else -1)
