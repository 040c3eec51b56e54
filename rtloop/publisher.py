"""What rtloop tells the world: the state of each cycle, and the statistics of all."""

from __future__ import annotations

import time

import numpy as np

from cobot.model import RobotModel
from cobot.shm import HISTOGRAM_BUCKETS, Phase, RobotMemory, encoded
from rtloop.clock import Clock
from rtloop.controller import Controller

STATISTICS_CYCLES = 500


class StatePublisher:
    """Writes the state block. Real-time safe."""

    def __init__(self, memory: RobotMemory, model: RobotModel, controller: Controller, clock: Clock) -> None:
        data = memory.state.data
        self._block = memory.state
        self._fields = {name: data[name] for name in data.dtype.names or () if name != "reason"}
        self._data = data
        self._model = model
        self._controller = controller
        self._clock = clock
        self._reason: str | None = None

    def publish(
        self, cycle: int, robot_time_s: float, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray
    ) -> None:
        """Publish what was measured in this cycle, and what the controller made of it."""
        fields, controller = self._fields, self._controller
        fields["cycle"][...] = cycle
        fields["robot_time_s"][...] = robot_time_s
        fields["mode"][...] = controller.mode
        fields["settled"][...] = controller.settled
        fields["position"][...] = position
        fields["velocity"][...] = velocity
        fields["effort"][...] = effort
        fields["commanded_position"][...] = controller.safety.position
        fields["commanded_velocity"][...] = controller.safety.velocity
        fields["commanded_acceleration"][...] = controller.safety.acceleration
        self._model.forward_into(position, fields["tcp"])
        fields["motion_id"][...] = controller.motion_id
        fields["motion_result"][...] = controller.motion_result
        fields["slot"][...] = controller.slot
        fields["path_time_s"][...] = controller.clock.path_time_s
        fields["path_duration_s"][...] = controller.path.duration_s
        fields["path_rate"][...] = controller.clock.rate
        fields["deceleration_monotonic_ns"][...] = controller.deceleration_ns
        fields["stops_seen"][...] = controller.mailbox.stops
        fields["estops_seen"][...] = controller.mailbox.estops
        fields["command_seen"][...] = controller.mailbox.command_seen
        fields["interventions"][...] = controller.safety.interventions
        fields["overruns"][...] = self._clock.overruns
        fields["torn_reads"][...] = controller.mailbox.torn_reads
        if controller.reason is not self._reason:
            self._reason = controller.reason
            self._data["reason"] = encoded(controller.reason)
        fields["monotonic_ns"][...] = time.monotonic_ns()
        self._block.publish()


class Statistics:
    """Histograms of the cycle's phases, in the statistics block. Real-time safe."""

    def __init__(self, memory: RobotMemory) -> None:
        self._block = memory.statistics
        self._histogram = memory.statistics.data["histogram"]
        self._max_us = memory.statistics.data["max_us"]
        self._cycles = 0

    def count(self, phase: Phase, duration_ns: int) -> None:
        """One more sample of a phase."""
        microseconds = duration_ns // 1000
        self._histogram[phase, min(microseconds, HISTOGRAM_BUCKETS - 1)] += 1
        if microseconds > self._max_us[phase]:
            self._max_us[phase] = microseconds

    def cycle_done(self) -> None:
        """Publish twice a second: the block is large, and its copy counts as compute time."""
        self._cycles += 1
        if self._cycles % STATISTICS_CYCLES == 0:
            self._block.data["cycles"] = self._cycles
            self._block.publish()
