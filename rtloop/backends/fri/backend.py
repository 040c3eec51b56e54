"""Backend for KUKA's LBR iiwa and LBR Med over the Fast Robot Interface.

This module is long because it contains all methods of this device that the cycle calls.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cobot.config import Settings
from cobot.robot.device import DEFAULT_MEASURED
from cobot.robot.io_points import IoPoint
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.types import Array, JointLimits, Pose
from rtloop.backends import BackendError, Capabilities, DeviceStatus, Measured
from rtloop.backends.agreement import ReducedSpeed, check_agreement
from rtloop.backends.beat import Beat
from rtloop.backends.channel import RELEASE_S, PacketChannel
from rtloop.backends.fri.answers import Answers
from rtloop.backends.fri.channel import fri_channel
from rtloop.backends.fri.codec import decode_monitoring
from rtloop.backends.fri.messages import MonitoringMessage, OperationMode, SafetyState, SessionState
from rtloop.backends.fri.options import FriOptions
from rtloop.backends.fri.outputs import points
from rtloop.backends.fri.session import (
    STOPPED,
    check_command_mode,
    check_entry,
    check_readiness,
    check_settings,
    drives_in_words,
)
from rtloop.backends.protocols import require_accepted
from rtloop.results import ACCEPTED, Accepted, Rejected, first_rejection

if TYPE_CHECKING:
    from rtloop.contract import ContractRig


class FriBackend:
    """An externally clocked `Backend` for the robot controller. It also implements `Paced`, `Reporting` and
    `Stepwise`.

    The session's state determines the answer to each packet. The answer contains no command while the session
    is only monitored, the interpolator's position while a motion is waiting to begin, and a command while the
    motion is running and the connection is good.
    """

    Options = FriOptions
    capabilities = Capabilities(
        periods_s=(0.001, 0.002, 0.004, 0.005, 0.01),
        measured=DEFAULT_MEASURED - {"wrench"},
        torque=True,
        wrench=True,
        io=True,
        stops={2: False},  # the cabinet switches the drives
        hardware=True,
    )

    def __init__(
        self,
        settings: Settings,
        limits: JointLimits,
        *,
        channel: PacketChannel | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the backend. `channel` and `clock` replace the network and its clock in tests."""
        options = settings.backend_options(FriOptions)
        self._options = options = options if options is not None else FriOptions()
        self._limits, self._period_s = limits, settings.rt.period_s
        self._robot = settings.robot
        self._reduced = ReducedSpeed()
        self.capabilities = replace(
            type(self).capabilities, torque=options.overlay == "torque", wrench=options.overlay == "wrench"
        )
        self._channel, self._clock = channel, clock
        self._beat = Beat[MonitoringMessage](limits.dof, self._period_s)
        self._answers = Answers(options, limits.names, self._period_s)
        self._heard_s = self._asked_s = self._refused_s = 0.0
        self._join_until_s = 0.0  # time after enabling in which the session may restart without a fault
        self._enabled = self._asking = self._joins = False
        self._answered = True  # the newest packet, which is answered once
        self._starts = True
        self._refused = ""
        self._malformed = 0
        # Why the last motion ended. If it was rejected, the arm does not move until a reset.
        self._last_motion: Accepted | Rejected = ACCEPTED

    def open(self, initial_position: Array) -> None:
        options, robot = self._options, self._robot
        if self._channel is None:
            self._channel = fri_channel(options.listen, options.port, options.address)
        model = RobotModel.load(robot.model, self._limits, base=robot.base_frame, tcp=robot.tcp)
        self._reduced.set_model(model)
        self._asked_s = self._clock()
        while not self.wait(options.silence_s):
            if self._clock() - self._asked_s > options.connect_s:
                raise BackendError(self._no_packet())
        require_accepted(check_settings(self._newest, options, self._period_s))
        pose = self._newest.measured_pose
        told = len(pose) == 7 and bool(np.isfinite(pose).all()) and any(pose[3:])
        if told and options.check_pose:
            flange = Pose(1e-3 * np.array(pose[:3]), np.array(pose[3:]))
            require_accepted(check_agreement(model, np.array(self._newest.measured_position), flange))

    def set_tool(self, tool: Tool) -> None:
        """Set the tool. It only affects the reduced speed in T1, because the load of the drives is set on the
        cabinet.
        """
        self._reduced.set_tool(tool)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the controller's next packet. If a packet was lost or several have accumulated, cycles are
        still due for them, and this method returns at once.
        """
        deadline_s = self._clock() + timeout_s
        while not self._beat.due:
            for packet in self._open_channel.receive(deadline_s - self._clock()):
                refused = self._malformed
                self._take(packet)
                if self._malformed > refused:
                    self._refused_s = self._clock()
            if not self._beat.due and self._clock() >= deadline_s:
                return False
        self._beat.advance()
        return True

    def read(self, measured: Measured) -> None:
        message = self._beat.newest
        if message is None or self._silence_s > self._options.silence_s:
            raise BackendError(
                f"no usable packet from the robot controller for {self._silence_s:.2f} s; the last one was "
                f"rejected: {self._refused}"
                if self._refuses
                else f"no packet from the robot controller for {self._silence_s:.2f} s: its session is "
                "closed, its program has ended, or the network is down"
            )
        measured.position, measured.velocity = self._beat.position, self._beat.velocity
        for name, values in (
            ("effort", message.measured_torque),
            ("desired_effort", message.commanded_torque),
            ("external_effort", message.external_torque),
        ):
            if values:
                setattr(measured, name, values)

    def write(self, command: Array) -> None:
        message = self._beat.newest
        if message is None or self._beat.due or self._answered:
            self._require_motion()
            return
        self._answered = True
        result = first_rejection(self._checks_of_a_command(message))
        if self._enabled and result is ACCEPTED and (self._joins or not self._answers.are_begun):
            result = self._answers.begin(message, command[0])
            self._joins = False
        follows = self._enabled and result is ACCEPTED
        answer = self._answers.encode(message, command[0] if follows else None)
        if answer:
            self._open_channel.send(answer)
        if not self._enabled or not isinstance(result, Rejected):
            return
        if command[1].any() or not self._may_reconnect(message):
            self._last_motion = result
            self._require_motion()

    def enable(self) -> None:
        """Enable the drives. The controller may start before or after cobot. If the robot accepts no commands
        at the start, the first command reports the reason, and a reset tries again.
        """
        starts, self._starts = self._starts, False
        self.recover_step()
        nothing = np.zeros((3, self._limits.dof))
        try:
            while True:
                self.write(nothing)  # answers the current packet, because no cycle is running yet
                if self.enable_step():
                    return
                self.wait(self._options.silence_s)
        except BackendError:
            if not starts:
                raise
            self._enabled = self._joins = True

    def enable_step(self) -> bool:
        if self._enabled:
            return True
        message = self._newest
        now_s = self._clock()
        if not self._asking:
            self._asking, self._asked_s = True, now_s
        result = first_rejection(self._checks_of_enabling(message, now_s - self._asked_s))
        if isinstance(result, Rejected):
            self._asking = False
            raise BackendError(result.reason)
        if check_readiness(message) is not ACCEPTED:
            return False
        self._asking, self._enabled, self._joins = False, True, True
        self._join_until_s = now_s + self._options.enable_s
        return True

    def recover_step(self) -> bool:
        """Wait for the recovery, which the controller's own program carries out. Until it is done, the
        answers only repeat the controller's position.
        """
        self._enabled, self._last_motion = False, ACCEPTED
        return True

    def disable(self) -> None:
        """Stop sending commands. The controller's program decides what happens to its motion."""
        self._enabled = False
        self._answers.forget()

    def close(self) -> None:
        if self._channel is not None:
            self._channel.close()

    def status(self) -> DeviceStatus:
        message = self._beat.newest
        if message is None:
            return DeviceStatus(connection="no packet yet", text=self._no_packet())
        drives, brakes = drives_in_words(message.drives)
        silent = self._silence_s > self._options.silence_s
        text = f"no packet for {self._silence_s:.1f} s" if silent else self._explain_waiting(message)
        if silent and self._refuses:
            text = f"no usable packet for {self._silence_s:.1f} s; the last one was rejected: {self._refused}"
        return DeviceStatus(
            connection="SILENT" if silent else message.state.name,
            quality=message.quality.name,
            operation_mode=message.operation_mode.name if message.operation_mode is not None else "",
            safety_stop=STOPPED.get(message.safety, ""),
            drives=drives,
            brakes=brakes,
            speed_scaling=self._reduced.share if message.operation_mode == OperationMode.T1 else 1.0,
            packets_lost=self._beat.lost,
            device_time_s=message.time_s,
            text="; ".join(filter(None, (text or f"FRI {message.version}".strip(), self._strangers))),
        )

    def io(self) -> list[IoPoint]:
        return points(self._newest)

    def set_output(self, name: str, value: float) -> None:
        message = self._newest
        if message.state == SessionState.IDLE or self._silence_s > self._options.silence_s:
            reason = self._explain_waiting(message) or "the controller is silent"
            raise BackendError(f"{name} cannot be set: {reason}")
        self._answers.outputs.set(message, name, value)

    def write_torque(self, torque: Array) -> None:
        self._answers.torque[:] = torque

    def write_wrench(self, wrench: Array) -> None:
        """Set the wrench that the TCP exerts from the next `write` on. Shape: (6,), in N and N·m. Real-time
        safe.
        """
        self._answers.wrench[:] = wrench

    @staticmethod
    def contract_rig(settings: Settings, limits: JointLimits) -> ContractRig:
        """Create a rig with the backend and a simulated cabinet in one process."""
        from rtloop.backends.fri.simulator.lockstep import FriRig

        return FriRig(settings, limits)

    def _require_motion(self) -> None:
        """Raise an error if the controller's motion has ended, because the arm then does not follow commands.
        Also called in cycles without an answer.
        """
        if self._enabled and isinstance(self._last_motion, Rejected):
            raise BackendError(f"the robot accepts no commands: {self._last_motion.reason}")

    def _checks_of_a_command(self, message: MonitoringMessage) -> Iterator[Accepted | Rejected]:
        yield self._last_motion
        yield check_readiness(message)
        yield check_command_mode(message, self._options)

    def _checks_of_enabling(
        self, message: MonitoringMessage, waited_s: float
    ) -> Iterator[Accepted | Rejected]:
        """Run the checks at the end of enabling. The controller must become ready within `enable_s`."""
        yield check_settings(message, self._options, self._period_s)
        yield check_command_mode(message, self._options)
        ready = check_readiness(message)
        if not isinstance(ready, Rejected):
            yield check_entry(message, self._options, self._limits.names, self._answers.held(message))
        elif message.safety != SafetyState.NORMAL_OPERATION:
            yield ready
        elif waited_s > self._options.enable_s:
            yield Rejected(f"{ready.reason}, for {self._options.enable_s:g} s")

    @staticmethod
    def _explain_waiting(message: MonitoringMessage) -> str:
        """Return the reason why the controller accepts no commands; "" if it accepts them."""
        ready = check_readiness(message)
        return ready.reason if isinstance(ready, Rejected) else ""

    def _may_reconnect(self, message: MonitoringMessage) -> bool:
        """Whether a lost session may return without a fault. It may do so shortly after enabling, which may
        have kept this computer busy, as long as the arm does not move.
        """
        soon = self._joins and self._clock() < self._join_until_s
        return soon and message.safety == SafetyState.NORMAL_OPERATION

    def _is_other_version(self, message: MonitoringMessage) -> bool:
        """Whether the controller now frames its messages differently than before, for example after a
        restart.
        """
        before = self._beat.newest
        return before is not None and before.framed != message.framed and self._silence_s < RELEASE_S

    @property
    def _strangers(self) -> str:
        count = self._open_channel.strangers
        return f"{count} packets from addresses other than the controller's were ignored" if count else ""

    @property
    def _silence_s(self) -> float:
        return self._clock() - self._heard_s

    @property
    def _refuses(self) -> bool:
        """Whether an unusable packet has arrived since the newest usable one."""
        return self._refused_s > self._heard_s

    @property
    def _newest(self) -> MonitoringMessage:
        if self._beat.newest is None:
            raise BackendError(self._no_packet())
        return self._beat.newest

    @property
    def _open_channel(self) -> PacketChannel:
        if self._channel is None:
            raise BackendError("the connection is not open")
        return self._channel

    def _no_packet(self) -> str:
        options = self._options
        whom = f"from {options.address} " if options.address else ""
        sentence = (
            f"no packet {whom}on UDP port {options.port}: is the controller's program running, and does "
        )
        sentence += "it send to this computer?"
        return f"{sentence} The last packet was rejected: {self._refused}" if self._refused else sentence

    def _take(self, packet: bytes) -> None:
        message = decode_monitoring(packet)
        if isinstance(message, MonitoringMessage) and len(message.measured_position) != self._limits.dof:
            message = (
                f"the controller's robot has {len(message.measured_position)} joints, but the model has "
                f"{self._limits.dof}"
            )
        if isinstance(message, MonitoringMessage) and self._is_other_version(message):
            message = (
                f"a message of FRI {message.version or '1.x or 2.x'} in a session of FRI "
                f"{self._newest.version or '1.x or 2.x'}: all messages of a session have one version"
            )
        if isinstance(message, str):
            self._malformed += 1
            self._refused = message
            return
        before = self._beat.newest
        if not self._beat.take(message, message.header.sequence, message.measured_position):
            return
        self._answered, self._heard_s = False, self._clock()
        active = SessionState.COMMANDING_ACTIVE
        if before is not None and before.state == active and message.state != active:
            self._answers.forget()
