"""FANUC arms over Stream Motion. The Remote Motion Interface handles the power, the program and the alarms.

This module is long because it contains all methods of this device that the cycle calls.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cobot.config import Settings
from cobot.robot.io_points import IoPoint
from cobot.robot.model import RobotModel
from cobot.robot.tool import BARE, Tool
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Capabilities, DeviceStatus, Measured
from rtloop.backends.beat import Beat, CommandTransition
from rtloop.backends.fanuc.agreement import ArmAgreement
from rtloop.backends.fanuc.bring_up import BringUp, RmiReport
from rtloop.backends.fanuc.codec import decode_received, encode_command, encode_start, encode_stop
from rtloop.backends.fanuc.joints import JointUnits
from rtloop.backends.fanuc.limits_table import LimitsTable
from rtloop.backends.fanuc.messages import AXES, CommandPacket, RobotFlag, StatusPacket
from rtloop.backends.fanuc.options import FanucOptions
from rtloop.backends.fanuc.points import Points
from rtloop.backends.fanuc.rmi import RmiClient, TcpLines
from rtloop.backends.fanuc.stream import Handshake, StreamChannel, UdpClient
from rtloop.backends.fanuc.words import safety_stop, why_not_ready
from rtloop.backends.fanuc.worker import RmiWorker
from rtloop.backends.protocols import require_accepted

if TYPE_CHECKING:
    from rtloop.contract import ContractRig

START_S = 0.5
"""Interval between requests to a controller that sends no state, s."""
POLL_S = 1.0
LAST_S = 0.5
"""Timeout for sending the last command of a motion, s."""


class FanucBackend:
    """An externally clocked `Backend` that also implements `Paced`, `Reporting`, `Stepwise`, `CarriesTool`
    and `HasIo`.

    While the arm is enabled, each of the controller's packets is answered once. Otherwise no packet is
    answered.

    Attributes:
        report_period_s: see `HasIo`. The collaborative speed clamp is also read at this interval.
    """

    Options = FanucOptions
    capabilities = Capabilities(
        periods_s=(0.001, 0.002, 0.004, 0.008),
        measured=frozenset({"position", "velocity"}),
        io=True,
        stops={2: False},  # the controller switches the drives
        hardware=True,
    )
    report_period_s = 0.05

    def __init__(
        self,
        settings: Settings,
        limits: JointLimits,
        *,
        channel: StreamChannel | None = None,
        rmi: RmiClient | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Create the backend. The optional arguments replace the network and its clock in tests."""
        if limits.dof > AXES:
            raise BackendError(f"Stream Motion has {AXES} axes, but this robot has {limits.dof}")
        options = settings.backend_options(FanucOptions)
        self._options = options = options if options is not None else FanucOptions()
        self._limits, self._robot, self._period_s = limits, settings.robot, settings.rt.period_s
        self._channel, self._clock, self._sleep = channel, clock, sleep
        host = options.address or ""
        self._rmi = rmi or RmiClient(host, options.rmi_port, options.connect_s, partial(TcpLines, host))
        self._worker = RmiWorker(threaded=rmi is None)
        self._bring_up = BringUp(self._rmi, options, clock, sleep)
        self._points = Points(options.io)
        self._beat = Beat[StatusPacket](limits.dof, self._period_s)
        self._transition = CommandTransition(limits.dof, self._period_s)
        self._units = JointUnits(limits)
        self._table: LimitsTable | None = None
        self._tool = BARE
        self._version = 0
        self._heard_s = self._asked_s = self._refused_s = self._started_s = self._polled_s = 0.0
        self._join_until_s = 0.0  # time after enabling in which the program may restart without a fault
        self._refused = self._lost = ""
        self._late = 0
        self._starts = self._answered = True
        self._enabled = False
        self._unended = False  # whether a motion of the controller waits for its last command
        self._enabling: Future[None] | None = None
        self._poll: Future[RmiReport] | None = None
        self._report = RmiReport()

    # Backend

    def open(self, initial_position: Array) -> None:
        options = self._options
        if options.address is None and self._channel is None:
            raise BackendError("robot.backend.address is missing: set it to the address of the controller")
        self._worker.begin(self._rmi.connect).result()
        if self._channel is None:
            self._channel = UdpClient(str(options.address), options.stream_port)
        handshake = Handshake(
            self._channel, self._clock, options.connect_s, f"{options.address}:{options.stream_port}"
        )
        found = handshake.capability()
        self._version = found.version
        if round(self._period_s * 1e3, 6) != found.period_ms:
            raise BackendError(
                f"the controller sends every {found.period_ms} ms, but rt.period_s is "
                f"{self._period_s:g} s: set it to {found.period_ms * 1e-3:g}"
            )
        if options.limits == "table":
            self._table = handshake.limits(found.version, self._limits.dof)
        if self._points.names:
            self._points.begin(self._worker.begin(self._read_outputs).result())
            handshake.configure(found.version, self._points.blocks)
        self._start()
        self._meet()
        if self._table is not None:
            self._check_limits(self._table, self._tool)

    def enable(self) -> None:
        """Enable the drives. The controller may start before or after cobot. If the robot accepts no commands
        at the start, the first command reports the reason, and a reset tries again.
        """
        starts, self._starts = self._starts, False
        while not self.recover_step():
            self._receive(self._options.silence_s)
        try:
            while not self.enable_step():
                self.wait(self._options.silence_s)
                while self._beat.due:
                    self._beat.advance()
        except BackendError as exc:
            if not starts:
                raise
            self._lost = str(exc)

    def enable_step(self) -> bool:
        if self._enabled:
            return True
        now_s = self._clock()
        try:
            if self._silence_s > self._options.silence_s:
                return self._restart(now_s)
            if self._enabling is None:
                self._begin_enabling(now_s)
            if self._enabling is None or not self._enabling.done():
                return False
            self._enabling.result()
            reason = why_not_ready(self._newest)
            if reason and now_s - self._asked_s > self._options.enable_s:
                raise BackendError(f"{reason}; this has not changed within {self._options.enable_s:g} s")
        except BackendError:
            self._enabling = None
            raise
        if reason:
            return False
        self._enabling = None
        self._enabled, self._lost = True, ""
        self._transition.forget()
        self._join_until_s = now_s + self._options.enable_s
        return True

    def recover_step(self) -> bool:
        """End the remainder of the last motion. `enable_step` then begins a new one at the arm's position."""
        if self._unended and not self._silence_s > self._options.silence_s:
            if self._answered:
                return False
            self._end_motion()
        self._unended = False
        if self._enabling is not None and self._enabling.done():
            self._enabling = None
        self._enabled, self._lost = False, ""
        self._asked_s = self._clock()
        return True

    def disable(self) -> None:
        """End the motion. The controller holds the arm."""
        with contextlib.suppress(BackendError):
            deadline_s = self._clock() + LAST_S
            while self._unended and self._answered and self._clock() < deadline_s:
                self._receive(deadline_s - self._clock())
            if self._unended and not self._answered:
                self._end_motion()
        self._enabled = self._unended = False

    def close(self) -> None:
        try:
            if self._channel is not None and self._version:
                with contextlib.suppress(BackendError):
                    self._channel.send(encode_stop(self._version))
            with contextlib.suppress(BackendError):
                self._worker.begin(self._bring_up.end).result()
        finally:
            self._worker.close()
            self._rmi.drop()
            if self._channel is not None:
                self._channel.close()

    def read(self, measured: Measured) -> None:
        if self._beat.newest is None or self._silence_s > self._options.silence_s:
            raise BackendError(self._silent())
        measured.position, measured.velocity = self._beat.position, self._beat.velocity

    def write(self, command: Array) -> None:
        packet = self._beat.newest
        if packet is None or self._beat.due or self._answered:
            self._require_motion()
            return
        self._answered = True
        if not self._enabled:
            self._require_motion()
            return
        reason = why_not_ready(packet)
        if not reason and self._transition.sent is None:
            reason = self._begin(command[0])
        if reason:
            if self._may_come_back(packet) and not command[1].any():
                self._transition.forget()
                return
            self._enabled, self._lost = False, reason
            self._ask_alarms()
            raise BackendError(f"the robot does not accept commands: {reason}")
        self._send(self._transition.follow(command[0]))
        self._unended = True
        self._transition.pass_period()

    def _require_motion(self) -> None:
        """Raise an error if the controller has ended the motion, because the arm then no longer follows
        commands. Also called in cycles without a packet.
        """
        if not self._enabled and self._lost:
            raise BackendError(f"the robot does not accept commands: {self._lost}")

    # Paced, Reporting, CarriesTool, HasIo

    def wait(self, timeout_s: float) -> bool:
        """Wait for the controller's next packet. Return at once if a cycle is still due for a packet that was
        lost or has accumulated.
        """
        deadline_s = self._clock() + timeout_s
        while not self._beat.due:
            self._receive(deadline_s - self._clock())
            if not self._beat.due and self._clock() >= deadline_s:
                return False
        self._beat.advance()
        return True

    def status(self) -> DeviceStatus:
        packet = self._beat.newest
        self._ask_report()
        if packet is None:
            return DeviceStatus(connection="no packet yet", text=self._silent())
        silent = self._silence_s > self._options.silence_s
        pendant = bool(packet.robot_status & RobotFlag.PENDANT)
        scale = packet.safety_scale
        return DeviceStatus(
            connection="SILENT" if silent else "COMMANDING" if self._enabled else "MONITORING",
            operation_mode="T1" if pendant else "AUT",
            safety_stop=safety_stop(packet),
            drives=self._report.drives,
            speed_scaling=min(max(scale, 0.0), 1.0) if math.isfinite(scale) else 1.0,
            packets_lost=self._beat.lost,
            device_time_s=packet.time_ms * 1e-3,
            text="; ".join(filter(None, self._texts(packet, silent))),
        )

    def set_tool(self, tool: Tool) -> None:
        """Check the controller's limits with this load. The payload itself must be set on the controller."""
        if self._table is not None:
            self._check_limits(self._table, tool)
        self._tool = tool

    def io(self) -> list[IoPoint]:
        packet = self._beat.newest
        return self._points.reported(packet.io if packet is not None else b"")

    def set_output(self, name: str, value: float) -> None:
        if name in self._points.outputs and not self._enabled:
            reason = self._lost or "the arm is not enabled"
            raise BackendError(f"{name} cannot be set: {reason}")
        self._points.set(name, value)

    @staticmethod
    def contract_rig(settings: Settings, limits: JointLimits) -> ContractRig:
        """Create a rig with the backend and a simulated controller in one process."""
        from rtloop.backends.fanuc.simulator.lockstep import FanucRig

        return FanucRig(settings, limits)

    # Private methods

    def _start(self) -> None:
        """Ask the controller to send its state. The numbers of its packets then begin at 1 again."""
        self._started_s = self._asked_s = self._clock()
        self._open_channel.send(encode_start(self._version))

    def _restart(self, now_s: float) -> bool:
        """Execute one step of enabling a controller that sends no packets."""
        if now_s - self._asked_s > self._options.connect_s:
            raise BackendError(self._silent())
        if now_s - self._started_s > START_S:
            self._started_s = now_s
            self._open_channel.send(encode_start(self._version))
        return False

    def _meet(self) -> None:
        """Wait for the first packet, and find the conversion between its axes and the model's joints."""
        while not self.wait(START_S):
            if self._clock() - self._asked_s > self._options.connect_s:
                raise BackendError(self._silent())
            self._open_channel.send(encode_start(self._version))
        robot = self._robot
        model = RobotModel.load(robot.model, self._limits, base=robot.base_frame, tcp=robot.tcp)
        axes = self._worker.begin(self._rmi_joints).result()
        self._units = ArmAgreement(self._options, self._limits, model).units(self._newest, axes)
        self._beat = Beat[StatusPacket](self._limits.dof, self._period_s)
        if not self.wait(self._options.connect_s):
            raise BackendError(self._silent())

    def _rmi_joints(self) -> tuple[float, ...] | None:
        try:
            return self._rmi.joints()
        except BackendError:
            self._rmi.connect()
            return None

    def _read_outputs(self) -> dict[str, int]:
        return {name: self._bring_up.output(name) for name in self._points.outputs}

    def _begin_enabling(self, now_s: float) -> None:
        packet = self._newest
        stop = safety_stop(packet)
        if stop or packet.robot_status & RobotFlag.PENDANT:
            raise BackendError(stop or why_not_ready(packet))
        self._asked_s = now_s
        self._enabling = self._worker.begin(self._bring_up.begin)

    def _begin(self, command: Array) -> str:
        """Begin to send commands, from the position where the arm is. Return the reason if the first command
        is too far away from this position; otherwise "".
        """
        here = self._units.to_model(self._newest.joints)
        off = np.abs(here - command)
        joint = int(off.argmax())
        if not off[joint] <= self._options.entry_rad:
            return (
                f"the first command of {self._limits.names[joint]} is {off[joint]:.4f} "
                f"{self._limits.unit(joint)} from its position, allowed: {self._options.entry_rad} "
                "(robot.backend.entry_rad)"
            )
        self._transition.begin(here, command)
        return ""

    def _send(self, position: Array, *, is_last: bool = False) -> None:
        packet = CommandPacket(
            self._version,
            self._newest.sequence,
            self._units.to_device(position),
            is_last=is_last,
            io=self._points.data,
        )
        self._open_channel.send(encode_command(packet))

    def _end_motion(self) -> None:
        """Answer the newest packet with the last command of the motion: the current command or, if the arm no
        longer follows commands, its position.
        """
        sent = self._transition.sent
        follows = self._enabled and sent is not None
        self._answered, self._enabled, self._unended = True, False, False
        here = sent if follows and sent is not None else self._units.to_model(self._newest.joints)
        self._send(here, is_last=True)

    def _check_limits(self, table: LimitsTable, tool: Tool) -> None:
        rated_kg = self._options.rated_payload_kg
        load = tool.mass / rated_kg if rated_kg is not None else None
        require_accepted(table.check(self._limits, self._units, load))

    def _may_come_back(self, packet: StatusPacket) -> bool:
        """Whether the program may end and start again without a fault. This is allowed shortly after
        enabling, which restarts the program, as long as the arm does not move.
        """
        stopped = safety_stop(packet) or packet.robot_status & (RobotFlag.PENDANT | RobotFlag.ERROR)
        return self._clock() < self._join_until_s and not stopped

    def _receive(self, timeout_s: float) -> None:
        for data in self._open_channel.receive(timeout_s):
            packet = decode_received(data)
            if isinstance(packet, StatusPacket):
                self._take(packet)
            elif isinstance(packet, str):
                self._refused, self._refused_s = packet, self._clock()

    def _take(self, packet: StatusPacket) -> None:
        if packet.version != self._version:
            self._refused = (
                f"the status packet has version {packet.version}, but the session has version "
                f"{self._version}: was the controller updated or replaced?"
            )
            self._refused_s = self._clock()
        elif self._beat.take(packet, packet.sequence, self._units.to_model(packet.joints)):
            self._answered, self._heard_s = False, self._clock()
        else:
            self._late += 1

    def _ask_report(self) -> None:
        """Poll the Remote Motion Interface once a second."""
        if self._poll is not None and self._poll.done():
            self._report, self._poll = self._poll.result(), None
        if self._poll is None and self._enabling is None and self._clock() - self._polled_s > POLL_S:
            self._ask_alarms()

    def _ask_alarms(self) -> None:
        self._polled_s = self._clock()
        if self._poll is None:
            self._poll = self._worker.begin(self._bring_up.report)

    def _texts(self, packet: StatusPacket, silent: bool) -> list[str]:
        reason = self._silent() if silent else why_not_ready(packet)
        late = f"{self._late} packets arrived twice or too late" if self._late else ""
        version = f"Stream Motion {self._version}, RMI {self._rmi.version}".removesuffix(", RMI ")
        return [reason or version, self._report.text, late]

    def _silent(self) -> str:
        begin = f"no packet from the controller for {self._silence_s:.2f} s"
        if self._beat.newest is None:
            begin = "the controller does not send its state"
        if self._refused_s > self._heard_s:
            return f"{begin}; the last one was rejected: {self._refused}"
        return f"{begin}: it is off, the network is down, or another client has ended the stream"

    @property
    def _silence_s(self) -> float:
        return self._clock() - self._heard_s

    @property
    def _newest(self) -> StatusPacket:
        if self._beat.newest is None:
            raise BackendError(self._silent())
        return self._beat.newest

    @property
    def _open_channel(self) -> StreamChannel:
        if self._channel is None:
            raise BackendError("the connection is not open")
        return self._channel
