"""A simulated controller and a backend in one process, stepped period by period without a clock or
network.
"""

from __future__ import annotations

import numpy as np

from cobot.config import Settings
from cobot.robot.srdf import load_named_positions
from cobot.types import Array, JointLimits
from rtloop.backends.fanuc.backend import FanucBackend
from rtloop.backends.fanuc.codec import decode_sent
from rtloop.backends.fanuc.messages import CommandPacket
from rtloop.backends.fanuc.options import FanucOptions
from rtloop.backends.fanuc.rmi import RmiClient, RmiLines
from rtloop.backends.fanuc.simulator.controller import CONTACT, E_STOP, FanucController
from rtloop.backends.fanuc.simulator.network import FanucNetwork
from rtloop.backends.fanuc.simulator.options import FanucControllerOptions
from rtloop.backends.fanuc.simulator.rmi import RmiAnswers
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.lockstep import EVERY, RESTART_S, LockStepRig
from rtloop.contract import FAULTS

SESSION_PORT = 16002
IO = {"DI[1]": 0, "DI[2]": 1, "DO[1]": 1, "DO[2]": 0, "RO[1]": 0, "F[3]": 0, "AI[1]": 12, "AO[1]": 7}


class FanucLockStep:
    """A `StreamChannel` to a simulated controller. Each wait runs the controller's next period.

    Attributes:
        time_s: time of the controller, which the backend uses as its own.
        off: whether the cable is disconnected.
        busy: whether every `EVERY`-th wait returns two packets instead of one, as on a busy computer.
        sent: all packets that the backend has sent.
        injected: additional packets to the backend that the controller did not send.
    """

    def __init__(self, controller: FanucController, network: FanucNetwork) -> None:
        self.controller, self.network = controller, network
        self.answers = RmiAnswers(controller)
        self.answers.session_port = SESSION_PORT
        self.time_s = 0.0
        self.off = self.busy = False
        self._pause = self._waits = 0
        self.sent: list[bytes] = []
        self.injected: list[bytes] = []
        self._waiting: list[bytes] = []

    def receive(self, timeout_s: float) -> list[bytes]:
        end_s = self.time_s + max(timeout_s, 0.0)
        self._waits += 1
        if self.busy and self._waits % EVERY == 0:
            self._pause = 1
        while True:
            if not self._waiting or self._pause:
                self._pause = max(0, self._pause - 1)
                self.step()
            if (self._waiting and not self._pause) or self.time_s >= end_s:
                found, self._waiting = self._waiting, []
                return found

    def step(self) -> None:
        """Run one period of the controller."""
        self.time_s += self.controller.period_s
        for packet in self.network.arrived():
            self._hear(packet)
        packets = self.network.to_client(self.controller.step())
        packets, self.injected = self.injected + packets, []
        if not self.off:
            self._waiting += [self.network.spoil_packet(packet) for packet in packets]

    def send(self, packet: bytes) -> None:
        self.sent.append(packet)
        if not self.off:
            for arrived in self.network.from_client(packet):
                self._hear(arrived)

    def _hear(self, packet: bytes) -> None:
        reply = self.controller.hear(packet)
        if reply:
            self._waiting.append(reply)

    def close(self) -> None:
        pass

    def clock(self) -> float:
        return self.time_s

    def sleep(self, time_s: float) -> None:
        end_s = self.time_s + time_s
        while self.time_s < end_s:
            self.step()

    def connect(self, port: int, timeout_s: float) -> RmiLines:
        """Open a connection to a port of the Remote Motion Interface. Returns an object that exchanges lines
        of text.
        """
        if self.off:
            raise TimeoutError("timed out")
        if port == SESSION_PORT:
            self.answers.occupied = True
        return LockStepLines(self, session=port == SESSION_PORT)

    def client(self) -> RmiClient:
        return RmiClient("the simulated controller", 16001, 1.0, self.connect)

    def kill_client(self) -> None:
        """Simulate a crash of the backend's process, which also closes its connection."""
        self.answers.leave()


class LockStepLines:
    """`RmiLines` to the controller in this process."""

    def __init__(self, channel: FanucLockStep, *, session: bool) -> None:
        self._channel, self._session = channel, session
        self._replies: list[bytes] = []

    def send(self, line: bytes) -> None:
        if self._channel.off:
            raise BrokenPipeError("broken pipe")
        answers = self._channel.answers
        reply = answers.answer(line) if self._session else answers.greet(line)
        if reply:
            self._replies.append(reply.rstrip())

    def receive(self, timeout_s: float) -> bytes:
        if self._channel.off or not self._replies:
            raise TimeoutError("timed out")
        return self._replies.pop(0)

    def close(self) -> None:
        if self._session:
            self._channel.answers.leave()


class FanucRig(LockStepRig[FanucLockStep]):
    """A `ContractRig` with the `fanuc` backend and a simulated controller."""

    faults = frozenset(FAULTS)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        options = settings.backend_options(FanucOptions) or FanucOptions()
        points = [*options.io, *(name for name in IO if name not in options.io)]
        backend = settings.robot.backend.model_copy(
            update={"options": options.model_dump(exclude_defaults=True) | {"io": points}}
        )
        robot = settings.robot.model_copy(update={"backend": backend})
        self._settings, self._limits = settings.model_copy(update={"robot": robot}), limits
        start = load_named_positions(robot.srdf, limits.names, robot.group)[robot.start_position].joints
        cell = FanucControllerOptions(
            period_ms=round(settings.rt.period_s * 1e3),
            horizon=options.j3 == "horizon",
            # axis 3 moves at the sum of the speeds of two joints
            table_share=2.0 if options.j3 == "horizon" else 1.0,
            io={name: IO.get(name, 0) for name in points},
            world_z_m=options.world_z_m or 0.0,
        )
        arm = ControllerArm(settings, limits, np.array(start))
        self._channel = FanucLockStep(FanucController(arm, cell), FanucNetwork())
        self._units = self._channel.controller.units

    @property
    def wire(self) -> list[Array]:
        """Return the positions of all commands."""
        decoded = map(decode_sent, self._channel.sent)
        return [self._units.to_model(each.position) for each in decoded if isinstance(each, CommandPacket)]

    def backend(self) -> FanucBackend:
        channel = self._channel
        channel.kill_client()
        channel.sleep(RESTART_S)
        channel.receive(0.0)
        return FanucBackend(
            self._settings,
            self._limits,
            channel=channel,
            rmi=channel.client(),
            clock=channel.clock,
            sleep=channel.sleep,
        )

    def _set_controller(self, fault: str, *, active: bool) -> None:
        controller = self._channel.controller
        if fault == "operation_mode":
            controller.switch_mode("T1" if active else "AUTO")
        else:
            change = controller.press if active else controller.release
            change(E_STOP if fault == "e_stop" else CONTACT)
