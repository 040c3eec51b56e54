"""What the arm shall do in this cycle: modes, motion on a path, stops, commands.

A long module, because the modes are one state: its parts that have a state of their own (inbox, path, path
clock, session, safety) have a module of their own. What happens in every cycle begins with `c_` and is
real-time safe; what happens when somebody asks for something is Python.
"""

from libc.math cimport fabs, fmin, sqrt
from libc.string cimport memcpy, memset

from cobot.arrays cimport MAX_DOF, doubles
from rtloop.backends.compiled cimport Measured
from rtloop.publisher cimport StateScalars
from rtloop.streaming.feed cimport NO_PROBLEM, Feed

import numpy as np

from cobot.errors import CobotError, InputError, LimitError
from cobot.ipc.layout import Ack, Command, Intervention, MotionResult, text
from cobot.ipc.tool_record import tool_of
from cobot.robot.tool import check_tool
from cobot.types import RESTING, LoopMode
from rtloop.backends import BackendError, CarriesTool, MovesByItself, Stepwise
from rtloop.modes import STREAMING, TRANSITIONS
from rtloop.planned.loading import RefusedError, load
from rtloop.streaming.surroundings import Surroundings

# How far a motion may start from the commanded position: planning rounds, the safety layer smooths.
START_TOLERANCE_RAD = 1e-3
# Robot time after the end of a motion within which the arm has to settle.
SETTLE_LIMIT_S = 2.0
# A measured position that moves so many times as far in a cycle as all joints at full speed was misread.
JUMP_FACTOR = 3.0
# To who wants to stream.
UNACKNOWLEDGED = (
    "the first contact with the robot is not acknowledged: look at where the arm is and what it carries, "
    "then POST /robot/acknowledge"
)
# To who wants to change what a device that moves by itself is doing.
BY_ITSELF = "the device moves by itself along whole motions: on its way it can be stopped, not {}"
# How far ahead on its path a motion's fence is looked at, s: whatever its speed, it can stop within.
cdef double FENCE_AHEAD_S = 0.5

MODES = tuple(LoopMode)
cdef int TRAJECTORY = LoopMode.TRAJECTORY
cdef int STOPPING = LoopMode.STOPPING
cdef int FAULT = LoopMode.FAULT
cdef unsigned int STREAMING_BITS = sum(1 << mode for mode in STREAMING)


