"""The controller's side of Stream Motion and of the Remote Motion Interface.

The simulated controller counts periods instead of using a clock: tests step it, and a server runs it in real
time. docs/fanuc.md describes the behaviour for which FANUC publishes no figures.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from cobot.orientations import kuka_angles
from cobot.types import Array
from rtloop.backends.fanuc.codec import (
    decode_sent,
    encode_capability,
    encode_io_result,
    encode_limits,
    encode_status,
)
from rtloop.backends.fanuc.joints import JointUnits
from rtloop.backends.fanuc.messages import (
    JOINT_STYLE,
    MIN_VERSION,
    CapabilityPacket,
    CommandPacket,
    ContactStop,
    IoBlockKind,
    IoConfigRequest,
    IoConfigResult,
    LimitRate,
    LimitsPacket,
    LimitsRequest,
    MotionFlag,
    RobotFlag,
    StartPacket,
    StatusPacket,
    StopPacket,
)
from rtloop.backends.fanuc.points import PointLayout, layout_of
from rtloop.backends.fanuc.simulator.options import FanucControllerOptions
from rtloop.backends.fanuc.simulator.reflexes import Reflexes, table_of
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.results import Rejected

MAX_SPEED = 2000
"""TCP speed that the last column of the limits table applies to, mm/s."""
MISSED_MS = 100
"""Time without a command after which a motion ends, ms. Measured values on a CRX are 71 to 121 ms."""
BRAKE_RAD_S2 = 10.0
START_MS = 40
"""Time from the call of the program until the program permits motion, ms."""
EVENTS = 200
MAX_QUEUED = 10
"""Maximum number of commands that wait for their period, because a client may send them early."""
STOPPED = (ContactStop.STOP, ContactStop.ESCAPE)
NOT_CONFIGURED, TOO_MANY = 2, 3
E_STOP = "SRVO-001 Operator panel E-stop"
FENCE = "SRVO-004 Fence open"
PENDANT = "SRVO-233 TP OFF in T1, T2"
CONTACT = "SRVO-050 Collision Detect alarm (G:1, A:1)"


class FanucController:
    """
    Attributes:
        arm: the simulated arm.
        period_s, time_ms: the controller's own period and clock.
        alarms: active alarms, newest first.
        causes: alarms whose cause persists, so that a reset does not clear them.
        io: values of the inputs and outputs.
        events: log of what has happened.
        override: speed override, per cent.
        program: whether the program of Stream Motion is running.
        contact_stop: contact stop of a collaborative robot.
        safety_scale: share of the speed that the speed clamp permits.
    """

    def __init__(self, arm: ControllerArm, options: FanucControllerOptions) -> None:
        self.arm, self.options = arm, options
        self.period_s = options.period_ms * 1e-3
        self.units = JointUnits(arm.limits, options.horizon)
        self.table = table_of(arm.limits, self.units.per_unit, options.table_share, MAX_SPEED)
        self._reflexes = Reflexes(arm.limits, self.table, self.units, options.payload_share)
        self.time_ms = self.sequence = self.moves = self.commands = self.missing = 0
        self.malformed = self.lost = 0
        self.mode = options.mode
        self.alarms: list[str] = []
        self.causes: set[str] = set()
        self.io = dict(options.io)
        self.events: deque[str] = deque(maxlen=EVENTS)
        self.override = 100
        self.contact_stop = ContactStop.NONE
        self.safety_scale = 1.0
        self.program = False
        self.version = MIN_VERSION
        self.streams = False
        self._program_ms = 0
        self._state: PointLayout = layout_of((), IoBlockKind.STATE)
        self._outputs: PointLayout = layout_of((), IoBlockKind.COMMAND)
        self._targets: deque[tuple[Array, bool]] = deque(maxlen=MAX_QUEUED)
        self._commanding = self._received = self._last = False
        self._answered = 0
        self._silent_ms = 0
        self._velocity = np.zeros(arm.limits.dof)
        # The last positions of the arm. The oldest one is reported.
        periods = 1 + options.lag_ms // options.period_ms
        self._late = deque([arm.measured.position.copy()] * periods, maxlen=periods)

    # Actions of a person

    def press(self, alarm: str) -> None:
        """Raise an alarm whose cause persists until `release`."""
        self.causes.add(alarm)
        self.alarm(alarm)

    def release(self, alarm: str) -> None:
        self.causes.discard(alarm)

    def switch_mode(self, mode: str) -> None:
        """Turn the mode switch. In T1 and T2 the teach pendant is on, and the program ends."""
        if mode == self.mode:
            return
        self.mode = mode
        self._note(f"the mode is {mode}")
        if mode != "AUTO":
            self._end("the mode is changed")

    def alarm(self, text: str) -> None:
        """Raise an alarm: the arm stops, the drives are switched off and the program ends."""
        if text not in self.alarms:
            self.alarms.insert(0, text)
        self._end(text)

    def contact(self, state: ContactStop) -> None:
        """Begin or end a contact of a collaborative robot."""
        self.contact_stop = state
        if state in STOPPED:
            self._end(f"contact stop {state.name}")

    # Actions of the Remote Motion Interface

    @property
    def servo_ready(self) -> bool:
        return not self.alarms

    def reset(self) -> None:
        """Clear the alarms whose cause no longer exists."""
        self.alarms = [text for text in self.alarms if text in self.causes]
        if self.contact_stop in STOPPED:
            self.contact_stop = ContactStop.SAFE

    def call(self) -> None:
        """Run the program of Stream Motion."""
        if not self.servo_ready or self.mode != "AUTO":
            self._note("the program cannot run")
            return
        self._end("it is started again")
        self.program, self._program_ms = True, 0

    def abort(self) -> None:
        self._end("it is aborted")

    # Stream Motion

    def hear(self, data: bytes) -> bytes:
        """Process a packet from the client. Return the reply; b"" if the packet requires no reply."""
        packet = decode_sent(data)
        if isinstance(packet, str):
            self.malformed += 1
            self._note(f"the client sends {packet}")
            return b""
        if isinstance(packet, CommandPacket):
            self._command(packet)
        elif isinstance(packet, StartPacket):
            self._start(packet.version)
        elif isinstance(packet, StopPacket):
            if self._commanding and not self._last:
                self.alarm("MOTN-900 the stream was stopped in a motion")
            self.streams = False
        elif isinstance(packet, CapabilityPacket):
            return encode_capability(CapabilityPacket(self.options.version, self.options.period_ms))
        elif isinstance(packet, LimitsRequest):
            return encode_limits(self._limits(packet))
        elif isinstance(packet, IoConfigRequest):
            return encode_io_result(self._configure(packet))
        return b""

    def step(self) -> bytes:
        """Begin a period and move the arm. Return the status packet for the client; b"" if the client has not
        requested the state.
        """
        self.time_ms += self.options.period_ms
        self._move()
        self._program_ms += self.options.period_ms
        if not self.streams:
            return b""
        self.sequence = (self.sequence + 1) % (1 << 32)
        return encode_status(self.status())

    def status(self) -> StatusPacket:
        flags = 0
        if self.motion_possible:
            flags |= MotionFlag.POSSIBLE | MotionFlag.SYSTEM_READY
        if self._received:
            flags |= MotionFlag.COMMAND_RECEIVED
        if np.abs(self._velocity).max() > 1e-3:
            flags |= MotionFlag.IN_PROGRESS
        robot = (RobotFlag.ERROR if self.alarms else 0) | (RobotFlag.PENDANT if self.mode != "AUTO" else 0)
        if E_STOP in self.causes:
            robot |= RobotFlag.EMERGENCY_STOP
        return StatusPacket(
            self.version,
            self.sequence,
            flags,
            robot,
            self.contact_stop,
            self.time_ms,
            self.face_plate(),
            self.units.to_device(self._late[0]),
            safety_scale=self.safety_scale,
            io=self._io_bytes(),
        )

    @property
    def is_commanded(self) -> bool:
        """Whether the client must answer each state packet with a command."""
        return self._commanding

    @property
    def peaks(self) -> dict[str, list[float]]:
        """Return the largest velocity, acceleration and jerk that were commanded for each joint, as shares of
        the joint's limits.
        """
        return {
            rate.name.lower(): row.tolist() for rate, row in zip(LimitRate, self._reflexes.peaks, strict=True)
        }

    @property
    def motion_possible(self) -> bool:
        started = self.program and self._program_ms >= START_MS and self.contact_stop not in STOPPED
        return started and self.streams and self.servo_ready and self.mode == "AUTO"

    def face_plate(self) -> tuple[float, ...]:
        """Return the pose of the face plate in the world frame: x, y, z in mm and w, p, r in degrees."""
        x, y, z, *turn = self.arm.pose()
        r, p, w = kuka_angles(turn)
        return (x, y, z - 1e3 * self.options.world_z_m, *map(math.degrees, (w, p, r)))

    def _start(self, version: int) -> None:
        if version != self.options.version:
            self.alarm("HOST-380 System error 0x30,0x0")
            return
        self.version, self.streams, self.sequence = version, True, 0
        self._answered = 0

    def _command(self, packet: CommandPacket) -> None:
        if packet.version != self.version:
            self.alarm("HOST-380 System error 0x19,0x0")
            return
        for name in self._outputs.places:
            self.io[name] = self._outputs.read(packet.io, name)
        if not (packet.moves and self.motion_possible):
            self._note_once("a command has arrived while no program accepts commands")
            return
        if packet.style != JOINT_STYLE:
            self.alarm(f"MOTN-625 the data style is {packet.style}; for joints it must be {JOINT_STYLE}")
            return
        if packet.sequence <= self._answered:
            self._note(f"command {packet.sequence} comes after command {self._answered}")
            return
        if not self._commanding:
            self._reflexes.forget()
            self._commanding = True
            self.moves += 1
            self._note("commands begin")
        position = self.units.to_model(packet.position)
        here = self._targets[-1][0] if self._targets else self.arm.setpoint
        speed = self.arm.speed_at((position - here) / self.period_s)
        result = self._reflexes.check(packet.sequence, position, here, speed, self.period_s)
        if isinstance(result, Rejected):
            self.alarm(f"MOTN-901 ST: {result.reason}")
            return
        self.commands += 1
        self._answered = packet.sequence
        self._targets.append((position, packet.is_last))
        self._last, self._received = packet.is_last, True

    def _move(self) -> None:
        """Move the arm for one period. The arm moves to the next command. If there is none, it continues at
        constant velocity, or decelerates after the commands have ended.
        """
        arm = self.arm
        target, is_last = self._targets.popleft() if self._targets else (None, False)
        if target is not None:
            self._velocity = (target - arm.setpoint) / self.period_s
            self._silent_ms = 0
            if is_last:
                self._end("the client has sent its last command")
        elif self._commanding:
            self.missing += 1
            self._silent_ms += self.options.period_ms
            if self._silent_ms >= MISSED_MS:
                self._end(f"no command for {self._silent_ms} ms")
        if target is None:
            if not self._commanding:
                change = BRAKE_RAD_S2 * self.period_s
                self._velocity = np.sign(self._velocity) * np.maximum(np.abs(self._velocity) - change, 0.0)
            target = arm.setpoint + self._velocity * self.period_s
        limits = arm.limits
        target = np.clip(target, limits.min_position, limits.max_position)
        arm.advance(target, self._velocity, self.options.period_ms)
        self._late.append(arm.measured.position.copy())

    def _end(self, why: str) -> None:
        if self.program or self._commanding:
            self._note(f"the program ends: {why}")
        self.program = self._commanding = self._received = self._last = False
        self._silent_ms = 0
        self._targets.clear()

    def _limits(self, request: LimitsRequest) -> LimitsPacket:
        rate, joint = request.rate, request.axis - 1
        if joint < self.arm.limits.dof:
            rows = (tuple(each[rate, joint].tolist()) for each in (self.table.unloaded, self.table.loaded))
            unloaded, loaded = rows
        else:
            unloaded = loaded = (0.0,) * self.table.loaded.shape[2]
        version, interval_ms = self.options.version, self.options.period_ms
        return LimitsPacket(version, request.axis, LimitRate(rate), MAX_SPEED, interval_ms, unloaded, loaded)

    def _configure(self, request: IoConfigRequest) -> IoConfigResult:
        names = [
            f"{block.type.name}[{block.start + index}]"
            for block in request.blocks
            for index in range(min(block.length, 1 << 11))
        ]
        if len(names) > 32 * self.options.period_ms:
            return IoConfigResult(TOO_MANY, len(names))
        if any(name not in self.io for name in names):
            return IoConfigResult(NOT_CONFIGURED, len(names))
        self._state = layout_of(request.blocks, IoBlockKind.STATE)
        self._outputs = layout_of(request.blocks, IoBlockKind.COMMAND)
        return IoConfigResult(0, len(names))

    def _io_bytes(self) -> bytes:
        data = bytearray(self._state.size)
        for name in self._state.places:
            self._state.write(data, name, self.io[name])
        return bytes(data)

    def _note(self, text: str) -> None:
        self.events.append(f"{1e-3 * self.time_ms:.3f} s: {text}")

    def _note_once(self, text: str) -> None:
        if not (self.events and self.events[-1].endswith(text)):
            self._note(text)
