"""What rtloop tells the world: the state of each cycle, and the statistics of all."""

from __future__ import annotations

import time

import numpy as np

from cobot.ipc.layout import HISTOGRAM_BUCKETS, STATE_STRUCT, Phase
from cobot.ipc.shm import RobotMemory, encoded
from cobot.robot.model import RobotModel
from cobot.types import Array
from rtloop.backends import JOINT_ROWS, Measured
from rtloop.clock import Clock
from rtloop.controller import Controller

STATISTICS_CYCLES = 500
EFFORT_RATE_S = 0.01
"""Time constant of the effort's derivative."""


class StatePublisher:
    """Writes the state block. Real-time safe."""

    def __init__(self, memory: RobotMemory, model: RobotModel, controller: Controller, clock: Clock) -> None:
        data = memory.state.data
        dof = len(data["position"])
        self._block = memory.state
        self._data = data
        self._bytes = memory.state.buffer
        # What is measured stands together, and so do the three commanded rows.
        values = JOINT_ROWS * dof + 12
        self._measured = np.ndarray(values, np.float64, self._bytes, _offset(data, "position"))
        self._commanded = np.ndarray((3, dof), np.float64, self._bytes, _offset(data, "commanded_position"))
        self._tcp = data["tcp"]
        self._tcp_velocity = data["tcp_velocity"]
        self._effort_rate = data["effort_rate"]
        self._effort_change = np.zeros(dof)
        self._effort = np.zeros(dof)
        self._smoothing = memory.period_s / EFFORT_RATE_S
        self._per_period = 1.0 / memory.period_s
        self._model = model
        self._controller = controller
        self._clock = clock
        self._reason: str | None = None
        self._counted = -1

    def publish(self, cycle: int, robot_time_s: float, measured: Measured, measured_ns: int) -> None:
        """Publish what was measured in this cycle, and what the controller made of it.

        Args:
            measured_ns: CLOCK_MONOTONIC when it was read.
        """
        controller = self._controller
        commands, path_clock, streaming = controller.commands, controller.clock, controller.streaming
        np.copyto(self._measured, measured.values)
        np.copyto(self._commanded, controller.safety.command)
        if controller.safety.counted != self._counted:
            self._counted = controller.safety.counted
            self._data["interventions"] = controller.safety.interventions
            self._data["intervened_ns"] = controller.safety.intervened_ns
        self._model.forward_into(measured.position, self._tcp)
        self._model.velocity_into(measured.velocity, self._tcp_velocity)
        self._smooth_effort_rate(measured.effort)
        if controller.reason is not self._reason:
            self._reason = controller.reason
            self._data["reason"] = encoded(controller.reason)
        STATE_STRUCT.pack_into(
            self._bytes.data,
            0,
            cycle,
            robot_time_s,
            controller.mode,
            controller.settled,
            controller.motion_id,
            controller.motion_result,
            controller.slot,
            path_clock.path_time_s,
            controller.path.duration_s,
            path_clock.rate,
            controller.deceleration_ns,
            commands.stops,
            commands.estops,
            commands.command_seen,
            streaming.session,
            streaming.setpoint_seen,
            streaming.move_seen,
            streaming.move_running,
            streaming.chunk_seen,
            *streaming.point_counts,
            self._clock.overruns,
            commands.torn_reads + streaming.torn_reads,
            time.monotonic_ns(),
            measured_ns,
        )
        self._block.publish()

    def _smooth_effort_rate(self, effort: Array) -> None:
        change = self._effort_change
        np.subtract(effort, self._effort, out=change)
        np.copyto(self._effort, effort)
        change *= self._per_period
        change -= self._effort_rate
        change *= self._smoothing
        self._effort_rate += change


class Statistics:
    """Histograms of the cycle's phases, in the statistics block. Real-time safe."""

    def __init__(self, memory: RobotMemory) -> None:
        self._block = memory.statistics
        self._info = memory.info
        self._counts = [memoryview(row) for row in memory.statistics.data["histogram"]]
        self._max_us = [0] * len(Phase)
        self._cycles = 0

    def count(self, phase: Phase, duration_ns: int) -> None:
        """One more sample of a phase."""
        microseconds = duration_ns // 1000
        self._counts[phase][microseconds if microseconds < HISTOGRAM_BUCKETS else -1] += 1
        if microseconds > self._max_us[phase]:
            self._max_us[phase] = microseconds

    def cycle_done(self) -> None:
        """Publish twice a second: the block is large, and its copy counts as compute time.

        So is what robot this is, although it stays the same: what a wild writer has spoilt is mended.
        """
        self._cycles += 1
        if self._cycles % STATISTICS_CYCLES == 0:
            self._block.data["cycles"] = self._cycles
            self._block.data["max_us"] = self._max_us
            self._block.publish()
            self._info.publish()


def _offset(record: np.ndarray, field: str) -> int:
    fields = record.dtype.fields
    assert fields is not None
    return int(fields[field][1])
