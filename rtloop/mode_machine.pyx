"""Two states and their transitions: the mode of the arm, and its guide.

The mode is public: `rtloop.modes` has its transitions, and only `_enter` changes it, except at a restart. The
guide determines the source of the commands and is internal. It is a `Guide`, whose values are documented with
what each permits; only `c_let` changes it. Any event may change both states. Methods with the prefix `c_` run
in every cycle and are real-time safe; methods for events are Python.
"""

from libc.string cimport memcpy, memset

from cobot.arrays cimport MAX_DOF, doubles
from cobot.ipc.state_block cimport EXTERNAL_EFFORT_ROW, VELOCITY_ROW
from rtloop.backends.compiled cimport Measured
from rtloop.planned.follower cimport DONE, NO_ROOM, UNDER_WAY, Way
from rtloop.planned.handover cimport NO_LOAD
from rtloop.planned.signals cimport AS_BEFORE, BEGIN, END, HOLD, Verdict
from rtloop.streaming.feed cimport NO_PROBLEM, Feed

import numpy as np

from cobot.errors import InputError
from cobot.ipc.layout import Intervention, MotionResult
from cobot.reasons import Reason, ReasonCode
from cobot.types import LoopMode
from rtloop.backends import BackendError
from rtloop.modes import STREAMING, TRANSITIONS
from rtloop.results import ACCEPTED, Rejected

# Reason for commands that a stop has overtaken.
OVERTAKEN = "a stop has been requested in the meantime"

MODES = tuple(LoopMode)
cdef int TRAJECTORY = LoopMode.TRAJECTORY
cdef int STOPPING = LoopMode.STOPPING
cdef int FAULT = LoopMode.FAULT
cdef unsigned int STREAMING_BITS = sum(1 << mode for mode in STREAMING)