cdef class Controller:
    """The `update` of the cycle. Real-time safe, but for a RESET, which waits for the drives.

    Attributes:
        commands, safety, streaming, path, clock: its parts.
        mode, reason: the mode, and why it is ESTOP or FAULT, or why the last stop was made.
        motion_id, motion_result: the running motion or the last one.
        slot: where that motion was read from.
        settled: at rest, as measured: at the commanded position, or anywhere in FAULT and in a session.
        stale: whether what is measured has stopped changing although the arm is moved; the loop sets it.
        deceleration_ns: when the last stop began to slow the arm down, set from the cycle's `now_ns`.
        drives_off: whether a stop of category 1 has switched the drives off, until a reset.
    """

    def __init__(self, settings, model, memory, backend, device):
        """device: what is told of it, a `rtloop.device.DeviceWatch`."""
        self._device = device
        self.drives_off = device.drives_off
        self._switching_off = self.enabling = self._recovered = False
        self._enabling_number = self._enabling_stops = 0  # of the RESET
        self._resting_cycles = 0
        self._mover = backend if isinstance(backend, MovesByItself) else None
        self._by_itself = self._mover is not None
        self._coasting = self._fresh = False  # It comes to rest by itself, anywhere.
        self._rt = rt = settings.rt
        self._limits = limits = model.limits
        self._dof = limits.dof
        if self._dof > MAX_DOF:
            raise InputError(f"the robot has {self._dof} joints, possible are {MAX_DOF}")
        self._slots = memory.slots
        self._model, self._info, self._tool = model, memory.info, memory.tool
        self._output = memory.output
        self._max_payload_kg = settings.robot.max_payload_kg
        self._backend = backend
        self.commands = CommandInbox(memory)
        self.safety = Safety(limits, rt.period_s)
        self.streaming = Session(settings, model, memory, backend, self.safety)
        self.surroundings = Surroundings(settings, model, self.streaming.stream_limits)
        self._surrounding = self._changed = False
        self._unseen = ""  # Why the monitor does not know what stands around the arm.
        self.path = Path(rt.trajectory_capacity, limits.dof)
        self._other = Path(rt.trajectory_capacity, limits.dof)
        self._offset_s = -1.0
        self.clock = PathClock(limits, rt.period_s)
        self.watch = Watch(model.chain)
        self._mode = LoopMode.HOLD
        self.reason = ""
        self.motion_id = 0
        self._motion_result = MotionResult.NONE
        self.slot = 0
        self.settled = self.stale = False
        self.deceleration_ns = 0
        self._desired_rows = np.zeros((3, limits.dof))  # rad, rad/s, rad/s²
        self._desired = doubles(self._desired_rows, 3 * self._dof)
        memset(self._error, 0, sizeof(self._error))  # Measured against commanded, rad.
        self._off = self._jump = self._largest_error = 0.0
        self._largest_step = JUMP_FACTOR * rt.period_s * float(np.linalg.norm(limits.max_velocity))
        if self._by_itself:  # It tells from time to time where it is.
            self._largest_step = float("inf")
        self._misread = self._left_path = self._stop_unseen = False
        self._yield_rad = settings.streaming.yield_rad
        self._tracking_error_rad = rt.tracking_error_rad
        self._settle_position_rad = rt.settle_position_rad
        self._settle_velocity_rad_s = rt.settle_velocity_rad_s
        self._settle_cycles = _cycles(rt.settle_time_s, rt.period_s)
        self._settle_limit_cycles = _cycles(SETTLE_LIMIT_S, rt.period_s)
        self._service_timeout_s = rt.service_timeout_s
        self._guide = NOTHING
        self._still_cycles = self._unsettled_cycles = 0
        self._loader = None
        self._loading = 0  # The number of the START or REPLACE command.
        self._loading_motion = self._loading_slot = 0

    @property
    def mode(self):
        return MODES[self._mode]

    @property
    def motion_result(self):
        return MotionResult(self._motion_result)

    @property
    def moving(self):
        """Whether a motion is loading or under way, its settling included, or a stream comes to its end."""
        return self.c_moving()

    def start_at(self, position):
        """Hold a position, shape (dof,), rad, where the arm is at rest."""
        self._desired_rows[:] = 0.0
        self._desired_rows[0] = position
        self.safety.reset(position)
        self._guide = NOTHING
        self._misread = False
        self._off = 0.0

    def let_go(self, position):
        """The robot has not taken commands for some time, so its drives have stopped by themselves.

        When it takes them again, it shall find that it is wanted where it is.
        """
        problem = self.streaming.close() if self.streaming.session else ""
        self.start_at(position)
        if problem:
            self.fault(problem)

    def restore(self, state):
        """Take over what a dead rtloop has left: latches stay, an interrupted motion has failed."""
        self.commands.refuse_pending("rtloop was restarted")
        self.motion_id = int(state["motion_id"])
        result = MotionResult(int(state["motion_result"]))
        self.safety.interventions[:] = state["interventions"]
        self.safety.intervened_ns[:] = state["intervened_ns"]
        mode = LoopMode(int(state["mode"]))
        if mode in (LoopMode.ESTOP, LoopMode.FAULT):
            self._mode = mode
            self.reason = text(state["reason"])
        elif result is MotionResult.RUNNING or mode in STREAMING:
            self.reason = "rtloop was restarted"
        self._motion_result = MotionResult.FAILED if result is MotionResult.RUNNING else result

    def update(self, Measured measured, long long now_ns, double robot_time_s, *, bint fresh):
        """One cycle; the command is then in `safety`.

        Args:
            measured: as read last.
            now_ns: CLOCK_MONOTONIC.
            robot_time_s: on the robot's clock.
            fresh: whether it was read in this cycle.
        """
        self.c_update(measured, now_ns, robot_time_s, fresh)

    def stop(self, reason):
        """Come to rest: on the path, if the arm is on it and it leaves room to slow down."""
        if self._loader is not None:
            self._finish_loading(Ack.REJECTED, reason)
        if self._mode == TRAJECTORY or self.c_streams():
            self._enter(LoopMode.STOPPING, reason)
            self._slow_down()

    def overrun(self, what):
        """Cycles have begun so late that nobody can count on the next ones."""
        if self._mode == TRAJECTORY or self.c_streams():
            self.safety.count(Intervention.OVERRUN)
            self.stop(f"{what}: the computer is too slow or too busy")

    def estop(self, reason):
        """Come to rest as after a stop, and stay there until reset."""
        self._latch(LoopMode.ESTOP, reason)

    def fast_stop(self, reason):
        """Stop category 1: each joint comes to rest as fast as its limits permit, on the path or beside it;
        then the drives are switched off, until a reset.
        """
        self._latch(LoopMode.ESTOP, reason)
        if self._guide == PATH and not self._by_itself:
            self.c_brake()
        self._switching_off = not self.drives_off
        self._resting_cycles = 0

    def switch_off(self):
        """The second half of it. The drives may take their time: nothing moves."""
        self._switching_off = False
        if 1 not in self._device.capabilities.stops:
            return
        try:
            self._backend.disable()
        except BackendError as exc:
            self.reason = f"{self.reason}; the drives could not be switched off: {exc}"
            return
        self._switched(off=True)

    def _switched(self, *, off):
        self.drives_off = off
        self._device.switched(off=off)

    def fault(self, reason):
        """The device or the tracking failed: come to rest as after a stop, and stay there until reset."""
        self._latch(LoopMode.FAULT, reason)

    def heed_t1(self):
        """A session that was begun at full speed does not go on in T1, nor one that now goes too fast."""
        share, begun = self._device.t1_share, self.streaming.t1_share
        if self.c_streams() and share is not None and (begun is None or share < begun):
            self.stop("the robot has been switched to T1: sessions that are begun now go with reduced speed")

    cdef void c_update(self, Measured measured, long long now_ns, double robot_time_s, bint fresh) except *:
        """`update`."""
        self.safety.now_ns = now_ns
        self._fresh = fresh
        self._heed_requests(now_ns)
        if self._surrounding or (self._changed and not self.c_moving() and not self.c_streams()):
            self._surround()
        if self._surrounding:
            pass  # Whatever would move the arm waits until the thread has ended.
        elif self.streaming.box.c_asks():
            self._take_session()
        if self._loader is not None:
            self._load()
        elif self.enabling:
            self.enable_step(measured)
        elif not self._surrounding and self.commands.c_has_command():
            self._take_command(measured)
        if self._coasting:
            self._coast(measured)
        elif self._guide == PATH:
            if self._by_itself:
                self._follow_device(measured)
            else:
                self.c_follow_path()
            if self.watch.active and self._mode == TRAJECTORY:
                self._heed_fence()
        elif self.c_streams():
            self.streaming.c_advance(measured.c_values + 4 * self._dof, robot_time_s)
            self._heed_stream()
        if self._stop_unseen and (self.clock.c_slowing() or self._guide != PATH):
            self._stop_unseen = False
            self.deceleration_ns = now_ns
        if self._guide == BRAKE:
            if self.safety.c_brake():
                self._guide = NOTHING
            memcpy(self._desired, self.safety.c_command, self._dof * sizeof(double))
        elif not self.safety.c_apply(self._desired, self.c_streams()):
            self.estop("the commanded position is not finite")
            self.c_brake()
        if self.c_streams():
            self.streaming.feed.source.c_follow(self.safety.c_command)
        if not self.c_tracks(measured.c_values):
            self._lose_track(measured.position)
        if self.c_settle(measured.c_values + self._dof, fresh):
            self._rest(measured, fresh)

    def lay_over(self):
        """What a session has the robot exert on top of the command of this cycle."""
        self.streaming.lay_over(self._guide == STREAM)

    cdef bint c_moving(self) noexcept nogil:
        """`moving`."""
        return (
            self._mode == TRAJECTORY
            or self._mode == STOPPING
            or self._guide == PATH
            or self._guide == BRAKE
            or self._coasting
            or self._loading != 0
            or (self.streaming.session != 0 and not self.c_streams())
        )

    cdef bint c_switches_off(self) noexcept nogil:
        """Whether a stop of category 1 has come so far that the drives go off: the arm rests, or does not
        although nothing moves it.
        """
        if not self._switching_off or self._guide != NOTHING:
            return False
        self._resting_cycles += 1
        return self.settled or self._resting_cycles >= self._settle_limit_cycles

    cdef bint c_streams(self) noexcept nogil:
        """Whether the mode is one of those in which a client streams."""
        return STREAMING_BITS >> self._mode & 1

    cdef void c_describe(self, StateScalars* state) noexcept nogil:
        """Fill in what the state block says of the controller and its parts."""
        state.mode = self._mode
        state.settled = self.settled
        state.motion_id = self.motion_id
        state.motion_result = self._motion_result
        state.slot = self.slot
        state.path_time_s = self.clock.path_time_s
        state.path_duration_s = self.path.duration_s
        state.path_rate = self.clock.rate
        state.deceleration_monotonic_ns = self.deceleration_ns
        state.stops_seen = self.commands.stops
        state.estops_seen = self.commands.estops
        state.command_seen = self.commands.command_seen
        state.torn_reads = self.commands.c_torn_reads() + self.streaming.c_torn_reads()
        self.streaming.c_describe(state)

    def _latch(self, mode, reason):
        if self.mode is mode or not self._enter(mode, reason):
            return
        if self._loader is not None:
            self._finish_loading(Ack.REJECTED, reason)
        if self.motion_result is MotionResult.RUNNING:
            self._motion_result = MotionResult.FAILED
        if self._guide == PATH or self.safety.pursuing or self.streaming.session:
            self._slow_down()

    def _enter(self, mode, reason=""):
        if mode not in TRANSITIONS[self.mode]:
            return False
        self._mode = mode
        self.reason = reason
        return True

    def _slow_down(self):
        self._stop_unseen = True
        if self._by_itself:
            self._mover.halt()
        elif self.safety.pursuing or self.streaming.session:
            self.c_brake()
        else:
            self.clock.request(0.0)

    cdef void c_brake(self) noexcept nogil:
        """Leave path and stream: each joint comes to rest by itself."""
        self._guide = BRAKE
        self._left_path = True
        memset(self._desired + self._dof, 0, 2 * self._dof * sizeof(double))

    cdef void _heed_requests(self, long long now_ns) except *:
        cdef int asked = self.commands.c_poll_requests()
        cdef double silence_s
        if asked & 4:
            self.fast_stop("fast stop requested")
        if asked & 2:
            self.estop("e-stop requested")
        if self.streaming.box.c_estop_requested():
            self.estop("e-stop requested by the streaming client")
        if asked & 1:
            self.stop("stop requested")
        silence_s = self.commands.c_service_silence_s(now_ns)
        if silence_s > self._service_timeout_s and (
            self._mode == TRAJECTORY or (self.c_streams() and self.streaming.c_from_service())
        ):
            self.safety.count(Intervention.SERVICE_TIMEOUT)
            self.stop(f"the service has been silent for {silence_s:.1f} s")

    def _take_session(self):
        mode = LoopMode.TRAJECTORY if self.moving else self.mode
        if self._unseen:
            self.streaming.box.answer(Ack.REJECTED, f"the scene cannot be watched: {self._unseen}")
            return
        if self._device.unacknowledged:
            self.streaming.box.answer(Ack.REJECTED, UNACKNOWLEDGED)
            return
        if not self.streaming.open(self.safety.command, mode, self.commands.stops, self._device.t1_share):
            self._enter(self.streaming.mode)
            self._guide = STREAM
            self._still_cycles = self._unsettled_cycles = 0

    cdef void _heed_stream(self) except *:
        """What the client wants in this cycle."""
        cdef Feed feed = self.streaming.feed
        if feed.not_finite:
            self.estop(self.streaming.not_finite)
        elif feed.problem != NO_PROBLEM:
            self.stop(self.streaming.problem)
        elif not feed.holding:
            self._guide = STREAM
            memcpy(self._desired, feed.source.ref, 3 * self._dof * sizeof(double))
        elif self._guide == STREAM:
            self.c_brake()

    def _take_command(self, Measured measured):
        command = self.commands.next_command()
        if command is None:
            return
        number, kind = int(command["id"]), int(command["kind"])
        stops = int(command["stops"])
        if kind in (Command.START, Command.REPLACE, Command.RESET) and stops != self.commands.stops:
            refusal = "a stop was requested meanwhile"
        elif kind == Command.START:
            refusal = self._start(number, command)
        elif kind == Command.REPLACE:
            refusal = self._replace(number, command)
        elif kind == Command.SET_RATE:
            refusal = self._set_rate(float(command["value"]))
        elif kind == Command.RESET:
            refusal = self._reset(measured, number, stops)
        elif kind == Command.TOOL:
            refusal = self._take_tool(int(command["tool"]), int(command["scene"]))
        elif kind == Command.ACKNOWLEDGE:
            refusal = self.acknowledge()
        elif kind == Command.SCENE:
            refusal = self._take_scene(int(command["scene"]))
        elif kind == Command.OUTPUT:
            refusal = self._set_output()
        else:
            refusal = f"there is no command {kind}"
        if refusal is not None:
            self.commands.acknowledge(number, Ack.REJECTED if refusal else Ack.ACCEPTED, refusal)

    def _start(self, number, command):
        """Begin to load; the acknowledgement follows when the motion is verified."""
        if self.mode is not LoopMode.HOLD:
            return f"the arm is in mode {self.mode.name}"
        if self._guide == BRAKE or (self._coasting and not self.settled):
            return "the arm is not at rest yet"
        return self._begin_loading(number, command, self.safety.position)

    def _replace(self, number, command):
        """Begin to load what the motion under way shall go on with; it goes on as it is meanwhile."""
        motion, offset_s = int(command["motion_id"]), float(command["value"])
        if self.mode is not LoopMode.TRAJECTORY or self._guide != PATH:
            return f"no motion is under way on its path, the arm is in mode {self.mode.name}"
        if self._by_itself:
            return BY_ITSELF.format("led on to another motion")
        if motion != self.motion_id:
            return f"motion {self.motion_id} is under way, not {motion}"
        if not 0.0 <= offset_s <= self.clock.path_time_s:
            return f"it would begin at {offset_s} s of a motion that is at {self.clock.path_time_s:.3f} s"
        return self._begin_loading(number, command, None, offset_s)

    def _begin_loading(self, number, command, start, offset_s=-1.0):
        slot = int(command["slot"])
        if slot >= len(self._slots):
            return f"there is no slot {slot}"
        planned, carried = int(command["tool"]), self._model.tool.version
        if planned != carried:
            return f"the motion was planned with version {planned} of the tool, the arm has version {carried}"
        self._loading_motion, self._loading_slot = int(command["motion_id"]), slot
        self._offset_s = offset_s
        limits = self._limits.including(self.safety.position)
        self._loader = load(
            self._other, self._slots[slot], self._loading_motion, start, START_TOLERANCE_RAD, limits
        )
        self._loading = number
        return None

    def _load(self):
        try:
            next(self._loader)
        except RefusedError as exc:
            self._finish_loading(Ack.REJECTED, str(exc))
        except StopIteration:
            if self._offset_s < 0.0:
                self._begin_motion()
            else:
                refusal = self._swap()
                self._finish_loading(Ack.REJECTED if refusal else Ack.ACCEPTED, refusal)

    def _begin_motion(self):
        try:
            self.watch.set(self._slots[self._loading_slot].head.data["fence"])
        except ValueError as exc:
            self._finish_loading(Ack.REJECTED, str(exc))
            return
        self._finish_loading(Ack.ACCEPTED)
        self._take_other_path()
        self.clock.reset()
        self.motion_id, self._motion_result = self._loading_motion, MotionResult.RUNNING
        self._guide, self._left_path = PATH, False
        self._still_cycles = self._unsettled_cycles = 0
        self.settled = False
        self._enter(LoopMode.TRAJECTORY)
        if self._by_itself:
            segments = self.path.segments
            self._mover.begin(
                self.path.breakpoints_s[:segments + 1].copy(),
                self.path.coefficients[:segments].copy(),
                self.clock.share,
            )

    def _swap(self):
        """Go on with what has been loaded if it is the same up to here, and as far as a change of the rate
        that is under way relies on the path; else why not. What the motion is fenced by stays.
        """
        cdef double offset_s = self._offset_s
        cdef double here_s = self.clock.path_time_s - offset_s
        if self._guide != PATH:
            return "the motion has come to its end meanwhile"
        if not self._other.c_continues(self.path, offset_s, here_s, self.clock.c_committed_s() - offset_s):
            return f"it differs from the motion under way, which is at {self.clock.path_time_s:.3f} s already"
        self._take_other_path()
        self.clock.c_shift(offset_s)
        return ""

    def _take_other_path(self):
        self.path, self._other, self.slot = self._other, self.path, self._loading_slot

    def carry(self, tool):
        """Have this tool on the flange from the next cycle on: in the model and, if it wants to know, in the
        backend. Some 500 µs, so only while nothing moves.

        Raises:
            BackendError: the robot refuses it; nothing has changed.
        """
        if isinstance(self._backend, CarriesTool):
            self._backend.set_tool(tool)
        self._model.carry(tool)
        self._info.data["flange"] = self._model.flange_in_tcp()
        self._info.data["tool_version"] = tool.version
        self._info.publish()

    def _take_scene(self, version):
        """Read anew what stands around the arm, as soon as it rests; a session waits for it."""
        if self.c_streams() or self.streaming.session:
            return f"somebody streams (mode {self.mode.name}): the scene changes before or after that"
        self._hear_of(version)
        return ""

    def _hear_of(self, version):
        self._changed = True
        self._info.data["scene_version"] = version
        self._info.publish()

    def watch_scene(self):
        """Have streams know from the beginning what stands around the arm; before the first cycle."""
        try:
            self.streaming.watch(self.surroundings.read())
        except CobotError as exc:
            self._unseen = str(exc)
        self._info.data["scene_version"] = self.surroundings.version

    cdef void _surround(self) except *:
        """Have the surroundings read, or take over what has been made of them."""
        if not self._surrounding:
            self._surrounding, self._changed = True, False
            self.surroundings.begin()
            return
        done, monitor = self.surroundings.take()
        if not done:
            return
        self._surrounding = False
        self._unseen = self.surroundings.problem
        if monitor is not None:
            self.streaming.watch(monitor)

    def _take_tool(self, version, scene_version):
        """Carry what stands in the tool's block. The arm rests: the command stays what it is, and the torques
        that hold it follow the weight within the same cycle.
        """
        if self._mode not in RESTING or self.c_moving() or self.streaming.session:
            return f"the tool changes only while the arm rests: it is in mode {self.mode.name}"
        if not self._tool.try_read():
            return "the tool could not be read"
        try:
            tool = tool_of(self._tool.data)
            check_tool(tool, self._max_payload_kg, self._model.file_gravity)
            if tool.version != version:
                return f"version {tool.version} of the tool stands there, not {version}"
            self.carry(tool)
            self._hear_of(scene_version)  # Its shapes stand in its file.
        except (InputError, LimitError, ValueError, BackendError) as exc:
            return str(exc)
        return ""

    def _set_output(self):
        """Pass on what stands in the output's block, whatever the arm does."""
        if not self._output.try_read():
            return "the output could not be read"
        return self._device.set_output(text(self._output.data["name"]), float(self._output.data["value"]))

    def _finish_loading(self, result, message=""):
        number, self._loader, self._loading = self._loading, None, 0
        self.commands.acknowledge(number, result, message)

    def acknowledge(self):
        """Somebody has compared what the first contact has found with the arm: full speed from now on."""
        self._device.acknowledge()
        self.clock.scale(self._device.share)
        return ""

    def _set_rate(self, rate):
        if self._mode != TRAJECTORY:
            return f"no motion is running, the arm is in mode {self.mode.name}"
        if self._by_itself:
            return BY_ITSELF.format("slowed down")
        if not 0.0 <= rate <= 1.0:
            return f"the rate must be from 0 to 1, got {rate}"
        self.clock.request(rate)
        return ""

    def _reset(self, Measured measured, number, stops):
        """Leave ESTOP or FAULT and hold the arm where it is now. The drives may take their time: nothing
        moves. Where they take it in steps, the acknowledgement follows (None).
        """
        if self.mode not in (LoopMode.ESTOP, LoopMode.FAULT):
            return ""
        rests = self.settled or not (self._by_itself and self._fresh)
        if self._guide in (PATH, BRAKE) or self.streaming.session or not rests:
            return "the arm is not at rest yet"
        if self.stale:
            return "the robot still reports the same values as when it moved"
        if isinstance(self._backend, Stepwise):
            self._enabling_number, self._enabling_stops = number, stops
            self.enabling, self._recovered = True, False
            return None
        return self._enabled(measured)

    def enable_step(self, Measured measured):
        """A bit of a reset: the backend recovers, then its drives are switched on, and meanwhile the cycle
        goes on with its packets. The command is where the arm is.
        """
        refusal = self._step_on(measured)
        if refusal is not None:
            self.enabling = False
            result = Ack.REJECTED if refusal else Ack.ACCEPTED
            self.commands.acknowledge(self._enabling_number, result, refusal)

    def _step_on(self, Measured measured):
        """None for another step, "" when the arm is held, else why it cannot be."""
        if self.commands.stops != self._enabling_stops or self._mode not in (LoopMode.ESTOP, LoopMode.FAULT):
            return "a stop was requested meanwhile"
        try:
            if not self._recovered:
                self._recovered = self._backend.recover_step()
                return None
            if not self._backend.enable_step():
                return None
        except BackendError as exc:
            return f"the robot cannot be enabled: {exc}"
        return self._enabled(measured, stepwise=True)

    def _enabled(self, Measured measured, *, stepwise=False):
        found = Measured(self._dof)
        try:
            if not stepwise:
                self._backend.enable()
            self._switched(off=False)
            self._backend.read(found)
        except BackendError as exc:
            return f"the robot cannot be enabled: {exc}"
        if not np.isfinite(found.values).all():
            return "the robot reports a value that is not finite"
        np.copyto(measured.values, found.values)
        self._enter(LoopMode.HOLD)
        self.start_at(measured.position)
        return ""

    cdef void c_follow_path(self) noexcept nogil:
        """Where the path is in this cycle, until its end, or until it has come to rest."""
        cdef bint stopping = self._mode != TRAJECTORY
        self.clock.c_advance(self.path)
        if stopping and self.clock.c_stuck():
            self.c_brake()
            return
        self.path.c_evaluate(self.clock.path_time_s, self.clock.rate, self.clock.rate_slope, self._desired)
        if self.clock.path_time_s >= self.path.duration_s or (stopping and self.clock.c_at_rest()):
            self._guide = NOTHING
            memset(self._desired + self._dof, 0, 2 * self._dof * sizeof(double))

    cdef void _follow_device(self, Measured measured) except *:
        """Where the device says it is on the path that it was given. Once it comes to rest because it was
        told to, where it is measured.
        """
        if self._mode != TRAJECTORY and self._mover.is_halted():
            self._coasting, self._still_cycles, self._unsettled_cycles = True, 0, 0
            self._coast(measured)
            return
        self._place(self._mover.done_s())
        self.safety.reset(self._desired_rows[0])
        if self.clock.path_time_s >= self.path.duration_s:
            self._guide = NOTHING

    cdef void _coast(self, Measured measured) except *:
        """Until it rests, or nobody knows. It has left the path if it is not where it says."""
        self._place(self._mover.done_s())
        self._left_path = bool(
            np.abs(self._desired_rows[0] - measured.position).max() > self._settle_position_rad
        )
        self.start_at(measured.position)
        self._coasting = self._fresh and not self.settled

    def _place(self, double path_time_s):
        """Want the arm there on its path, at rest as far as the safety layer is concerned."""
        self.clock.path_time_s = max(self.clock.path_time_s, path_time_s)
        self.path.c_evaluate(self.clock.path_time_s, self.clock.rate, 0.0, self._desired)
        memset(self._desired + self._dof, 0, 2 * self._dof * sizeof(double))

    cdef void _heed_fence(self) except *:
        """Come to rest before the path leaves the motion's fence: half a second of it is enough to do so."""
        cdef double rows[3 * MAX_DOF]
        cdef double place[4]
        cdef Py_ssize_t index = self.path.index
        cdef double ahead_s = fmin(self.clock.path_time_s + FENCE_AHEAD_S, self.path.duration_s)
        self.path.c_evaluate(ahead_s, self.clock.rate, 0.0, rows)
        self.path.index = index
        if self.watch.c_beyond(rows, place) or self.watch.c_beyond(self._desired, place):
            self.stop(self.watch.said([place[0], place[1], place[2], place[3]]))

    cdef bint c_tracks(self, const double* position) noexcept nogil:
        """Whether the arm is where it is commanded to be, as far as that is required in this mode."""
        cdef double allowed = self._yield_rad if self.streaming.session else self._tracking_error_rad
        cdef double square = 0.0, before = self._off
        cdef bint misread
        cdef int joint
        self._largest_error = 0.0
        for joint in range(self._dof):
            self._error[joint] = position[joint] - self.safety.c_command[joint]
            square += self._error[joint] * self._error[joint]
            self._largest_error = max(self._largest_error, fabs(self._error[joint]))
        self._off = sqrt(square)
        misread = fabs(self._off - before) > self._largest_step
        self._jump = fabs(self._off - before) if misread else 0.0
        if misread:
            self._misread = True
        return self._mode == FAULT or not (misread or self._off > allowed)

    def _lose_track(self, position):
        """A joint is too far from where it is commanded to be, or was misread."""
        error = np.array([self._error[joint] for joint in range(self._dof)])
        allowed = self._yield_rad if self.streaming.session else self._tracking_error_rad
        joint = int(np.abs(error).argmax())
        if abs(error[joint]) > allowed:
            self.safety.count(Intervention.TRACKING)
            unit = self._limits.unit(joint)
            self.fault(
                f"{self._limits.names[joint]} is {abs(error[joint]):.3f} {unit} from where it is commanded "
                f"({position[joint]:.3f} instead of {self.safety.position[joint]:.3f} {unit}), "
                f"allowed are {allowed} {unit}"
            )
        elif self._jump:
            self.safety.count(Intervention.TRACKING)
            self.fault(
                f"the measured position has jumped by {self._jump:.3f} {self._limits.units} within a cycle, "
                "as no arm can"
            )

    cdef bint c_settle(self, const double* velocity, bint fresh) noexcept nogil:
        """Count how long the arm has been still; whether a motion or a stream may have ended."""
        cdef bint anywhere = self.streaming.session != 0 or self._mode == FAULT
        cdef bint still = fresh and self._guide != PATH and not self.safety.pursuing
        cdef int joint
        # In a session it gives way, in FAULT it heeds no command: then it may rest anywhere.
        still = still and (anywhere or self._largest_error <= self._settle_position_rad)
        for joint in range(self._dof):
            still = still and fabs(velocity[joint]) <= self._settle_velocity_rad_s
        self._still_cycles = self._still_cycles + 1 if still else 0
        self.settled = self._still_cycles >= self._settle_cycles
        if self.streaming.session:
            if self.c_streams() or self._guide == BRAKE:
                return False
        elif self._guide == PATH or not (self._mode == TRAJECTORY or self._mode == STOPPING):
            return False
        self._unsettled_cycles += 1
        return self.settled or self._unsettled_cycles >= self._settle_limit_cycles

    def _rest(self, Measured measured, fresh):
        """What moved the arm has ended, and it rests, or does not come to rest."""
        if self.streaming.session:
            self._end_stream(measured.position, fresh)
        elif self.settled:
            self._motion_result = self._result()
            self._enter(LoopMode.HOLD, self.reason)
        else:
            self._motion_result = MotionResult.FAILED
            self._enter(LoopMode.HOLD, self._why_unsettled(measured.velocity))
            if self.safety.pursuing:
                self.c_brake()

    def _end_stream(self, position, fresh):
        """Go over to position control, once a session has ended and the arm rests.

        An arm that is pushed aside is held where it is, unless nobody knows where that is; one that is pushed
        around and does not come to rest is held all the same.
        """
        problem = self.streaming.close()
        if self._largest_error > self._settle_position_rad and fresh and not self._misread:
            self.start_at(position)
        if self._mode == STOPPING:
            self._enter(LoopMode.HOLD, self.reason)
        if problem:
            self.fault(problem)

    def _result(self):
        if self._left_path:
            return MotionResult.STOPPED_ASIDE
        at_end = self.clock.path_time_s >= self.path.duration_s
        return MotionResult.ARRIVED if at_end else MotionResult.STOPPED

    def _why_unsettled(self, velocity):
        off = np.abs(self._desired_rows[0] - self.safety.position)
        joint = int(off.argmax())
        if off[joint] > self._rt.settle_position_rad:
            here, wanted = self.safety.position[joint], self._desired_rows[0, joint]
            name, unit = self._limits.names[joint], self._limits.unit(joint)
            return (
                f"the safety layer keeps {name} at {here:.4f} {unit}: "
                f"the motion wants it at {wanted:.4f} {unit}"
            )
        error = np.array([self._error[joint] for joint in range(self._dof)])
        joint = int(np.abs(error).argmax())
        return (
            f"not settled {SETTLE_LIMIT_S} s after the end of the motion: {self._limits.names[joint]} is "
            f"{abs(error[joint]):.4f} {self._limits.unit(joint)} away and moves at {velocity[joint]:.4f} "
            f"{self._limits.unit(joint, 1)}"
        )


def _cycles(time_s, period_s):
    """The least whole number of periods that last no less than a time."""
    cycles = int(time_s / period_s)
    return cycles if cycles * period_s >= time_s else cycles + 1
