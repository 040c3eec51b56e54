"""The controller's side of FRI, with five session states, the connection quality, reflexes and one packet per
period.

The simulated controller counts periods instead of using a clock: tests step it, and a server runs it in real
time. docs/kuka-fri.md describes the behaviour for which KUKA publishes no figures.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from cobot.errors import LimitError
from cobot.robot.io_points import require_number
from cobot.types import Array
from rtloop.backends.beat import ahead
from rtloop.backends.fri.codec import decode_command
from rtloop.backends.fri.encoding import encode_monitoring
from rtloop.backends.fri.messages import (
    FRAMED_VERSION,
    MONITORING_ID,
    CommandMessage,
    CommandMode,
    ControlMode,
    DriveState,
    FriHeader,
    IoDirection,
    IoValue,
    MonitoringMessage,
    OperationMode,
    OverlayType,
    Quality,
    SafetyState,
    SessionState,
)
from rtloop.backends.fri.outputs import point_of
from rtloop.backends.fri.simulator.connection import ClientConnection
from rtloop.backends.fri.simulator.options import CabinetOptions
from rtloop.backends.fri.simulator.reflexes import check_echo, check_overlay, usable
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.reflexes import check_command
from rtloop.results import ACCEPTED, Accepted, Rejected

COUNTER = 1 << 32
STAGE_PERIODS = 10
"""Minimum number of periods for which a session stays in one state."""
REOPEN_MS = 500
"""Time after which the cabinet's program opens a new session, ms."""
BRAKE_RAD_S2 = 10.0
DRIVES_MS = 50
"""Time until the drives are on, ms."""
TRACKING_RAD = 0.1
"""Distance of the arm from its target at which the tracking performance is 0, rad."""
EVENTS = 200


