"""What the arm shall do in this cycle: modes, motion on a path, stops, commands.

A long module, because the modes are one state: its parts that have a state of their own (commands, path,
path clock, safety) have a module of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

import numpy as np

from cobot.config import Settings
from cobot.ipc.layout import Ack, Command, Intervention, MotionResult
from cobot.ipc.shm import RobotMemory, text
from cobot.robot.model import RobotModel
from cobot.types import Array, LoopMode
from rtloop.backends import Backend, BackendError, Measured
from rtloop.inboxes.commands import CommandInbox
from rtloop.modes import STREAMING, TRANSITIONS
from rtloop.planned.loading import RefusedError, load
from rtloop.planned.path import Path
from rtloop.planned.path_clock import PathClock
from rtloop.safety.limiter import Safety
from rtloop.streaming.session import Streaming

START_TOLERANCE_RAD = 1e-3
"""How far a motion may start from the commanded position: planning rounds, the safety layer smooths."""
SETTLE_LIMIT_S = 2.0
"""Robot time after the end of a motion within which the arm has to settle."""
JUMP_FACTOR = 3.0
"""Times all joints' largest velocities: nothing makes an arm that fast, so it was misread."""


class Controller:
    """The `update` of the cycle. Real-time safe, but for a RESET, which waits for the drives.

    Attributes:
        mode, reason: the mode, and why it is ESTOP or FAULT, or why the last stop was made.
        motion_id, motion_result: the running motion or the last one.
        settled: at rest, as measured: at the commanded position, or anywhere in FAULT and in a session.
        stale: whether what is measured has stopped changing although the arm is moved; the loop sets it.
        deceleration_ns: when the last stop began to slow the arm down, set from the cycle's `now_ns`.
    """

    def __init__(self, settings: Settings, model: RobotModel, memory: RobotMemory, backend: Backend) -> None:
        self._rt = rt = settings.rt
        self._limits = limits = model.limits
        self._slots = memory.slots
        self._backend = backend
        self.commands = CommandInbox(memory)
        self.safety = Safety(limits, rt.period_s)
        self.streaming = Streaming(settings.streaming, model, memory, backend, self.safety, rt.period_s)
        self.path = Path(rt.trajectory_capacity, limits.dof)
        self.clock = PathClock(limits, rt.period_s)
        self.mode = LoopMode.HOLD
        self.reason = ""
        self.motion_id = 0
        self.motion_result = MotionResult.NONE
        self.slot = 0
        self.settled = False
        self.stale = False
        self.deceleration_ns = 0
        self._desired = np.zeros((3, limits.dof))  # rad, rad/s, rad/s²
        self._error = np.zeros(limits.dof)  # measured against commanded, rad
        self._off = 0.0  # its length
        self._largest_step = JUMP_FACTOR * rt.period_s * float(np.linalg.norm(limits.max_velocity))
        self._misread = False  # since the last reset
        self._yield_rad = settings.streaming.yield_rad
        self._following = False  # the desired position comes from the path
        self._braking = False  # the desired position comes from the safety layer, which stops
        self._waiting = False  # in a streaming session, for the next target
        self._left_path = False
        self._slowing_unseen = False
        self._still_cycles = 0
        self._unsettled_cycles = 0
        self._loader: Iterator[None] | None = None
        self._loading = 0  # number of the START command
        self._loading_motion = 0

    def start_at(self, position: Array) -> None:
        """Hold a position where the arm is at rest."""
        self._desired[:] = 0.0
        self._desired[0] = position
        self.safety.reset(position)
        self._following = self._braking = self._misread = False
        self._off = 0.0

    def let_go(self, position: Array) -> None:
        """The robot has not taken commands for some time, so its drives have stopped by themselves.

        When it takes them again, it shall find that it is wanted where it is.
        """
        if self.streaming.session:
            self.streaming.close()
        self.start_at(position)

    def restore(self, state: np.ndarray) -> None:
        """Take over what a dead rtloop has left: latches stay, an interrupted motion has failed."""
        self.commands.refuse_pending("rtloop was restarted")
        self.motion_id = int(state["motion_id"])
        self.motion_result = MotionResult(int(state["motion_result"]))
        self.safety.interventions[:] = state["interventions"]
        self.safety.intervened_ns[:] = state["intervened_ns"]
        mode = LoopMode(int(state["mode"]))
        if mode in (LoopMode.ESTOP, LoopMode.FAULT):
            self.mode = mode
            self.reason = text(state["reason"])
        elif self.motion_result is MotionResult.RUNNING or mode in STREAMING:
            self.reason = "rtloop was restarted"
        if self.motion_result is MotionResult.RUNNING:
            self.motion_result = MotionResult.FAILED

    @property
    def moving(self) -> bool:
        """Whether a motion is loading or under way, its settling included, or a stream comes to its end."""
        return (
            self.mode in (LoopMode.TRAJECTORY, LoopMode.STOPPING)
            or self._following
            or self._braking
            or self._loader is not None
            or (self.streaming.session != 0 and self.mode not in STREAMING)
        )

    def update(self, measured: Measured, now_ns: int, robot_time_s: float, *, fresh: bool) -> None:
        """One cycle; the command is then in `safety`.

        Args:
            measured: as read last.
            now_ns: CLOCK_MONOTONIC.
            robot_time_s: on the robot's clock.
            fresh: whether it was read in this cycle.
        """
        self.safety.now_ns = now_ns
        self._take_requests(now_ns)
        self._take_session()
        self._take_command(measured)
        if self._following:
            self._follow()
        elif self.mode in STREAMING:
            self._stream(measured, robot_time_s)
        if self._slowing_unseen and (self.clock.slowing or not self._following):
            self._slowing_unseen = False
            self.deceleration_ns = now_ns
        if self._braking:
            self._braking = not self.safety.brake()
            np.copyto(self._desired[0], self.safety.position)
        elif not self.safety.apply(self._desired, streamed=self.mode in STREAMING):
            self.estop("the commanded position is not finite")
            self._brake()
        if self.mode in STREAMING:
            self.streaming.follow()
        self._check_tracking(measured.position)
        self._settle(measured, fresh=fresh)

    def stop(self, reason: str) -> None:
        """Come to rest: on the path, if the arm is on it and it leaves room to slow down."""
        if self._loader is not None:
            self._finish_loading(Ack.REJECTED, reason)
        if self.mode is LoopMode.TRAJECTORY or self.mode in STREAMING:
            self._enter(LoopMode.STOPPING, reason)
            self._slow_down()

    def overrun(self, what: str) -> None:
        """Cycles have begun so late that nobody can count on the next ones."""
        if self.mode is LoopMode.TRAJECTORY or self.mode in STREAMING:
            self.safety.count(Intervention.OVERRUN)
            self.stop(f"{what}: the computer is too slow or too busy")

    def estop(self, reason: str) -> None:
        """Come to rest as after a stop, and stay there until reset."""
        self._latch(LoopMode.ESTOP, reason)

    def fault(self, reason: str) -> None:
        """The device or the tracking failed: come to rest as after a stop, and stay there until reset."""
        self._latch(LoopMode.FAULT, reason)

    def _latch(self, mode: LoopMode, reason: str) -> None:
        if self.mode is mode or not self._enter(mode, reason):
            return
        if self._loader is not None:
            self._finish_loading(Ack.REJECTED, reason)
        if self.motion_result is MotionResult.RUNNING:
            self.motion_result = MotionResult.FAILED
        if self._following or self.safety.pursuing or self.streaming.session:
            self._slow_down()

    def _enter(self, mode: LoopMode, reason: str = "") -> bool:
        if mode not in TRANSITIONS[self.mode]:
            return False
        self.mode = mode
        self.reason = reason
        return True

    def _slow_down(self) -> None:
        self._slowing_unseen = True
        if self.safety.pursuing or self.streaming.session:
            self._brake()
        else:
            self.clock.request(0.0)

    def _brake(self) -> None:
        self._following, self._braking, self._left_path = False, True, True
        self._desired[1:] = 0.0

    def _take_requests(self, now_ns: int) -> None:
        stop, estop = self.commands.poll_requests()
        if estop:
            self.estop("e-stop requested")
        if self.streaming.box.estop_requested():
            self.estop("e-stop requested by the streaming client")
        if stop:
            self.stop("stop requested")
        silence_s = self.commands.service_silence_s(now_ns)
        needed = self.mode is LoopMode.TRAJECTORY or (self.mode in STREAMING and self.streaming.from_service)
        if needed and silence_s > self._rt.service_timeout_s:
            self.safety.count(Intervention.SERVICE_TIMEOUT)
            self.stop(f"the service has been silent for {silence_s:.1f} s")

    def _take_session(self) -> None:
        streaming = self.streaming
        if not streaming.box.asks():
            return
        mode = LoopMode.TRAJECTORY if self.moving else self.mode
        if not streaming.open(self.safety.command, mode, self.commands.stops):
            self._enter(streaming.mode)
            self._still_cycles = self._unsettled_cycles = 0

    def _stream(self, measured: Measured, robot_time_s: float) -> None:
        """What the client wants in this cycle."""
        streaming = self.streaming
        streaming.advance(measured, robot_time_s)
        if streaming.not_finite:
            self.estop(streaming.not_finite)
        elif streaming.problem:
            self.stop(streaming.problem)
        elif not streaming.holding:
            self._braking = False
            np.copyto(self._desired, streaming.reference)
        elif not self._waiting:
            self._brake()
        self._waiting = streaming.holding

    def _take_command(self, measured: Measured) -> None:
        if self._loader is not None:
            self._load()
            return
        command = self.commands.next_command()
        if command is None:
            return
        number, kind = int(command["id"]), int(command["kind"])
        refusal: str | None
        if kind in (Command.START, Command.RESET) and int(command["stops"]) != self.commands.stops:
            refusal = "a stop was requested meanwhile"
        elif kind == Command.START:
            refusal = self._start(number, command)
        elif kind == Command.SET_RATE:
            refusal = self._set_rate(float(command["value"]))
        elif kind == Command.RESET:
            refusal = self._reset(measured)
        else:
            refusal = f"there is no command {kind}"
        if refusal is not None:
            self.commands.acknowledge(number, Ack.REJECTED if refusal else Ack.ACCEPTED, refusal)

    def _start(self, number: int, command: np.ndarray) -> str | None:
        """Begin to load; the acknowledgement follows when the motion is verified."""
        slot = int(command["slot"])
        if self.mode is not LoopMode.HOLD:
            return f"the arm is in mode {self.mode.name}"
        if self._braking:
            return "the arm is not at rest yet"
        if slot >= len(self._slots):
            return f"there is no slot {slot}"
        self.slot = slot
        self._loading_motion = int(command["motion_id"])
        self._loader = load(
            self.path,
            self._slots[slot],
            self._loading_motion,
            self.safety.position,
            START_TOLERANCE_RAD,
            self._limits.including(self.safety.position),
        )
        self._loading = number
        return None

    def _load(self) -> None:
        assert self._loader is not None
        try:
            next(self._loader)
        except RefusedError as exc:
            self._finish_loading(Ack.REJECTED, str(exc))
        except StopIteration:
            self._finish_loading(Ack.ACCEPTED)
            self.clock.reset()
            self.motion_id, self.motion_result = self._loading_motion, MotionResult.RUNNING
            self._following, self._left_path = True, False
            self._still_cycles = self._unsettled_cycles = 0
            self.settled = False
            self._enter(LoopMode.TRAJECTORY)

    def _finish_loading(self, result: Ack, message: str = "") -> None:
        self._loader = None
        self.commands.acknowledge(self._loading, result, message)

    def _set_rate(self, rate: float) -> str:
        if self.mode is not LoopMode.TRAJECTORY:
            return f"no motion is running, the arm is in mode {self.mode.name}"
        if not 0.0 <= rate <= 1.0:
            return f"the rate must be from 0 to 1, got {rate}"
        self.clock.request(rate)
        return ""

    def _reset(self, measured: Measured) -> str:
        """Leave ESTOP or FAULT and hold the arm where it is now. The drives may take their time: nothing
        moves.
        """
        if self.mode not in (LoopMode.ESTOP, LoopMode.FAULT):
            return ""
        if self._following or self._braking or self.streaming.session:
            return "the arm is not at rest yet"
        if self.stale:
            return "the robot still reports the same values as when it moved"
        found = Measured(self._limits.dof)
        try:
            self._backend.enable()
            self._backend.read(found)
        except BackendError as exc:
            return f"the robot cannot be enabled: {exc}"
        if not np.isfinite(found.values).all():
            return "the robot reports a value that is not finite"
        np.copyto(measured.values, found.values)
        self._enter(LoopMode.HOLD)
        self.start_at(measured.position)
        return ""

    def _follow(self) -> None:
        clock, path = self.clock, self.path
        clock.advance(path)
        if clock.stuck and self.mode is not LoopMode.TRAJECTORY:
            self._brake()
            return
        path.evaluate(clock.path_time_s, clock.rate, clock.rate_slope, self._desired)
        if clock.path_time_s >= path.duration_s or (clock.at_rest and self.mode is not LoopMode.TRAJECTORY):
            self._following = False
            self._desired[1:] = 0.0

    def _check_tracking(self, position: Array) -> None:
        error = self._error
        np.subtract(position, self.safety.position, out=error)
        allowed = self._yield_rad if self.streaming.session else self._rt.tracking_error_rad
        before, self._off = self._off, sqrt(error.dot(error))
        step = abs(self._off - before)
        misread = step > self._largest_step
        if not misread and (self._off <= allowed or self.mode is LoopMode.FAULT):
            return
        self._misread |= misread
        if self.mode is LoopMode.FAULT:
            return
        joint = int(np.abs(error).argmax())
        if abs(error[joint]) > allowed:
            self.safety.count(Intervention.TRACKING)
            self.fault(
                f"{self._limits.names[joint]} is {abs(error[joint]):.3f} rad from where it is commanded "
                f"({position[joint]:.3f} instead of {self.safety.position[joint]:.3f} rad), "
                f"allowed are {allowed} rad"
            )
        elif misread:
            self.safety.count(Intervention.TRACKING)
            self.fault(f"the measured position has jumped by {step:.3f} rad within a cycle, as no arm can")

    def _settle(self, measured: Measured, *, fresh: bool) -> None:
        """Count how long the arm has been still, and end a motion or a stream that has ended."""
        rt = self._rt
        anywhere = self.streaming.session or self.mode is LoopMode.FAULT  # it yields, or heeds no command
        still = (
            fresh
            and not self._following
            and not self.safety.pursuing
            and (anywhere or np.abs(self._error).max() <= rt.settle_position_rad)
            and np.abs(measured.velocity).max() <= rt.settle_velocity_rad_s
        )
        self._still_cycles = self._still_cycles + 1 if still else 0
        self.settled = self._still_cycles * rt.period_s >= rt.settle_time_s
        if self.streaming.session:
            self._end_stream(measured.position, fresh=fresh)
            return
        if self._following or self.mode not in (LoopMode.TRAJECTORY, LoopMode.STOPPING):
            return
        self._unsettled_cycles += 1
        if self.settled:
            self.motion_result = self._result()
            self._enter(LoopMode.HOLD, self.reason)
        elif self._unsettled_cycles * rt.period_s >= SETTLE_LIMIT_S:
            self.motion_result = MotionResult.FAILED
            self._enter(LoopMode.HOLD, self._why_unsettled(measured.velocity))
            if self.safety.pursuing:
                self._brake()

    def _end_stream(self, position: Array, *, fresh: bool) -> None:
        """Go over to position control, once a session has ended and the arm rests.

        An arm that is pushed aside is held where it is, unless nobody knows where that is; one that is pushed
        around and does not come to rest is held all the same.
        """
        if self.mode in STREAMING or self._braking:
            return
        self._unsettled_cycles += 1
        if self.settled or self._unsettled_cycles * self._rt.period_s >= SETTLE_LIMIT_S:
            self.streaming.close()
            off = np.abs(self._error).max() > self._rt.settle_position_rad
            if off and fresh and not self._misread:
                self.start_at(position)
            if self.mode is LoopMode.STOPPING:
                self._enter(LoopMode.HOLD, self.reason)

    def _result(self) -> MotionResult:
        if self._left_path:
            return MotionResult.STOPPED_ASIDE
        at_end = self.clock.path_time_s >= self.path.duration_s
        return MotionResult.ARRIVED if at_end else MotionResult.STOPPED

    def _why_unsettled(self, velocity: Array) -> str:
        off = np.abs(self._desired[0] - self.safety.position)
        joint = int(off.argmax())
        if off[joint] > self._rt.settle_position_rad:
            here, wanted = self.safety.position[joint], self._desired[0, joint]
            name = self._limits.names[joint]
            return f"the safety layer keeps {name} at {here:.4f} rad: the motion wants it at {wanted:.4f} rad"
        joint = int(np.abs(self._error).argmax())
        return (
            f"not settled {SETTLE_LIMIT_S} s after the end of the motion: {self._limits.names[joint]} is "
            f"{abs(self._error[joint]):.4f} rad away and moves at {velocity[joint]:.4f} rad/s"
        )
