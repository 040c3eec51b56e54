"""The cycle: read, update, write, publish.

This module is long because the phases of the cycle share the measured values and their times.
"""

from cpython.exc cimport PyErr_CheckSignals
from libc.math cimport fabs, isfinite

from cobot.ipc.state_block cimport count_measured
from rtloop.backends.compiled cimport CompiledBackend, Measured
from rtloop.clock cimport CycleClock, Pace, RealtimeClock, monotonic_ns
from rtloop.controller cimport Controller
from rtloop.publisher cimport StatePublisher, Statistics
from rtloop.recording cimport PHASES, CycleRecorder

import numpy as np

from cobot.ipc.layout import Phase
from cobot.reasons import Reason, ReasonCode
from cobot.robot.tool import BARE
from rtloop.backends import BackendError, Paced
from rtloop.backends.guarded import ForeignError, guarded
from rtloop.device import DeviceWatch
from rtloop.device_limits import device_limits, narrowed, slowed
from rtloop.first_contact import first_contact
from rtloop.last_state import last_state
from rtloop.time_factor import time_factor_refusal

# Timeout for the arm to be at rest before the process ends, s of robot time.
END_LIMIT_S = 3.0
# Maximum number of periods to wait for the device's beat. After a missing beat, the next one is due in one
# period.
BEAT_PATIENCE = 1.5

cdef int WAKEUP = Phase.WAKEUP
cdef int READ = Phase.READ
cdef int UPDATE = Phase.UPDATE
cdef int WRITE = Phase.WRITE
cdef int TOTAL = Phase.TOTAL


