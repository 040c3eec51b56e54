"""Handles and answers requests to move or change the arm: stops, sessions, commands.

Methods with the prefix `c_` run in every cycle and are real-time safe; methods for requests are Python.
"""

from rtloop.backends.compiled cimport Measured
from rtloop.inboxes.commands cimport ESTOP, FAST, STOP
from rtloop.mode_machine cimport BRAKE, COAST, HAND, PATH, STREAM, ModeMachine
from rtloop.planned.handover cimport NO_LOAD, START
from cobot.ipc.state_block cimport StateScalars
from rtloop.tool_and_scene cimport ALL, BEING_READ

from cobot.ipc.layout import Command, Intervention, MotionResult, text
from cobot.reasons import Reason, ReasonCode
from cobot.types import RESTING, LoopMode
from rtloop.mode_machine import OVERTAKEN
from rtloop.planned.loading import RefusedError
from rtloop.results import ACCEPTED, LATER, Rejected
from rtloop.time_factor import time_factor_refusal

# For clients that want to stream.
UNACKNOWLEDGED = (
    "the first contact with the robot is not acknowledged: look at where the arm is and what it carries, "
    "then POST /robot/acknowledge"
)
# For requests to change the motion of a device that executes motions autonomously.
BY_ITSELF = "the device executes whole motions itself: during a motion it can be stopped, but not {}"

cdef int TRAJECTORY = LoopMode.TRAJECTORY


