"""A simulated cabinet and a backend in one process, stepped period by period without a clock or network."""

from __future__ import annotations

from typing import Generic

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
from rtloop.backends.fri.simulator.server import AnyCabinet
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.network import Network
from rtloop.contract import FAULTS

UNLUCKY = 0.05
"""Fraction of the packets that are lost or arrive out of order."""
EVERY = round(1.0 / UNLUCKY)
RESTART_S = 1.0
"""Time for the start of rtloop, during which the cabinet gets no answer, s."""


class LockStep(Generic[AnyCabinet]):
    """A `PacketChannel` to a cabinet. Each wait runs the cabinet's next period.

    Attributes:
        time_s: time of the cabinet, which the backend uses as its own.
        off: whether the cable is disconnected.
        strangers: always 0, because there is no other sender.
        busy: whether one in `EVERY` waits finds two packets instead of one.
        pause: number of periods that pass before the next packet is read, as on a busy computer.
    """

    strangers = 0

    def __init__(self, cabinet: AnyCabinet, network: Network) -> None:
        self.cabinet, self.network = cabinet, network
        self.time_s = 0.0
        self.off = False
        self.busy = False
        self.pause = self._waits = 0
        self.answers: list[bytes] = []
        self.injected: list[bytes] = []

    def receive(self, timeout_s: float) -> list[bytes]:
        end_s = self.time_s + max(timeout_s, 0.0)
        waiting: list[bytes] = []
        self._waits += 1
        if self.busy and self._waits % EVERY == 0:
            self.pause = 1
        while True:
            self.time_s += self.cabinet.period_s
            for packet in self.network.arrived():
                self.cabinet.answer(packet)
            packets = self.network.to_client(self.cabinet.packet())
            packets, self.injected = self.injected + packets, []
            if not self.off:
                waiting += [self.network.spoil_packet(packet) for packet in packets]
            if self.pause:
                self.pause -= 1
            elif waiting or self.time_s >= end_s:
                return waiting

    def send(self, packet: bytes) -> None:
        self.answers.append(packet)
        if not self.off:
            for arrived in self.network.from_client(packet):
                self.cabinet.answer(arrived)

    def close(self) -> None:
        pass

    def clock(self) -> float:
        return self.time_s


class FriRig:
    """The backend `fri` and a simulated cabinet. It is a `ContractRig`, which the contract drives and into
    which it injects faults.
    """

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
        """The positions of all answers."""
        decoded = map(decode_command, self._channel.answers)
        return [
            np.array(each.position) for each in decoded if isinstance(each, CommandMessage) and each.position
        ]

    def backend(self) -> FriBackend:
        for _ in range(round(RESTART_S / self._channel.cabinet.period_s)):
            self._channel.receive(0.0)
        return FriBackend(self._settings, self._limits, channel=self._channel, clock=self._channel.clock)

    def inject(self, fault: str) -> None:
        channel, cabinet = self._channel, self._channel.cabinet
        if fault == "disconnect":
            channel.off = True
        elif fault in ("frozen", "nan"):
            channel.network.spoil = fault
        elif fault == "loss":
            channel.network.loss = UNLUCKY
        elif fault == "reorder":
            channel.network.reorder = UNLUCKY
        elif fault == "pile_up":
            channel.busy = True
        elif fault == "operation_mode":
            cabinet.switch_mode(OperationMode.T1)
        else:
            cabinet.stop_safely(0 if fault == "e_stop" else 1)

    def clear(self, fault: str) -> None:
        channel, cabinet = self._channel, self._channel.cabinet
        if fault == "disconnect":
            channel.off = False
        elif fault in ("frozen", "nan"):
            channel.network.spoil = ""
        elif fault in ("loss", "reorder"):
            channel.network.loss = channel.network.reorder = 0.0
        elif fault == "pile_up":
            channel.busy = False
        elif fault == "operation_mode":
            cabinet.switch_mode(OperationMode.AUT)
        else:
            cabinet.stop_safely(-1)
