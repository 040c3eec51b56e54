"""The update phase without sleep: computing time of the controller with warm caches, in each mode."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
import ruckig
from rig import Rig

from benchmarks.service import from_histogram, histograms
from benchmarks.table import Row, percentiles, row
from benchmarks.virtual import MOVED, eased, rig
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Interpolation, Phase, ServoMode, Stream
from cobot.ipc.stream_writer import PointWriter
from cobot.planners import MotionRequest, plan
from cobot.types import Array, PlannerName, Scaling
from rtloop.publisher import STATISTICS_CYCLES

CYCLES = 8 * STATISTICS_CYCLES
WARM_UP = 2 * STATISTICS_CYCLES
EVERY = 10
"""Cycles between two targets: a client of 100 Hz."""
FORCE = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
Feed = Callable[[Rig, float], None]


def hot(repetitions: int) -> Iterator[Row]:
    """Time of one update in each mode, µs, next to one update of Ruckig for seven joints."""
    floor = _ruckig_us()
    for name, begin in MODES.items():
        counts = np.zeros(HISTOGRAM_BUCKETS, np.int64)
        for _ in range(repetitions):
            with rig(simulated=True) as arm:
                feed = begin(arm)
                _run(arm, feed, 0, WARM_UP)
                before = _update_counts(arm)
                _run(arm, feed, WARM_UP, CYCLES)
                counts = counts + _update_counts(arm) - before
        yield row(
            f"update of a cycle, hot, {name}",
            "µs",
            from_histogram(counts),
            "Ruckig alone, seven joints, from Python",
            floor,
            aim="10 µs",
        )


def _update_counts(arm: Rig) -> np.ndarray:
    """The published counts. They are exact after every `STATISTICS_CYCLES`."""
    counts: np.ndarray = histograms(arm.memory)[Phase.UPDATE]
    return counts


def _run(arm: Rig, feed: Feed, begin: int, cycles: int) -> None:
    for cycle in range(begin, begin + cycles):
        if cycle % EVERY == 0:
            feed(arm, cycle * 1e-3)
        arm.loop.step()


def _ruckig_us() -> tuple[float, float, float]:
    generator = ruckig.Ruckig(7, 1e-3)
    problem, output = ruckig.InputParameter(7), ruckig.OutputParameter(7)
    problem.max_velocity, problem.max_acceleration, problem.max_jerk = [1.0] * 7, [5.0] * 7, [50.0] * 7
    durations = []
    for number in range(CYCLES):
        problem.target_position = [0.5 + 0.1 * np.sin(0.01 * number)] * 7
        begun_ns = time.perf_counter_ns()
        try:
            generator.update(problem, output)
        except ruckig.RuckigError:  # It loses its way once in thousands of moving targets: from rest again.
            problem.current_velocity = problem.current_acceleration = [0.0] * 7
            continue
        durations.append((time.perf_counter_ns() - begun_ns) / 1000)
        output.pass_to_input(problem)
    return percentiles(durations)


def _wave(arm: Rig, time_s: float) -> Array:
    joints: Array = arm.home + 0.1 * eased(time_s, 1.0) * np.sin(np.pi * time_s) * MOVED
    return joints


def _rest(arm: Rig) -> Feed:
    return lambda arm, time_s: None


def _planned(arm: Rig) -> Feed:
    goal = np.array(arm.robot.positions["work"].joints)
    trajectory = plan(arm.robot, MotionRequest(arm.home, goal, PlannerName.PTP, Scaling(0.1)))
    assert trajectory is not None
    refusal = arm.start(trajectory)
    assert not refusal, refusal
    return lambda arm, time_s: None


def _joints(interpolation: Interpolation) -> Callable[[Rig], Feed]:
    def begin(arm: Rig) -> Feed:
        refusal = arm.stream(interpolation=interpolation, decimation=EVERY)
        assert not refusal, refusal
        return lambda arm, time_s: arm.aim(joints=_wave(arm, time_s))

    return begin


def _poses(force_axes: list[float]) -> Callable[[Rig], Feed]:
    def begin(arm: Rig) -> Feed:
        refusal = arm.stream(Stream.CARTESIAN, decimation=EVERY, force_axes=force_axes)
        assert not refusal, refusal
        here = np.zeros(7)
        arm.robot.model.forward_into(arm.home, here)

        def feed(arm: Rig, time_s: float) -> None:
            offset = (
                0.05 * eased(time_s, 1.0) * np.array([np.cos(1.5 * time_s) - 1.0, np.sin(1.5 * time_s), 0.0])
            )
            arm.aim(pose=np.concatenate([here[:3] + offset, here[3:]]))

        return feed

    return begin


def _torques(arm: Rig) -> Feed:
    refusal = arm.stream(Stream.JOINT_TORQUE, decimation=1)
    assert not refusal, refusal
    mass = arm.robot.model.mass_matrix(arm.home)[0]
    return lambda arm, time_s: arm.aim(joints=0.2 * mass * np.cos(1.5 * time_s))


def _servo(mode: ServoMode) -> Callable[[Rig], Feed]:
    def begin(arm: Rig) -> Feed:
        refusal = arm.stream(servo_mode=mode, watchdog_s=10.0)
        assert not refusal, refusal
        writer = PointWriter(arm.memory)
        writer.begin(int(arm.memory.session.data["number"]))

        def feed(arm: Rig, time_s: float) -> None:
            writer.put(_wave(arm, time_s), EVERY * 1e-3, 0.0, 0.0)

        return feed

    return begin


MODES: dict[str, Callable[[Rig], Feed]] = {
    "HOLD": _rest,
    "TRAJECTORY": _planned,
    "JOINT_IMPEDANCE, linear": _joints(Interpolation.LINEAR),
    "JOINT_IMPEDANCE, quintic": _joints(Interpolation.QUINTIC),
    "JOINT_IMPEDANCE, ruckig": _joints(Interpolation.RUCKIG),
    "CARTESIAN": _poses([0.0] * 6),
    "CARTESIAN with a force axis": _poses(FORCE),
    "JOINT_TORQUE": _torques,
    "servo mode 1": _servo(ServoMode.REPLANNED),
    "servo mode 3": _servo(ServoMode.BUFFERED),
    "servo mode 5": _servo(ServoMode.THROUGH),
}