class Cabinet:
    """The simulated cabinet.

    Attributes:
        arm: the simulated arm.
        options: cabinet options.
        connection: quality of the connection to its client.
        state, safety, mode: states of the session, the safety controller and the operator's key switch.
        events: event descriptions, newest last.
        motions: number of motions so far in which the overlay became active.
        below_good: number of times that the quality of a session has fallen below GOOD.
        io: inputs and outputs by name.
    """

    def __init__(self, arm: ControllerArm, options: CabinetOptions) -> None:
        self.arm, self.options = arm, options
        self.connection = ClientConnection(options.period_ms, options.multiplier)
        self.period_s = options.period_ms * 1e-3
        self.state = SessionState.IDLE
        self.safety = SafetyState.NORMAL_OPERATION
        self.mode = options.operation_mode
        self.io: dict[str, IoValue] = {each.name: each for each in options.io}
        self.events: deque[str] = deque(maxlen=EVENTS)
        self.motions = self.below_good = 0
        self.malformed = 0
        self._sequence = -1
        self._periods = 0  # number of periods in this state
        self._drives = DriveState.ACTIVE
        self._drives_left = 0
        self._open_after = 1
        self._velocity = np.zeros(arm.limits.dof)
        self._nominal = arm.setpoint  # position of the running motion, to which the overlay is added
        self._end(0)

    @property
    def quality(self) -> Quality:
        return self.connection.quality

    @property
    def _frames(self) -> bool:
        """Whether messages have the frame of FRI 2.7."""
        return self.options.version == FRAMED_VERSION

    @property
    def sequence(self) -> int:
        return self._sequence

    @property
    def waits_for_answer(self) -> bool:
        """Whether the cabinet's last message still needs an answer."""
        due = ahead(self._sequence, self.connection.reflected) >= self.options.multiplier
        return self.state != SessionState.IDLE and due

    def packet(self) -> bytes:
        """End a period and begin the next one. Return the monitoring message of the new period; b"" while no
        session is open.
        """
        opened = self.state
        if self.state != SessionState.IDLE:
            self.connection.judge(self._sequence)
        self._periods += 1
        self._switch_drives()
        self._advance_session()
        self._move()
        self._sequence = (self._sequence + 1) % COUNTER
        if self.state == opened == SessionState.IDLE:
            return b""
        return encode_monitoring(self._message())

    def answer(self, packet: bytes) -> None:
        """Process a packet from a client, valid or not."""
        if self.state == SessionState.IDLE:
            return
        command = decode_command(packet)
        if not isinstance(command, str) and command.framed != self._frames:
            command = (
                f"a command {'with' if command.framed else 'without'} the frame of FRI "
                f"{FRAMED_VERSION}, but this cabinet uses FRI {self.options.version}"
            )
        if isinstance(command, str):
            self.malformed += 1
            self.events.append(command)
            return
        before = self.connection.reflected
        if not self.connection.take_answer(command.header.sequence, command.header.reflected, self._sequence):
            return
        self._write_io(command)
        if self.state in (SessionState.COMMANDING_WAIT, SessionState.COMMANDING_ACTIVE):
            self._take(command, ahead(command.header.reflected, before))

    def stop_safely(self, level: int) -> None:
        """Trigger a safety stop of level 0, 1 or 2; -1 ends the stop."""
        if self.safety != level + 1:
            self.safety = SafetyState(level + 1)
            self.events.append(f"safety: {self.safety.name}")

    def switch_mode(self, mode: OperationMode) -> None:
        """Turn the operator's key switch, which ends the running motion."""
        if mode == self.mode:
            return
        self.mode = mode
        self.events.append(f"operation mode: {mode.name}")
        if self.state in (SessionState.COMMANDING_WAIT, SessionState.COMMANDING_ACTIVE):
            self._end_motion(f"the operation mode was changed to {mode.name}")

    def close_session(self, reason: str) -> None:
        """Make the cabinet's program end the session, and open the next one after `REOPEN_MS`."""
        self._enter(SessionState.IDLE, reason)
        self._end(REOPEN_MS // self.options.period_ms)

    def _end(self, open_after: int) -> None:
        """End the motion and the commands."""
        self._open_after = open_after
        self._commanded: Array | None = None
        self._echoed = 0
        self._left = 0

    def _enter(self, state: SessionState, reason: str) -> None:
        self.events.append(f"{self.state.name} -> {state.name}{': ' if reason else ''}{reason}")
        self.state, self._periods = state, 0

    def _end_motion(self, reason: str) -> None:
        self._end(0)
        good = self.quality >= Quality.GOOD
        self._enter(SessionState.MONITORING_READY if good else SessionState.MONITORING_WAIT, reason)

    def _switch_drives(self) -> None:
        if self.safety != SafetyState.NORMAL_OPERATION:
            self._drives, self._drives_left = DriveState.OFF, DRIVES_MS // self.options.period_ms
        elif self._drives_left > 0:
            self._drives_left -= 1
            self._drives = DriveState.TRANSITIONING
        else:
            self._drives = DriveState.ACTIVE

    def _advance_session(self) -> None:
        """Change to the next state of the session."""
        state, good = self.state, self.quality >= Quality.GOOD
        if state == SessionState.IDLE:
            if self._periods >= self._open_after:
                self.connection.forget(self._sequence + 1)
                self._enter(SessionState.MONITORING_WAIT, "its program has opened a session")
            return
        if self.connection.lost:
            self.close_session(f"no answer to {self.connection.silent} messages")
        elif state >= SessionState.COMMANDING_WAIT and self.safety != SafetyState.NORMAL_OPERATION:
            self._end_motion(f"safety: {self.safety.name}")
        elif state >= SessionState.COMMANDING_WAIT and not good:
            self.below_good += 1
            self._end_motion(f"the quality of the connection is {self.quality.name}")
        elif state == SessionState.MONITORING_WAIT and good:
            self._enter(SessionState.MONITORING_READY, "")
        elif state == SessionState.MONITORING_READY and not good:
            self.below_good += 1
            self._enter(SessionState.MONITORING_WAIT, f"the quality is {self.quality.name}")
        elif state == SessionState.MONITORING_READY and self._may_move():
            self._nominal = self.arm.setpoint.copy()
            self._enter(SessionState.COMMANDING_WAIT, "")
        elif state == SessionState.COMMANDING_WAIT and self._echoed >= STAGE_PERIODS:
            self.motions += 1
            self._enter(SessionState.COMMANDING_ACTIVE, "")

    def _may_move(self) -> bool:
        ready = self._drives == DriveState.ACTIVE and not self._velocity.any()
        return ready and self._periods >= STAGE_PERIODS

    def _take(self, command: CommandMessage, elapsed: int) -> None:
        """Process a command for a motion that is waiting or running. `elapsed` is the number of periods since
        the last command.
        """
        if not usable(command, self.options.command_mode, self.arm.limits.dof):
            return
        position = np.array(command.position)
        if self.state == SessionState.COMMANDING_WAIT:
            result = check_echo(self.arm, position)
            self._echoed += 1
        else:
            result = self._follow(position, max(elapsed, 1))
        if result is ACCEPTED:
            result = check_overlay(command, self.options.command_mode)
        if isinstance(result, Rejected):
            self._end_motion(result.reason)
            return
        self._commanded = position
        if self.options.command_mode == CommandMode.TORQUE:
            effort = self.arm.limits.max_effort
            self.arm.overlay[:] = np.clip(command.torque, -effort, effort)
        elif self.options.command_mode == CommandMode.WRENCH:
            self.arm.overlay[:] = self.arm.torque_of(np.array(command.wrench))

    def _follow(self, position: Array, elapsed: int) -> Accepted | Rejected:
        last = self._commanded if self._commanded is not None else self.arm.setpoint
        time_s = elapsed * self.period_s
        with np.errstate(invalid="ignore", over="ignore"):
            velocity = (position - last) / time_s
            result = check_command(
                self.arm, position, velocity, self._velocity, time_s, in_t1=self.mode == OperationMode.T1
            )
        if result is ACCEPTED:
            self._velocity = velocity
            self._left = self.options.multiplier
        return result

    def _move(self) -> None:
        """Move the arm to the command. Without a command, continue at constant velocity or brake."""
        if self.state == SessionState.COMMANDING_ACTIVE:
            target = self.arm.setpoint + self._velocity * self.period_s
            if self._left and self._commanded is not None:
                target = self.arm.setpoint + (self._commanded - self.arm.setpoint) / self._left
                self._left -= 1
        else:
            self.arm.overlay[:] = 0.0
            speed = np.maximum(np.abs(self._velocity) - BRAKE_RAD_S2 * self.period_s, 0.0)
            self._velocity = np.sign(self._velocity) * speed
            target = self.arm.setpoint + self._velocity * self.period_s
        target = np.clip(target, self.arm.limits.min_position, self.arm.limits.max_position)
        self.arm.advance(target, self._velocity, self.options.period_ms)

    def _write_io(self, command: CommandMessage) -> None:
        for value in command.io:
            known = self.io.get(value.name)
            if known is None or known.direction != IoDirection.OUTPUT or known.type != value.type:
                self.events.append(
                    f"{value.name!r} is not an output of this type that the program has registered"
                )
                continue
            try:
                require_number(point_of(known), value.value)
            except LimitError as exc:
                self.events.append(f"the client's output is not set: {exc}")
            else:
                known.value = value.value

    def _message(self) -> MonitoringMessage:
        arm, old = self.arm, self.options.version == "1.x"
        measured = arm.measured
        off = float(np.abs(measured.position - arm.setpoint).max())
        commanding = self.state >= SessionState.COMMANDING_WAIT
        setpoint = tuple(arm.setpoint.tolist())
        mode = self.options.command_mode
        overlay = OverlayType.CARTESIAN if mode == CommandMode.CARTESIAN_POSE else OverlayType.JOINT
        return MonitoringMessage(
            FriHeader(MONITORING_ID, self._sequence, self.connection.newest or 0),
            state=self.state,
            quality=self.quality,
            send_period_ms=self.options.period_ms,
            receive_multiplier=self.options.multiplier,
            joints=arm.limits.dof,
            safety=self.safety,
            drives=(self._drives,) * arm.limits.dof,
            operation_mode=self.mode,
            control_mode=self.options.control_mode if commanding else ControlMode.NONE,
            command_mode=mode if commanding else CommandMode.NONE,
            overlay=overlay if commanding else OverlayType.NONE,
            measured_position=tuple(measured.position.tolist()),
            commanded_position=setpoint if old else (),
            ipo_position=tuple(self._nominal.tolist()) if commanding else (),
            measured_torque=tuple(measured.effort.tolist()),
            commanded_torque=tuple(measured.desired_effort.tolist()),
            external_torque=tuple(measured.external_effort.tolist()),
            measured_pose=() if old else arm.pose(),
            tracking_performance=max(0.0, 1.0 - off / TRACKING_RAD),
            time_s=self._sequence % COUNTER * self.period_s,
            io=list(self.io.values()),
            external_force=tuple(measured.wrench.tolist()) if self._frames else (),
            framed=self._frames,
        )