cdef class ModeMachine:
    """Calculates the command of each cycle, which is then in `safety`, according to the current guide, and
    ends the guide when necessary.

    Attributes:
        commands, safety, streaming, settling, drives, handover, follower, signals: its parts.
        mode, reason: the mode, and the reason for ESTOP, FAULT or the last stop.
        motion_id, motion_result: the current or the last motion.
        deceleration_ns: time at which the last stop began to slow the arm down, from the cycle's `now_ns`.
    """

    def __init__(self, settings, model, memory, backend, device):
        """device: a `rtloop.device.DeviceWatch`."""
        rt, limits = settings.rt, model.limits
        self._dof = limits.dof
        if self._dof > MAX_DOF:
            raise InputError(f"the robot has {self._dof} joints, allowed: up to {MAX_DOF}")
        self._desired_rows = np.zeros((3, limits.dof))  # rad, rad/s, rad/s²
        self._desired = doubles(self._desired_rows, 3 * self._dof)
        self.commands = CommandInbox(memory)
        self.safety = Safety(limits, rt.period_s)
        self.streaming = Session(settings, model, memory, backend, self.safety)
        self.settling = SettlingMonitor(settings, limits, self.safety)
        self.drives = Drives(backend, device, self._dof, self.settling.settle_limit_cycles)
        capacity = rt.trajectory_capacity
        self.follower = PathFollower(model, capacity, rt.period_s, backend, self._desired_rows)
        self.handover = Handover(model, capacity, memory.slots)
        self.signals = Signals(model.chain, memory.signals, device)
        if self.follower.by_itself:
            self.settling.believe_jumps()
        self._mode, self._guide, self.reason = LoopMode.HOLD, NOTHING, Reason("")
        self.motion_id, self._motion_result = 0, MotionResult.NONE
        self._yield_rad = settings.streaming.yield_rad
        self._tracking_error_rad = rt.tracking_error_rad
        self._settle_position_rad = rt.settle_position_rad

    @property
    def mode(self):
        return MODES[self._mode]

    @property
    def motion_result(self):
        return MotionResult(self._motion_result)

    @property
    def path(self):
        return self.follower.path

    @property
    def clock(self):
        return self.follower.clock

    @property
    def settled(self):
        """Whether the arm is at rest at the commanded position; in FAULT and in a session at any position."""
        return self.settling.settled

    @property
    def moving(self):
        """Whether a motion is being loaded, running or settling, or a streaming session is ending."""
        return self.c_moving()

    def start_at(self, position):
        """Hold a position, shape (dof,), rad, at which the arm is at rest."""
        self._desired_rows[:] = 0.0
        self._desired_rows[0] = position
        self.safety.reset(position)
        if self._guide != COAST:
            self.c_let(NOTHING)
        self.settling.c_hold()

    def let_go(self, position):
        """Handle a robot that has not accepted commands for some time and has therefore stopped on its own.

        When it accepts commands again, the command must equal its position.
        """
        result = self.streaming.close() if self.streaming.session else ACCEPTED
        self.start_at(position)
        if result != ACCEPTED:
            self.fault(result.reason)

    def restore(self, state):
        """Restore the state of a crashed rtloop. Latches stay; an interrupted motion has failed."""
        self.commands.refuse_pending("rtloop was restarted")
        self.motion_id = int(state["motion_id"])
        result = MotionResult(int(state["motion_result"]))
        self.safety.interventions[:] = state["interventions"]
        self.safety.intervened_ns[:] = state["intervened_ns"]
        mode = LoopMode(int(state["mode"]))
        if mode in (LoopMode.ESTOP, LoopMode.FAULT):
            self._mode = mode
            self.reason = Reason.of_record(state)
        elif result is MotionResult.RUNNING or mode in STREAMING:
            self.reason = Reason("rtloop was restarted", ReasonCode.RESTARTED)
        self._motion_result = MotionResult.FAILED if result is MotionResult.RUNNING else result

    def stop(self, reason):
        """Stop the arm: on its path, if it is on a path with enough room to slow down."""
        if self.handover.load != NO_LOAD:
            self._finish_loading(Rejected(reason))
        if self._mode == TRAJECTORY or self.c_streams():
            self._enter(LoopMode.STOPPING, reason)
            self._slow_down()

    def overrun(self, what, late_s):
        """Handle cycles that begin so late that later cycles are unreliable.

        Args:
            late_s: delay of the current cycle, s.
        """
        if self._mode == TRAJECTORY or self.c_streams():
            self.safety.count(Intervention.OVERRUN)
            words = f"{what}: the computer is too slow or too busy"
            self.stop(Reason(words, ReasonCode.LATE, value=late_s, unit="s"))

    def estop(self, reason):
        """Stop, and stay at rest until a reset."""
        if self.drives.c_resetting():
            self._finish_reset(Rejected(OVERTAKEN))
        self._latch(LoopMode.ESTOP, reason)

    def fast_stop(self, reason):
        """Make a stop of category 1: each joint stops as fast as its limits permit, even off the path. Then
        the drives are switched off until a reset.
        """
        self.estop(reason)
        if self._guide == PATH and not self.follower.by_itself:
            self.c_let(BRAKE)
        self.drives.switch_off_at_rest()

    def switch_off(self):
        """Switch the drives off after a stop of category 1. This may take long, because nothing is moving."""
        result = self.drives.switch_off()
        if result != ACCEPTED:
            self.reason = self.reason.and_then(result.reason)

    def fault(self, reason):
        """Handle a failure of the device or of tracking: stop, and stay at rest until a reset."""
        self._latch(LoopMode.FAULT, reason)

    def lay_over(self):
        """Apply the force or torque that a session adds to this cycle's command."""
        self.streaming.lay_over(self._guide == STREAM)

    cdef bint c_moving(self) noexcept nogil:
        """Like `moving`, for compiled code."""
        return (
            self._mode == TRAJECTORY
            or self._mode == STOPPING
            or self._guide == PATH
            or self._guide == BRAKE
            or self._guide == COAST
            or self.handover.load != NO_LOAD
            or (self.streaming.session != 0 and not self.c_streams())
        )

    cdef bint c_planned(self) noexcept nogil:
        """Whether a planned motion runs that is not being stopped."""
        return self._mode == TRAJECTORY

    cdef bint c_switches_off(self) noexcept nogil:
        """Whether to switch the drives off in this cycle. Call it once per cycle."""
        cdef bint moved = self._guide != NOTHING and self._guide != COAST and self._guide != HAND
        return not moved and self.drives.c_count_down(self.settling.settled)

    cdef bint c_streams(self) noexcept nogil:
        """Whether the mode is one of those in which a client streams."""
        return STREAMING_BITS >> self._mode & 1

    cdef void c_guide(
        self, Measured measured, long long now_ns, double robot_time_s, bint fresh
    ) except *:
        """Calculate this cycle's command, and observe the effect of the last ones."""
        cdef double allowed
        if self._guide == COAST:
            self._coast(measured, fresh)
        elif self._guide == HAND:
            self._go_with_hand(measured, robot_time_s, fresh)
        elif self._guide == PATH:
            self._follow(measured, robot_time_s, fresh)
        elif self.c_streams():
            self.streaming.c_advance(measured.c_values + EXTERNAL_EFFORT_ROW * self._dof, robot_time_s)
            self._heed_stream()
        if self._stop_unseen and (self.follower.clock.c_slowing() or self._guide != PATH):
            self._stop_unseen = False
            self.deceleration_ns = now_ns
        if self._guide == BRAKE:
            if self.safety.c_brake():
                self.c_let(NOTHING)
            memcpy(self._desired, self.safety.c_command, self._dof * sizeof(double))
        elif not self.safety.c_apply(self._desired, self.c_streams()):
            self.estop(Reason("the commanded position is not finite", ReasonCode.NOT_FINITE))
            self.c_let(BRAKE)
        if self.c_streams():
            self.streaming.feed.source.c_follow(self.safety.c_command)
        allowed = self._yield_rad if self.streaming.session else self._tracking_error_rad
        if not self.settling.c_tracks(measured.c_values, allowed) and self._mode != FAULT:
            self._lose_track(measured.position, allowed)
        if self.c_settle(measured, fresh):
            self._rest(measured, fresh)

    def _latch(self, mode, reason):
        if self.mode is mode or not self._enter(mode, reason):
            return
        if self.handover.load != NO_LOAD:
            self._finish_loading(Rejected(reason))
        if self.motion_result is MotionResult.RUNNING:
            self._motion_result = MotionResult.FAILED
        if self._guide == PATH or self.safety.pursuing or self.streaming.session:
            self._slow_down()

    def _enter(self, mode, reason=""):
        """Enter a mode, if the transition is permitted."""
        if mode not in TRANSITIONS[self.mode]:
            return False
        self._mode = mode
        self.reason = Reason.of_text(reason)
        return True

    cdef void c_let(self, Guide guide) noexcept nogil:
        """Let this guide determine the commands from now on. BRAKE abandons the path or the stream: each
        joint stops separately.
        """
        self._guide = guide
        if guide == BRAKE:
            self.follower.left = True
            memset(self._desired + self._dof, 0, 2 * self._dof * sizeof(double))

    def _slow_down(self):
        self._stop_unseen = True
        if self.streaming.guided:
            self.settling.c_begin()
            result = self.streaming.end_guiding()
            if result is not ACCEPTED:
                self.fault(result.reason)
        elif not self.follower.by_itself and (self.safety.pursuing or self.streaming.session):
            self.c_let(BRAKE)
        else:
            self.follower.slow_down()

    def _finish_loading(self, result):
        self.commands.answer(self.handover.end(), result)

    def _finish_reset(self, result):
        self.commands.answer(self.drives.end_reset(), result)

    cdef void _heed_stream(self) except *:
        """Follow the client's target in this cycle."""
        cdef Feed feed = self.streaming.feed
        if feed.not_finite:
            self.estop(Reason(self.streaming.explain_not_finite(), ReasonCode.NOT_FINITE))
        elif feed.problem != NO_PROBLEM:
            self.stop(self.streaming.explain_end())
        elif not feed.holding:
            self.c_let(STREAM)
            memcpy(self._desired, feed.source.ref, 3 * self._dof * sizeof(double))
        elif self._guide == STREAM:
            self.c_let(BRAKE)

    cdef void _go_with_hand(self, Measured measured, double robot_time_s, bint fresh) except *:
        """Command the measured position while a person is guiding the arm, and until it is at rest after
        that.
        """
        if fresh:
            # The command is the last measured position, so the next comparison of the two shows jumps.
            self.settling.c_tracks(measured.c_values, self._yield_rad)
            self._desired_rows[:] = 0.0
            self._desired_rows[0] = measured.position
            self.safety.reset(measured.position)
        if self.c_streams():
            self.streaming.c_advance(measured.c_values + EXTERNAL_EFFORT_ROW * self._dof, robot_time_s)
            if self.streaming.feed.problem != NO_PROBLEM:
                self.stop(self.streaming.explain_end())

    cdef void _follow(self, Measured measured, double robot_time_s, bint fresh) except *:
        """Follow the path. A device that executes motions itself may stop at any position; until it has
        stopped, the command is the position that it reports.
        """
        cdef bint stopping
        cdef Way way
        if self.signals.active and fresh and self._mode == TRAJECTORY:
            self._heed_conditions(measured, robot_time_s)
            if self._guide != PATH:
                return
        stopping = self._mode != TRAJECTORY
        if self.signals.waiting:
            way = DONE if stopping else UNDER_WAY
            self.follower.path.c_evaluate(0.0, 0.0, 0.0, self._desired)
        elif not self.follower.by_itself:
            way = self.follower.c_follow(stopping)
        elif stopping and self.follower.is_halted():
            self.settling.c_begin()
            self.c_let(COAST)
            self._coast(measured, fresh)
            return
        else:
            way = self.follower.follow_device()
            self.safety.reset(self._desired_rows[0])
        if way == NO_ROOM:
            self.c_let(BRAKE)
        elif way == DONE:
            self.c_let(NOTHING)
        if stopping:
            return
        if self.signals.c_due(self.follower.clock.path_time_s) and not self.signals.waiting:
            result = self.signals.fire(
                measured.position, self.follower.clock.path_time_s, robot_time_s
            )
            if result is not ACCEPTED:
                self.stop(result.reason)
        if self.follower.watch.active:
            self._heed_fence()

    cdef void _heed_conditions(self, Measured measured, double robot_time_s) except *:
        """Make the motion wait, begin, pause, continue or end as its conditions require."""
        cdef Verdict verdict
        try:
            verdict = self.signals.c_look(
                measured.c_values, self.follower.clock.path_time_s, robot_time_s
            )
        except BackendError as exc:
            words = f"a condition of the motion cannot be checked: {exc}"
            self.stop(Reason(words, ReasonCode.CONDITION_UNREADABLE))
            return
        if verdict == AS_BEFORE:
            return
        if verdict == BEGIN:
            self.follower.clock.c_begin()
        elif verdict == END:
            value = self.signals.until.value
            words = f"the condition `until` was met: {value:.4g}"
            self._end_at_once(Reason(words, ReasonCode.CONDITION_MET, value=value))
        else:
            self.follower.clock.c_hold(verdict == HOLD)

    cdef void _end_at_once(self, reason) except *:
        """Stop because `until` is met: on the path, or each joint as fast as its limits permit."""
        self.stop(reason)
        if self.follower.by_itself or self._guide != PATH:
            return
        if self.signals.fast:
            self.c_let(BRAKE)
        else:
            self.follower.clock.c_end_urgently()

    cdef void _coast(self, Measured measured, bint fresh) except *:
        """Wait until the device has stopped, or its state is unknown. If the arm is not at its reported place
        on the path, it has left the path.
        """
        self.follower.place()
        off = np.abs(self._desired_rows[0] - measured.position).max()
        self.follower.left = off > self._settle_position_rad
        self.start_at(measured.position)
        if self.settling.rests or not fresh:
            self.c_let(NOTHING)

    cdef void _heed_fence(self) except *:
        """Stop before the path leaves the motion's fence."""
        cdef double place[4]
        if self.follower.c_leaves_fence(place):
            self.stop(self.follower.watch.said([place[0], place[1], place[2], place[3]]))

    def _lose_track(self, position, allowed):
        """Handle a joint that is too far from its commanded position or was misread."""
        result = self.settling.check_tracking(position, allowed)
        if result is not ACCEPTED:
            self.safety.count(Intervention.TRACKING)
            self.fault(result.reason)

    cdef bint c_settle(self, Measured measured, bint fresh) noexcept nogil:
        """Measure how long the arm has been at rest, and check whether a motion or a session may have
        ended.
        """
        # The arm may be at rest at any position in a session, because it is compliant; in contact, because it
        # may be pushed aside; and in FAULT, because it follows no command.
        cdef bint anywhere = self.streaming.session != 0 or self._mode == FAULT or self.signals.met
        self.settling.c_settle(
            measured.c_values,
            measured.c_values + VELOCITY_ROW * self._dof,
            fresh and self._guide != PATH and not self.safety.pursuing,
            anywhere,
        )
        if self.streaming.session:
            if self.c_streams() or self._guide == BRAKE:
                return False
        elif self._guide == PATH or not (self._mode == TRAJECTORY or self._mode == STOPPING):
            return False
        return self.settling.c_check_end()

    def _rest(self, Measured measured, fresh):
        """Finish a motion or session whose arm is at rest, or has not come to rest in time.

        In contact, it may not come to rest: pressed against a wall, it can slide until it is held at its
        position.
        """
        if self.streaming.session:
            self._end_stream(measured.position, fresh)
        elif self.settling.settled or self.signals.met:
            self._motion_result = MotionResult.MET if self.signals.met else self.follower.result()
            if self.signals.met:
                self._yield_to_contact(measured.position, fresh)
            self._enter(LoopMode.HOLD, self.reason)
        else:
            self._motion_result = MotionResult.FAILED
            why = self.settling.explain_unsettled(self._desired_rows[0], measured.velocity)
            self._enter(LoopMode.HOLD, why)
            if self.safety.pursuing:
                self.c_let(BRAKE)

    def _yield_to_contact(self, position, fresh):
        """Hold the arm at its position if the contact that has ended its motion has pushed it aside."""
        self.signals.end()
        if self.settling.largest > self._settle_position_rad and fresh and not self.settling.misread:
            self.start_at(position)

    def _end_stream(self, position, fresh):
        """Switch to position control once a session has ended and the arm is at rest.

        An arm that was pushed aside is held at its position, unless the position is unknown. An arm that is
        pushed continuously and does not come to rest is also held.
        """
        guided = self.streaming.guided
        result = self.streaming.close()
        aside = self.settling.largest > self._settle_position_rad and fresh and not self.settling.misread
        if guided or aside:
            self.start_at(position)
        if self._mode == STOPPING:
            self._enter(LoopMode.HOLD, self.reason)
        if result != ACCEPTED:
            self.fault(result.reason)
