"""Servo modes: the time from a point to the first cycle that it changes, and the tracking of the same
reference.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.loop.modes import go_home
from benchmarks.service import reader, service
from benchmarks.streams.latency import PAUSE_S, STEP_RAD, changed_ns, echoed
from benchmarks.table import Row, percentiles, row
from benchmarks.virtual import MOVED, eased, rig
from cobot.errors import UnavailableError
from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.ipc.session_rules import nominal_session
from cobot.ipc.shm import RobotMemory
from cobot.ipc.stream_writer import PointWriter, StreamWriter
from cobot.types import Array

FORCE_MODES = (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)
MODES = [mode for mode in ServoMode if mode is not ServoMode.NONE]
EVERY = 10
LAW = (0.1, 200.0)
RISE_S = 2.0
MAX_LAG = 600
ANSWER_S = 2.0
COLUMNS = ("RMS error, mrad", "lag, ms", "RMS jerk, rad/s³")


def servo(repetitions: int, duration_s: float) -> Iterator[Row]:
    """Latency of single points sent at rest, then tracking of a stream at 100 Hz."""
    random = np.random.default_rng(6)
    with service() as run:
        memory = reader(run)
        floor = percentiles(echoed(repetitions, random))
        for mode in MODES:
            go_home(run)
            yield row(
                f"servo mode {mode}: a point to the first commanded position that it changes",
                "ms",
                percentiles(_latencies(memory, mode, repetitions, random)),
                "bare loop at 1 kHz that answers a block",
                floor,
            )
    for mode in MODES:
        for law in ((0.0, 0.0), LAW) if 2 <= mode <= 4 else ((0.0, 0.0),):
            every = 1 if mode is ServoMode.BUFFERED_1MS else EVERY
            yield row(
                f"servo mode {mode}, {1000 // every} Hz" + (", lookahead 0.1 s, gain 200" if law[0] else ""),
                "",
                _tracking(mode, every, law, duration_s),
                "mode 1",
                _tracking(ServoMode.REPLANNED, EVERY, (0.0, 0.0), duration_s),
                columns=COLUMNS,
            )


def _latencies(memory: RobotMemory, mode: ServoMode, count: int, random: np.random.Generator) -> list[float]:
    """Milliseconds from each point to the publication of the first changed cycle."""
    stream, points = StreamWriter(memory), PointWriter(memory)
    request = nominal_session(memory.info.read())
    request["stream"] = Stream.CARTESIAN if mode in FORCE_MODES else Stream.JOINT_IMPEDANCE
    request["interpolation"], request["decimation"] = Interpolation.NONE, 1
    request["servo_mode"], request["watchdog_s"] = mode, 5.0
    number = stream.begin(request, int(memory.requests.read()["stops"]))
    try:
        _wait_for(memory, stream, number)
        points.begin(number)
        delays = []
        joints = memory.state.read()["commanded_position"].copy()
        for index in range(count):
            time.sleep(random.uniform(*PAUSE_S))
            before = float(memory.state.read()["commanded_position"][0])
            joints[0] += -STEP_RAD if index % 2 else STEP_RAD
            begun_ns = time.monotonic_ns()
            points.put(joints.tolist(), 1e-3, 0.0, 0.0)
            delays.append((changed_ns(memory, before) - begun_ns) / 1e6)
        return delays
    finally:
        stream.end()
        _wait_for(memory, stream, 0)
        stream.release()


def _wait_for(memory: RobotMemory, stream: StreamWriter, number: int) -> None:
    """Wait until the session has begun, or for mode 0 until it has ended."""
    deadline_s = time.monotonic() + ANSWER_S
    while int(memory.state.read()["session"]) != number:
        if (refusal := stream.answer(number)) or time.monotonic() > deadline_s:
            raise UnavailableError(f"no servo session: {refusal or 'no answer'}")
        time.sleep(1e-3)


def _path(time_s: Array | float) -> Array:
    """The reference position of a joint, rad from home. Its speed is at most 0.3 rad/s."""
    return np.asarray(0.1 * eased(time_s, RISE_S) * np.sin(0.8 * np.pi * np.asarray(time_s)))


def _tracking(
    mode: ServoMode, every: int, law: tuple[float, float], duration_s: float
) -> tuple[float, float, float]:
    """The tracking error at the delay for which joint 1 fits the path best, this delay, and the jerk."""
    cycles = round(duration_s * 1000)
    with rig() as arm:
        stream = Stream.CARTESIAN if mode in FORCE_MODES else Stream.JOINT_IMPEDANCE
        refusal = arm.stream(stream, servo_mode=mode, watchdog_s=0.5)
        assert not refusal, refusal
        points = PointWriter(arm.memory)
        points.begin(int(arm.memory.session.data["number"]))
        for cycle in range(cycles):
            if cycle % every == 0:
                points.put(arm.home + MOVED * _path(cycle * 1e-3), every * 1e-3, *law)
            arm.step()
        joint = np.array(arm.commanded)[-cycles:, 0] - arm.home[0]
    past = round(RISE_S * 1000) + MAX_LAG
    times_s: Array = 1e-3 * np.arange(cycles, dtype=np.float64)
    errors = [
        float(np.sqrt(np.mean((joint - _path(times_s - lag * 1e-3))[past:] ** 2))) for lag in range(MAX_LAG)
    ]
    jerk = np.diff(joint, 3)[past:] / 1e-9
    lag = int(np.argmin(errors))
    return 1e3 * errors[lag], float(lag), float(np.sqrt(np.mean(jerk**2)))