cdef class Controller(ModeMachine):
    """The `update` phase of the cycle. Real-time safe, except for a RESET, which waits for the drives.

    Attributes:
        tool_and_scene: the arm's load and its surroundings.
        slot: the slot of the current motion.
        stale: set by the loop; whether the measured values no longer change although the arm is moving.
        start_position: set by the loop; start position of a simulated arm, shape (dof,), rad.
        cycle_clock: set by the loop; the clock that starts the cycles.
    """

    def __init__(self, settings, model, memory, backend, device):
        """`device` is a `rtloop.device.DeviceWatch`."""
        ModeMachine.__init__(self, settings, model, memory, backend, device)
        self._device, self._output, self._pull_block = device, memory.output, memory.pull
        self._backend_of_arm = backend
        self.tool_and_scene = ToolAndScene(settings, model, memory, backend, self.streaming)
        self._service_timeout_s = settings.rt.service_timeout_s

    def update(self, Measured measured, long long now_ns, double robot_time_s, *, bint fresh):
        """Run one cycle. The resulting command is in `safety`.

        Args:
            measured: the last values read.
            now_ns: CLOCK_MONOTONIC.
            robot_time_s: time of the robot's clock.
            fresh: whether the measured values were read in this cycle.
        """
        self.c_update(measured, now_ns, robot_time_s, fresh)

    def acknowledge(self):
        """Permit full speed, because a user has checked the findings of the first contact against the arm."""
        self._device.acknowledge()
        self.follower.clock.c_scale(self._device.share)

    def heed_t1(self):
        """In T1, end a session that has begun at full speed or that is now too fast."""
        share, begun = self._device.t1_share, self.streaming.t1_share
        if self.c_streams() and share is not None and (begun is None or share < begun):
            words = "the robot has been switched to T1: sessions that begin now have reduced speed"
            self.stop(Reason(words, ReasonCode.T1))

    cdef void c_update(self, Measured measured, long long now_ns, double robot_time_s, bint fresh) except *:
        """Run the cycle; see `update`."""
        cdef ToolAndScene scene = self.tool_and_scene
        self.safety.now_ns = now_ns
        self._heed_requests(now_ns)
        if scene.known != ALL and (scene.known == BEING_READ or not (self.c_moving() or self.c_streams())):
            scene.heed()
        if scene.known != BEING_READ and self.streaming.box.c_asks():
            self._take_session()
        if self.handover.load != NO_LOAD:
            self._load()
        elif self.drives.c_resetting():
            self._step_reset(measured)
        elif scene.known != BEING_READ and self.commands.c_has_command():
            self._take_command(measured, fresh)
        self.c_guide(measured, now_ns, robot_time_s, fresh)

    cdef void c_describe(self, StateScalars* state) noexcept nogil:
        """Fill in the fields of the state block about the controller and its parts."""
        state.mode = self._mode
        state.settled = self.settling.settled
        state.motion_id = self.motion_id
        state.motion_result = self._motion_result
        state.slot = self.slot
        state.path_time_s = self.follower.clock.path_time_s
        state.path_duration_s = self.follower.path.duration_s
        state.path_rate = self.follower.clock.rate
        state.deceleration_monotonic_ns = self.deceleration_ns
        state.stops_seen = self.commands.stops
        state.estops_seen = self.commands.estops
        state.command_seen = self.commands.command_seen
        state.torn_reads = self.commands.c_torn_reads() + self.streaming.c_torn_reads()
        self.streaming.c_describe(state)

    cdef void _heed_requests(self, long long now_ns) except *:
        cdef int asked = self.commands.c_poll_requests()
        cdef double silence_s
        if asked & FAST:
            self.fast_stop(Reason("fast stop requested", ReasonCode.FAST_STOP_REQUESTED))
        if asked & ESTOP:
            self.estop(Reason("e-stop requested", ReasonCode.ESTOP_REQUESTED))
        if self.streaming.box.c_take_estop():
            self.estop(Reason("e-stop requested by the streaming client", ReasonCode.ESTOP_REQUESTED))
        if asked & STOP:
            self.stop(Reason("stop requested", ReasonCode.STOP_REQUESTED))
        silence_s = self.commands.c_service_silence_s(now_ns)
        if silence_s > self._service_timeout_s and (
            self._mode == TRAJECTORY or (self.c_streams() and self.streaming.c_from_service())
        ):
            self.safety.count(Intervention.SERVICE_TIMEOUT)
            words = f"the service has been silent for {silence_s:.1f} s"
            limit_s = self._service_timeout_s
            self.stop(Reason(words, ReasonCode.SERVICE_SILENT, value=silence_s, limit=limit_s, unit="s"))

    def _take_session(self):
        mode = LoopMode.TRAJECTORY if self.moving else self.mode
        result = self._open_session(mode)
        self.streaming.box.answer(result)
        if result == ACCEPTED:
            self._enter(self.streaming.mode)
            self.c_let(HAND if self.streaming.guided else STREAM)
            self.settling.c_begin()

    def _open_session(self, mode):
        scene_known = self.tool_and_scene.scene_known
        if scene_known is not ACCEPTED:
            return Rejected(f"the scene cannot be watched: {scene_known.reason}")
        if self._device.unacknowledged:
            return Rejected(UNACKNOWLEDGED)
        return self.streaming.open(self.safety.command, mode, self.commands.stops, self._device.t1_share)

    def _take_command(self, Measured measured, bint fresh):
        command = self.commands.next_command()
        if command is None:
            return
        kind = int(command["kind"])
        if self._is_overtaken(kind, command):
            result = Rejected(OVERTAKEN)
        elif kind in HANDLERS:
            result = HANDLERS[kind](self, command, measured, fresh)
        else:
            result = Rejected(f"there is no command {kind}")
        self.commands.answer(int(command["id"]), result)

    def _is_overtaken(self, kind, command):
        """Whether a stop has been requested since the client sent a command that moves or resets the arm."""
        cdef unsigned long long stops = self.commands.stops
        if kind == Command.RESET:
            stops += self.commands.estops
        return kind in OVERTAKEN_BY_STOPS and int(command["stops"]) != stops

    def _acknowledge(self, command, Measured measured, bint fresh):
        self.acknowledge()
        return ACCEPTED

    def _set_output(self, command, Measured measured, bint fresh):
        """Set the output that is in the output block. Works in any mode."""
        if not self._output.try_read():
            return Rejected("the output could not be read")
        return self._device.set_output(text(self._output.data["name"]), float(self._output.data["value"]))

    def _reset_cell(self, command, Measured measured, bint fresh):
        """Reset the simulated cell to its initial state. Rejected while anything moves."""
        if self.mode in (LoopMode.HOLD, LoopMode.ESTOP, LoopMode.FAULT):
            return self._device.cell.reset()
        return Rejected(f"the arm is in mode {self.mode.name}")

    def _restart(self, command, Measured measured, bint fresh):
        """Return the simulated arm to its start position. Rejected unless it is at rest."""
        if self.mode is not LoopMode.HOLD or self.c_moving() or self.streaming.session:
            return Rejected(f"the arm is in mode {self.mode.name}")
        result = self._device.restart(self.start_position)
        if result == ACCEPTED:
            self._backend_of_arm.read(measured)
            self.start_at(measured.position)
        return result

    def _set_time_factor(self, command, Measured measured, bint fresh):
        """Change the time factor of a simulation, also during a motion: the commands do not depend on it."""
        factor = float(command["value"])
        refusal = time_factor_refusal(self._backend_of_arm, self.cycle_clock, factor)
        if refusal:
            return Rejected(refusal)
        self.cycle_clock.scale(factor)
        return ACCEPTED

    def _pull(self, command, Measured measured, bint fresh):
        """Pull the simulated arm. Rejected unless it is being guided by hand."""
        if not self._pull_block.try_read():
            return Rejected("the pull could not be read")
        record = self._pull_block.data
        if text(record["link"]) and self.mode is not LoopMode.JOINT_IMPEDANCE:
            return Rejected(f"the arm is not guided by hand, it is in mode {self.mode.name}")
        return self._device.pull(record)

    def _start(self, command, Measured measured, bint fresh):
        """Begin to load a motion. The result follows when the motion has been verified."""
        if self.mode is not LoopMode.HOLD:
            return Rejected(f"the arm is in mode {self.mode.name}")
        if self._guide == BRAKE or (self._guide == COAST and not self.settling.rests):
            return Rejected(self._explain_unrest(measured))
        return self.handover.begin_start(command, self.safety.position)

    def _replace(self, command, Measured measured, bint fresh):
        """Begin to load a new trajectory for the current motion, which continues during loading."""
        motion, offset_s = int(command["motion_id"]), float(command["value"])
        here_s = self.follower.clock.path_time_s
        if self.mode is not LoopMode.TRAJECTORY or self._guide != PATH:
            return Rejected(f"no motion is following a path, the arm is in mode {self.mode.name}")
        if self.follower.by_itself:
            return Rejected(BY_ITSELF.format("led on to another motion"))
        if motion != self.motion_id:
            return Rejected(f"motion {self.motion_id} is running, not {motion}")
        if not 0.0 <= offset_s <= here_s:
            return Rejected(f"it would begin at {offset_s} s of a motion that is at {here_s:.3f} s")
        return self.handover.begin_replacement(command, self.safety.position, offset_s)

    def _load(self):
        try:
            if not self.handover.step():
                return
        except RefusedError as exc:
            self._finish_loading(Rejected(str(exc)))
            return
        if self.handover.load == START:
            self._begin_motion()
        else:
            self._swap()

    def _begin_motion(self):
        try:
            self.follower.watch.set(self.handover.fence())
            self.signals.begin(self.handover.motion_id, self.handover.signals())
            held_up = self.signals.waiting or self.signals.pause_while.active
            if self.follower.by_itself and held_up:
                raise ValueError(BY_ITSELF.format("held up by a condition"))
        except ValueError as exc:
            self._finish_loading(Rejected(str(exc)))
            return
        self._finish_loading(ACCEPTED)
        self.motion_id, self.slot = self.handover.motion_id, self.handover.slot
        self._motion_result = MotionResult.RUNNING
        self.c_let(PATH)
        self.settling.c_begin()
        self._enter(LoopMode.TRAJECTORY)
        self.follower.begin(self.handover.swap(self.follower.path))

    def _swap(self):
        """Continue on the loaded trajectory, if possible."""
        result = Rejected("the motion has already ended")
        if self._guide == PATH:
            result = self.follower.check_continuation(self.handover.path, self.handover.offset_s)
        if result is ACCEPTED:
            try:
                self.signals.continue_with(
                    self.motion_id, self.handover.signals(), self.handover.offset_s
                )
            except ValueError as exc:
                result = Rejected(str(exc))
        if result is ACCEPTED:
            self.slot = self.handover.slot
            self.follower.continue_with(self.handover.swap(self.follower.path), self.handover.offset_s)
        self._finish_loading(result)

    def _read_scene(self, command, Measured measured, bint fresh):
        """Read the scene again once the arm is at rest. A new session waits until it has been read."""
        if self.c_streams() or self.streaming.session:
            return Rejected(
                f"a client streams (mode {self.mode.name}): change the scene before or after that"
            )
        self.tool_and_scene.hear_of(int(command["scene"]))
        return ACCEPTED

    def _change_tool(self, command, Measured measured, bint fresh):
        if self._mode not in RESTING or self.c_moving() or self.streaming.session:
            return Rejected(f"the tool changes only while the arm rests: it is in mode {self.mode.name}")
        return self.tool_and_scene.take(int(command["tool"]), int(command["scene"]))

    def _set_rate(self, command, Measured measured, bint fresh):
        rate = float(command["value"])
        if self._mode != TRAJECTORY:
            return Rejected(f"no motion is running, the arm is in mode {self.mode.name}")
        if self.follower.by_itself:
            return Rejected(BY_ITSELF.format("slowed down"))
        if not 0.0 <= rate <= 1.0:
            return Rejected(f"the rate must be from 0 to 1, got {rate}")
        self.follower.clock.c_request(rate)
        return ACCEPTED

    def _reset(self, command, Measured measured, bint fresh):
        """Leave ESTOP or FAULT and hold the arm at its current position. This cycle may take long, because
        nothing is moving. If the drives are enabled in steps, the result follows later.
        """
        if self.mode not in (LoopMode.ESTOP, LoopMode.FAULT):
            return ACCEPTED
        rests = self.settling.rests or not (self.follower.by_itself and fresh)
        if self._guide in (PATH, BRAKE) or self.streaming.session or not rests:
            return Rejected(self._explain_unrest(measured))
        if self.stale:
            return Rejected("the robot still reports the same values as when it moved")
        result = self.drives.begin_reset(int(command["id"]), self.commands.stops, measured)
        if result == ACCEPTED:
            self._hold(measured)
        return result

    def _explain_unrest(self, Measured measured):
        why = self.settling.explain_unrest(measured.velocity)
        if self.streaming.session:
            why = "the streaming session has not ended"
        elif self._guide == BRAKE:
            why = "its joints are slowing down"
        elif self._guide == PATH:
            braking = "it is slowing down on its path"
            why = "the device has not stopped" if self.follower.by_itself else braking
        return f"the arm is not at rest yet: {why}"

    def _step_reset(self, Measured measured):
        """Execute one step of a reset in steps. During the reset, the command follows the measured
        position.
        """
        result = Rejected(OVERTAKEN)
        if not self.drives.is_overtaken(self.commands.stops):
            result = self.drives.step_reset(measured)
        if result == ACCEPTED:
            self._hold(measured)
        if result != LATER:
            self._finish_reset(result)

    def _hold(self, Measured measured):
        self._enter(LoopMode.HOLD)
        self.start_at(measured.position)


HANDLERS = {
    Command.START: Controller._start,
    Command.REPLACE: Controller._replace,
    Command.SET_RATE: Controller._set_rate,
    Command.RESET: Controller._reset,
    Command.TOOL: Controller._change_tool,
    Command.ACKNOWLEDGE: Controller._acknowledge,
    Command.SCENE: Controller._read_scene,
    Command.OUTPUT: Controller._set_output,
    Command.RESET_CELL: Controller._reset_cell,
    Command.RESTART: Controller._restart,
    Command.PULL: Controller._pull,
    Command.TIME_FACTOR: Controller._set_time_factor,
}
"""The method for each kind of command. Its arguments are the command, the measured values, and whether they
are new.
"""
OVERTAKEN_BY_STOPS = frozenset({Command.START, Command.REPLACE, Command.RESET, Command.RESTART, Command.PULL})
"""Commands that are rejected if a stop was requested after they were sent."""
