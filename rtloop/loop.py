"""The cycle: read, update, write, publish."""

from __future__ import annotations

import time
from math import isfinite

import numpy as np

from cobot.config import Settings
from cobot.layout import Phase
from cobot.model import RobotModel
from cobot.shm import RobotMemory
from cobot.types import Array
from rtloop.backends import Backend, BackendError, Measured
from rtloop.clock import Clock
from rtloop.controller import Controller
from rtloop.publisher import StatePublisher, Statistics

END_LIMIT_S = 3.0
"""Robot time that an arm is given to come to rest before the process ends."""


class ControlLoop:
    """Runs one robot, cycle by cycle."""

    def __init__(
        self, settings: Settings, model: RobotModel, memory: RobotMemory, backend: Backend, clock: Clock
    ) -> None:
        self._period_s = settings.rt.period_s
        self._period_ns = round(settings.rt.period_s * 1e9)
        self._overruns_to_stop = settings.rt.overruns_to_stop
        self._late_in_a_row = 0
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
        self._backend.open(start_position if last is None else last["position"])
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
            self.controller.overrun(self._late_in_a_row)
        fresh = self._read()
        read_ns = time.monotonic_ns()
        if fresh:
            self._measured_ns = read_ns
        controller = self.controller
        robot_time_s = (self._cycle + 1) * self._period_s
        controller.update(self._measured, read_ns, robot_time_s, fresh=fresh)
        updated_ns = time.monotonic_ns()
        try:
            self._backend.write(controller.safety.command)
        except BackendError as exc:
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
        if not isfinite(values.dot(values)):
            self.controller.fault("the robot reports a value that is not finite")
            return False
        self._measured, self._fresh = self._fresh, self._measured
        return True


def _last_state(memory: RobotMemory) -> np.ndarray | None:
    """A copy of what a dead rtloop of the same supervisor has published last, None if there was none.

    It may have died while it published: then the positions are those of two cycles, mixed, which is
    as good.
    """
    if memory.state.sequence == 0:
        return None
    state = memory.state.salvage().copy()
    return state if np.isfinite(state["position"]).all() else None