cdef class ControlLoop:
    """Runs one robot, cycle by cycle."""

    def __init__(self, settings, model, memory, backend, CycleClock clock, recording=None):
        """recording: a `cobot.ipc.recording_memory.RecordingMemory`, which gets a record of each cycle."""
        self._period_s = settings.rt.period_s
        self._period_ns = round(settings.rt.period_s * 1e9)
        self._overruns_to_stop = settings.rt.overruns_to_stop
        self._pause_to_stop_ns = round(settings.rt.pause_to_stop_s * 1e9)
        self._late_in_a_row = 0
        self._frozen_to_fault = round(settings.rt.frozen_after_s / settings.rt.period_s)
        # Number of cycles in which the arm was commanded to move but no measured value changed.
        self._frozen = 0
        self._moving_rad_s = settings.rt.settle_velocity_rad_s
        self._square = 0.0  # A fingerprint of the last measured values.
        self._unwritten = 0  # Number of consecutive cycles.
        self._is_compiled = isinstance(backend, CompiledBackend)
        self._compiled = backend if self._is_compiled else None
        backend = guarded(backend)
        self._backend, self._model = backend, model
        self._clock = clock
        self._is_paced = isinstance(backend, Paced)
        # With a clock in robot time, the device may be as fast as it can.
        self._pace = Pace(settings.rt.period_s) if isinstance(clock, RealtimeClock) else None
        self._beatless = 0  # Number of consecutive cycles without a beat of the device.
        self._begun_ns = 0  # Time of the last cycle that a beat has started.
        self._device = DeviceWatch(memory, backend)
        theirs = device_limits(backend, model.limits)
        if theirs is not None:
            self._device.slow_down(slowed(model.limits, theirs))
            model.limits.take_over(narrowed(model.limits, theirs))
        self._ask_cycles = 0
        if self._device.asks:
            self._ask_cycles = max(1, round(self._device.period_s / settings.rt.period_s))
        self._last = last_state(memory)
        self.controller = Controller(settings, model, memory, backend, self._device)
        self.controller.cycle_clock = clock
        self._state = StatePublisher(memory, model)
        self._statistics = Statistics(memory)
        self._is_recorded = recording is not None
        self._recorder = CycleRecorder(recording) if self._is_recorded else None
        self._measured = Measured(model.dof)
        self._fresh = Measured(model.dof)
        self._measured_ns = 0
        self._cycle = 0

    def open(self, start_position, tool=BARE, before=None):
        """Connect to the robot with its tool, and hold it at its position. A simulation begins at the last
        position of the previous one.

        Args:
            before: called after the tool is set, before the robot is connected.

        Raises:
            BackendError: the robot does not answer.
        """
        last = self._last
        self.controller.start_position = start_position
        if last is not None:
            self._cycle = int(last["cycle"])
            self.controller.restore(last)
            if not time_factor_refusal(self._backend, self._clock, float(last["time_factor"])):
                self._clock.scale(float(last["time_factor"]))
        if tool.version:
            self.controller.tool_and_scene.carry(tool)
        if before is not None:
            before()
        known = last is not None and np.isfinite(last["position"]).all()
        self._backend.open(last["position"] if last is not None and known else start_position)
        self._backend.read(self._measured)
        # not if an earlier rtloop has read a stop that switches them off
        if not self.controller.drives.c_off():
            self._backend.enable()
        if self._device.capabilities.hardware:
            self._device.meet(first_contact(self._model, self._measured.position))
        self._heed_device()
        self.controller.start_at(self._measured.position)

    def beat(self):
        """Wait for the next cycle, and return its delay in nanoseconds. With an externally clocked device,
        wait for its packet instead of the clock.
        """
        cdef long long late_ns
        if self._is_paced:
            return self._await_beat()
        late_ns = self._clock.wait(moving=self.controller.c_moving(), planned=self.controller.c_planned())
        return late_ns

    def _await_beat(self):
        """Wait for the device's packet, which defines the deadline. A cycle that begins more than a period
        after the previous one is late. A packet that does not arrive is a missed period.
        """
        cdef long long late_ns = 0, now_ns, early_ns
        patience = 1.0 if self._beatless else BEAT_PATIENCE
        try:
            beaten = self._backend.wait(patience * self._period_s)
        except BackendError as exc:
            words = f"no packets from the robot, which clocks the cycle: {exc}"
            self.controller.fault(Reason(words, ReasonCode.NO_PACKETS))
            beaten = False
            with nogil:
                self._clock.c_wait(False, False)
        now_ns = monotonic_ns()
        if self._pace is not None:
            early_ns = self._pace.c_early(now_ns, beaten)
            if early_ns > 0:
                self._race(early_ns)
                now_ns = monotonic_ns()
        if not beaten:
            self._beatless += 1
            self._clock.overruns += 1
        else:
            if self._begun_ns and not self._beatless:
                late_ns = max(0, now_ns - self._begun_ns - self._period_ns)
                self._clock.overruns += late_ns // self._period_ns
            self._beatless = 0
        self._begun_ns = now_ns
        return late_ns

    def _race(self, long long early_ns):
        """Handle a device that is faster than the clock: the arm stops, with cycles on the computer's
        clock.
        """
        words = (
            f"the robot's packets arrive too fast: {self._pace.beats} packets in "
            f"{self._pace.beats_ns * 1e-9:.3f} s, but a period is {self._period_s:g} s"
        )
        self.controller.fault(Reason(words, ReasonCode.PACKETS_TOO_FAST))
        with nogil:
            self._pace.c_hold(early_ns)

    def step(self, long long late_ns=0):
        """Run one cycle. Real-time safe. Raises exceptions only for programming errors.

        Args:
            late_ns: delay of the cycle's beginning.
        """
        self.c_step(late_ns)

    def run(self, ending):
        """Run cycles until `ending` contains a reason and the arm is at rest."""
        cdef long long end_cycle = 0, late_ns
        cdef bint moving, planned
        while True:
            if self._is_paced:
                late_ns = self._await_beat()
            else:
                moving, planned = self.controller.c_moving(), self.controller.c_planned()
                with nogil:
                    late_ns = self._clock.c_wait(moving, planned)
            self.c_step(late_ns)
            PyErr_CheckSignals()
            if ending:
                if end_cycle == 0:
                    end_cycle = self._cycle + int(END_LIMIT_S / self._period_s)
                    self.controller.stop(Reason(ending[0], ReasonCode.SHUTDOWN))
                if not self.controller.c_moving() or self._cycle >= end_cycle:
                    return

    def close(self):
        """Switch the drives off and release the robot."""
        try:
            self._backend.disable()
        finally:
            self._backend.close()

    cdef void c_step(self, long long late_ns) except *:
        """Like `step`, for compiled code."""
        cdef long long begun_ns = monotonic_ns(), read_ns, updated_ns, written_ns
        cdef double robot_time_s = (self._cycle + 1) * self._period_s
        cdef bint fresh
        cdef Statistics statistics = self._statistics
        self._late_in_a_row = self._late_in_a_row + 1 if late_ns > self._period_ns else 0
        if self._late_in_a_row >= self._overruns_to_stop:
            self.controller.overrun(f"{self._late_in_a_row} cycles in a row began late", late_ns * 1e-9)
        elif late_ns > self._pause_to_stop_ns:
            self.controller.overrun(f"a cycle began {late_ns * 1e-9:.2f} s late", late_ns * 1e-9)
        fresh = self.c_read() and not self._beatless
        read_ns = monotonic_ns()
        if fresh:
            self._measured_ns = read_ns
            if self._unwritten >= self._overruns_to_stop or self._is_loose():
                self.controller.let_go(self._measured.position)
        if not self._beatless or self._beatless >= self._overruns_to_stop:
            self.controller.c_update(self._measured, read_ns, robot_time_s, fresh)
        updated_ns = monotonic_ns()
        if self._beatless:
            self._miss_beat()
        else:
            self.c_write()
            if self.controller.c_switches_off():
                self.controller.switch_off()
        written_ns = monotonic_ns()
        self._cycle += 1
        self._state.c_heed(self.controller.safety, self.controller.reason)
        self.c_publish(robot_time_s)
        if self._is_recorded:
            self.c_record(late_ns, read_ns - begun_ns, updated_ns - read_ns, written_ns - updated_ns, fresh)
        if self._ask_cycles and self._cycle % self._ask_cycles == 0:
            try:
                self._heed_device()
            except ForeignError as exc:
                self.controller.fault(Reason(str(exc), ReasonCode.DEVICE))
        statistics.c_count(WAKEUP, late_ns)
        statistics.c_count(READ, read_ns - begun_ns)
        statistics.c_count(UPDATE, updated_ns - read_ns)
        statistics.c_count(WRITE, written_ns - updated_ns)
        statistics.c_end_cycle()
        statistics.c_count(TOTAL, monotonic_ns() - begun_ns)

    cdef bint c_read(self) except *:
        """Use the new measured values if they are valid. Returns False if the last valid values stay in
        use.
        """
        cdef Measured fresh = self._fresh
        cdef double square = 0.0
        cdef int index
        if not (self._is_compiled and self._compiled.c_read(fresh.c_values) == 0):
            try:
                self._backend.read(fresh)
            except BackendError as exc:
                self.controller.fault(Reason(f"reading from the robot failed: {exc}", ReasonCode.READING))
                return False
        for index in range(count_measured(fresh.dof)):
            square += fresh.c_values[index] * fresh.c_values[index]
        if not isfinite(square):
            words = "the robot reports a value that is not finite"
            self.controller.fault(Reason(words, ReasonCode.NOT_FINITE))
            return False
        self._measured, self._fresh = fresh, self._measured
        if square != self._square:
            self._square = square
            self._frozen = 0
            self.controller.stale = False
        elif not self.controller.stale and not self._unwritten:
            self._frozen = self._frozen + 1 if self.c_moves() else 0
            if self._frozen >= self._frozen_to_fault:
                self._freeze()
        return not self.controller.stale

    cdef bint _is_loose(self) noexcept:
        """Whether the arm may be at any position, so that the command must follow its measured position."""
        return self.controller.drives.c_loose()

    def _miss_beat(self):
        """If the robot accepts no command, keep the current one for a time, so that the motion can continue
        without a jump.
        """
        self._unwritten += 1
        if self._beatless == self._overruns_to_stop:
            silence_s = self._beatless * self._period_s
            words = f"no packet from the robot, which clocks the cycle, for {silence_s:.3f} s"
            self.controller.fault(Reason(words, ReasonCode.NO_PACKETS, value=silence_s, unit="s"))

    def _heed_device(self):
        """Poll the device and apply its speed override.

        Raises:
            ForeignError: a report is unusable; the other reports are applied.
        """
        try:
            self._device.ask()
        finally:
            if self._device.share != self.controller.follower.clock.share:
                self.controller.follower.clock.scale(self._device.share)
            self.controller.heed_t1()

    def _freeze(self):
        """Handle measured values that have not changed although the arm should move."""
        self.controller.stale = True
        words = f"the robot has reported the same values in {self._frozen} cycles although it should move"
        self.controller.fault(Reason(words, ReasonCode.FROZEN))

    cdef bint c_moves(self) noexcept nogil:
        """Whether any joint is commanded to move."""
        cdef const double* velocity = self.controller.safety.c_command + self._measured.dof
        cdef int joint
        for joint in range(self._measured.dof):
            if fabs(velocity[joint]) > self._moving_rad_s:
                return True
        return False

    cdef void c_write(self) except *:
        """Send the command to the robot. With the drives off, it is sent only if the robot's packets need an
        answer.
        """
        if self.controller.drives.c_off() and not self._is_paced:
            return
        try:
            if self.controller.streaming.overlay is not None:
                self.controller.lay_over()
            if self._is_compiled and self._compiled.c_write(self.controller.safety.c_command) == 0:
                self._unwritten = 0
                return
            self._backend.write(self.controller.safety.command)
            self._unwritten = 0
        except BackendError as exc:
            if self._is_loose():
                return
            self._unwritten += 1
            self.controller.fault(Reason(f"writing to the robot failed: {exc}", ReasonCode.WRITING))

    cdef void c_publish(self, double robot_time_s) noexcept nogil:
        """Publish the measured values of this cycle, and the resulting command."""
        self._scalars.cycle = self._cycle
        self._scalars.robot_time_s = robot_time_s
        self._scalars.time_factor = self._clock.factor
        self.controller.c_describe(&self._scalars)
        self._state.c_heed_gripper(&self._scalars)
        self._scalars.overruns = self._clock.overruns
        self._scalars.measured_monotonic_ns = self._measured_ns
        self._scalars.monotonic_ns = monotonic_ns()
        self._state.c_publish(&self._scalars, self._measured.c_values, self.controller.safety.c_command)

    cdef void c_record(
        self, long long late_ns, long long read_ns, long long update_ns, long long write_ns, bint fresh
    ) except *:
        """Copy the published values and the durations of the cycle's phases into the recording memory."""
        cdef long long phases_ns[PHASES]
        phases_ns[0], phases_ns[1], phases_ns[2], phases_ns[3] = late_ns, read_ns, update_ns, write_ns
        self._recorder.c_heed(
            self.controller.safety,
            self.controller.reason,
            self.controller._mode,
            self._cycle,
            self._scalars.monotonic_ns,
        )
        self._recorder.c_record(self._state.block.c_data, phases_ns, fresh)
