"""A simulated controller and a backend in one process, stepped period by period without a clock or
network.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

from rtloop.backends.simulators.network import Network
from rtloop.backends.simulators.udp_server import AnyController

UNLUCKY = 0.05
"""Fraction of the packets that are lost or arrive out of order."""
EVERY = round(1.0 / UNLUCKY)
RESTART_S = 1.0
"""Time that a restart of rtloop takes, during which the controller gets no answer, s."""


class LockStep(Generic[AnyController]):
    """A `PacketChannel` to a simulated controller. Each wait runs the controller's next period.

    Attributes:
        time_s: time of the controller, which the backend uses as its own.
        off: whether the cable is disconnected.
        strangers: always 0, because there is no other sender.
        busy: whether every `EVERY`-th wait returns two packets instead of one, as on a busy computer.
        pause: number of periods that pass before the next packet is read, as on a busy computer.
    """

    strangers = 0

    def __init__(self, controller: AnyController, network: Network) -> None:
        self.controller, self.network = controller, network
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
            self.time_s += self.controller.period_s
            for packet in self.network.arrived():
                self.controller.answer(packet)
            packets = self.network.to_client(self.controller.packet())
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
                self.controller.answer(arrived)

    def close(self) -> None:
        pass

    def clock(self) -> float:
        return self.time_s


class LossyNetwork(Protocol):
    """Interface of a network that can lose packets. The attributes are those of `Network`."""

    loss: float
    reorder: float
    spoil: str


class FaultyConnection(Protocol):
    """The connection between a backend and a controller in one process; see `LockStep` for the attributes."""

    off: bool
    busy: bool

    @property
    def network(self) -> LossyNetwork: ...


Connection = TypeVar("Connection", bound=FaultyConnection)


class LockStepRig(ABC, Generic[Connection]):
    """A rig that injects faults of the connection and of the controller."""

    _channel: Connection

    def inject(self, fault: str) -> None:
        self._set(fault, active=True)

    def clear(self, fault: str) -> None:
        self._set(fault, active=False)

    def _set(self, fault: str, *, active: bool) -> None:
        channel = self._channel
        if fault == "disconnect":
            channel.off = active
        elif fault == "pile_up":
            channel.busy = active
        elif fault in ("frozen", "nan"):
            channel.network.spoil = fault if active else ""
        elif fault in ("loss", "reorder"):
            setattr(channel.network, fault, UNLUCKY if active else 0.0)
        else:
            self._set_controller(fault, active=active)

    @abstractmethod
    def _set_controller(self, fault: str, *, active: bool) -> None:
        """Inject or clear a fault of the controller."""
