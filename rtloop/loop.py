"""The cycle: read, update, write, publish."""

from __future__ import annotations

import time
from math import isfinite

import numpy as np

from cobot.config import Settings
from cobot.ipc.layout import MotionResult, Phase
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import RobotMemory, encoded
from cobot.robot.model import RobotModel
from cobot.types import Array, LoopMode
from rtloop.backends import Backend, BackendError, Measured
from rtloop.clock import Clock
from rtloop.controller import Controller
from rtloop.publisher import StatePublisher, Statistics

END_LIMIT_S = 3.0
"""Robot time that an arm is given to come to rest before the process ends."""
MAX_RAD = 1e3
"""No joint gets further."""


class ControlLoop:
    """Runs one robot, cycle by cycle."""

    def __init__(
        self, settings: Settings, model: RobotModel, memory: RobotMemory, backend: Backend, clock: Clock
    ) -> None:
        self._period_s = settings.rt.period_s
        self._period_ns = round(settings.rt.period_s * 1e9)
        self._overruns_to_stop = settings.rt.overruns_to_stop
        self._pause_to_stop_ns = round(settings.rt.pause_to_stop_s * 1e9)
        self._late_in_a_row = 0
        self._frozen_to_fault = round(settings.rt.frozen_after_s / settings.rt.period_s)
        self._frozen = 0  # cycles in which the arm was moved and nothing measured has changed
        self._moving_rad_s = settings.rt.settle_velocity_rad_s
        self._square = 0.0  # of all that was measured last: a fingerprint
        self._unwritten = 0  # cycles in a row
        self._backend = backend
        self._clock = clock
        self._last = _last_state(memory)
        self.controller = Controller(settings, model, memory, backend)
        self._state = StatePublisher(memory, model, self.controller, clock)
        self._statistics = Statistics(memory)
        self._measured = Measured(model.dof)
        self._fresh = Measured(model.dof)
        self._measured_ns = 0
        self._cycle = 0

    def open(self, start_position: Array) -> None:
        """Connect to the robot and hold it where it is; a simulation begins where the last one was left.

        Raises:
            BackendError: the robot does not answer.
        """
        last = self._last
        if last is not None:
            self._cycle = int(last["cycle"])
            self.controller.restore(last)
        known = last is not None and np.isfinite(last["position"]).all()
        self._backend.open(last["position"] if last is not None and known else start_position)
        self._backend.read(self._measured)
        self._backend.enable()
        self.controller.start_at(self._measured.position)

    def step(self, late_ns: int = 0) -> None:
        """One cycle. Real-time safe; no exception leaves it but a broken program's.

        Args:
            late_ns: by how much the cycle began too late.
        """
        begun_ns = time.monotonic_ns()
        self._late_in_a_row = self._late_in_a_row + 1 if late_ns > self._period_ns else 0
        if self._late_in_a_row >= self._overruns_to_stop:
            self.controller.overrun(f"{self._late_in_a_row} cycles in a row began late")
        elif late_ns > self._pause_to_stop_ns:
            self.controller.overrun(f"a cycle began {late_ns * 1e-9:.2f} s late")
        fresh = self._read()
        read_ns = time.monotonic_ns()
        if fresh:
            self._measured_ns = read_ns
        controller = self.controller
        if fresh and self._unwritten >= self._overruns_to_stop:
            controller.let_go(self._measured.position)
        robot_time_s = (self._cycle + 1) * self._period_s
        controller.update(self._measured, read_ns, robot_time_s, fresh=fresh)
        updated_ns = time.monotonic_ns()
        try:
            self._backend.write(controller.safety.command)
            self._unwritten = 0
        except BackendError as exc:
            self._unwritten += 1
            controller.fault(f"writing to the robot failed: {exc}")
        written_ns = time.monotonic_ns()
        self._cycle += 1
        self._state.publish(self._cycle, robot_time_s, self._measured, self._measured_ns)
        statistics = self._statistics
        statistics.count(Phase.WAKEUP, late_ns)
        statistics.count(Phase.READ, read_ns - begun_ns)
        statistics.count(Phase.UPDATE, updated_ns - read_ns)
        statistics.count(Phase.WRITE, written_ns - updated_ns)
        statistics.cycle_done()
        statistics.count(Phase.TOTAL, time.monotonic_ns() - begun_ns)

    def run(self, ending: list[str]) -> None:
        """Cycle until `ending` holds a reason and the arm has come to rest."""
        end_cycle = 0
        while True:
            self.step(self._clock.wait(moving=self.controller.moving))
            if ending:
                if end_cycle == 0:
                    end_cycle = self._cycle + int(END_LIMIT_S / self._period_s)
                    self.controller.stop(ending[0])
                if not self.controller.moving or self._cycle >= end_cycle:
                    return

    def close(self) -> None:
        """Switch the drives off and let go of the robot."""
        try:
            self._backend.disable()
        finally:
            self._backend.close()

    def _read(self) -> bool:
        """Take over what is measured if it can be; False if the last good values stay."""
        try:
            self._backend.read(self._fresh)
        except BackendError as exc:
            self.controller.fault(f"reading from the robot failed: {exc}")
            return False
        values = self._fresh.values
        square = float(values.dot(values))
        if not isfinite(square):
            self.controller.fault("the robot reports a value that is not finite")
            return False
        self._measured, self._fresh = self._fresh, self._measured
        if square != self._square:
            self._square = square
            self._frozen = 0
            self.controller.stale = False
        elif not self.controller.stale and not self._unwritten:
            self._look_for_life()
        return not self.controller.stale

    def _look_for_life(self) -> None:
        """Nothing that is measured has changed, as at rest: does the arm rest?"""
        moving = np.abs(self.controller.safety.velocity).max() > self._moving_rad_s
        self._frozen = self._frozen + 1 if moving else 0
        if self._frozen >= self._frozen_to_fault:
            self.controller.stale = True
            self.controller.fault(
                f"the robot has reported the same values in {self._frozen} cycles although it is moved"
            )


def _last_state(memory: RobotMemory) -> np.ndarray | None:
    """A copy of what a dead rtloop of the same supervisor has published last, None if there was none.

    It may have died while it published: then the positions are those of two cycles, mixed, which is
    as good. What makes no sense at all is damaged: then nobody knows what was latched, so an e-stop is.
    """
    block = memory.state
    if block.sequence == 0:
        return None
    if not block.try_read() and not _makes_sense(block.salvage()):
        block.data[...] = np.zeros((), block.data.dtype)
        block.data["position"] = np.nan
        block.data["mode"] = LoopMode.ESTOP
        block.data["reason"] = encoded("the state in shared memory was damaged when rtloop was started")
        block.data["stops_seen"] = _counted(memory.requests, "stops")
        block.data["estops_seen"] = _counted(memory.requests, "estops")
        block.data["command_seen"] = _counted(memory.head, "id")
    return block.data.copy()


def _makes_sense(state: np.ndarray) -> bool:
    return (
        int(state["mode"]) in list(LoopMode)
        and int(state["motion_result"]) in list(MotionResult)
        and bool((np.abs(state["position"]) < MAX_RAD).all())
    )


def _counted(block: Block, field: str) -> int:
    return int(block.data[field]) if block.try_read() else 0
