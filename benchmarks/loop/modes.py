"""Compute time of a cycle in each mode, while a client streams."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from cobot_run import Run

from benchmarks.loop.cycle import WARM_UP_S, Moving, bare_cycles_us, stopped
from benchmarks.service import from_histogram, histograms, reader, service
from benchmarks.table import EACH, Row, percentiles, row
from cobot import Mode, Robot
from cobot.client import Client
from cobot.client.controls import Control
from cobot.config import load_settings
from cobot.errors import CobotError, ExecutionError
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Phase
from cobot.robot.description import load_robot
from cobot.types import LoopMode

RATE_HZ = 100
WAVE_RAD = 0.1
CIRCLE_M = 0.05
TURN_RAD_S = 1.5
LONG_US = 1000
"""A cycle that computes for so long makes the next one late."""
Feed = Callable[[float], None]


class Streamer:
    """Streams at 100 Hz from a thread. The session begins and ends with the context."""

    def __init__(self, run: Run, begin: Callable[[Robot], tuple[Control[Any], Feed]]) -> None:
        self._robot = Robot(run.memory.name.removeprefix("cobot-"), verbose=False)
        self._begin = begin
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._stream, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self._robot.close()

    def _stream(self) -> None:
        with contextlib.suppress(CobotError):  # a session that has ended is seen in the mode
            control, feed = self._begin(self._robot)
            begun_s = time.monotonic()
            with control:
                while not self._end.wait(1.0 / RATE_HZ):
                    feed(time.monotonic() - begun_s)


def _joints(interpolation: str, robot: Robot) -> tuple[Control[Any], Feed]:
    robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
    control = robot.start_joint_impedance_control(RATE_HZ, interpolation=interpolation)
    home = np.array(control.get_state().q)
    return control, lambda t: control.set_target_joints(home + WAVE_RAD * (1.0 - np.cos(TURN_RAD_S * t)))


def _poses(robot: Robot) -> tuple[Control[Any], Feed]:
    robot.switch_mode(Mode.RT_CARTESIAN_MOTION_FORCE)
    control = robot.start_cartesian_control(RATE_HZ)
    pose = np.array(control.get_state().tcp_pose)

    def feed(time_s: float) -> None:
        turn = TURN_RAD_S * time_s
        offset = CIRCLE_M * np.array([np.cos(turn) - 1.0, np.sin(turn) * min(time_s, 1.0), 0.0])
        control.set_target_pose(np.concatenate([pose[:3] + offset, pose[3:]]))

    return control, feed


def _forces(robot: Robot) -> tuple[Control[Any], Feed]:
    """Command zero force along z in free space, where the arm stays in its place."""
    robot.set_force_control_axis([False, False, True, False, False, False])
    return _poses(robot)


def _torques(robot: Robot) -> tuple[Control[Any], Feed]:
    """Torques that swing the first joint back and forth."""
    robot.switch_mode(Mode.RT_JOINT_TORQUE)
    control = robot.start_joint_torque_control()
    mass = load_robot(load_settings(None)).model.mass_matrix(np.array(control.get_state().q))
    torques = WAVE_RAD * TURN_RAD_S**2 * mass[0]
    return control, lambda t: control.set_target_torques(torques * np.cos(TURN_RAD_S * t))


AIMS = {
    "HOLD": "1.5 / 1.5 / 1.5",
    "TRAJECTORY": "2 / 2 / 2",
    "JOINT_IMPEDANCE, linear": "2 / 2 / 2",
    "JOINT_IMPEDANCE, ruckig": "2 / 2 / 2",
    "CARTESIAN": "2.5 / 2.5 / 2.5",
    "CARTESIAN with a force axis": "3 / 3 / 3",
    "JOINT_TORQUE": "2 / 2 / 2",
}
"""The total of a cycle by that of the bare loop."""
SESSIONS: dict[str, tuple[LoopMode, Callable[[Robot], tuple[Control[Any], Feed]]]] = {
    "JOINT_IMPEDANCE, linear": (LoopMode.JOINT_IMPEDANCE, lambda robot: _joints("linear", robot)),
    "JOINT_IMPEDANCE, ruckig": (LoopMode.JOINT_IMPEDANCE, lambda robot: _joints("ruckig", robot)),
    "CARTESIAN": (LoopMode.CARTESIAN, _poses),
    "CARTESIAN with a force axis": (LoopMode.CARTESIAN, _forces),
    "JOINT_TORQUE": (LoopMode.JOINT_TORQUE, _torques),
}


def modes(slices: int, slice_s: float) -> Iterator[Row]:
    """Measure all modes in turn, each followed by a slice of the bare loop, and then all modes again."""
    counts = {name: np.zeros(HISTOGRAM_BUCKETS, np.int64) for name in ("HOLD", "TRAJECTORY", *SESSIONS)}
    missed = dict.fromkeys(counts, 0)
    floor: list[float] = []

    def measure(name: str, mode: LoopMode | None) -> None:
        """Measure a slice of the mode, and immediately afterwards a slice of the floor."""
        time.sleep(WARM_UP_S)
        before, overruns = histograms(memory)[Phase.TOTAL], int(memory.state.read()["overruns"])
        time.sleep(slice_s)
        counts[name] += histograms(memory)[Phase.TOTAL] - before
        state = memory.state.read()
        missed[name] += int(state["overruns"]) - overruns
        if mode is not None and state["mode"] != mode:
            raise ExecutionError(f"{name}: the mode is {LoopMode(int(state['mode'])).name}")
        with stopped(run):
            floor.extend(bare_cycles_us(slice_s / len(counts)))

    with service() as run:
        memory = reader(run)
        for _ in range(slices):
            go_home(run)
            measure("HOLD", LoopMode.HOLD)
            with Moving(run):
                measure("TRAJECTORY", None)
            for name, (mode, begin) in SESSIONS.items():
                go_home(run)
                with Streamer(run, begin):
                    measure(name, mode)
    interrupted = int((np.array(floor) >= LONG_US).sum())
    for name, counted in counts.items():
        yield row(
            f"compute time a cycle, {name}; {missed[name]} periods missed, "
            f"{counted[LONG_US:].sum()} of {counted.sum()} cycles took 1 ms",
            "µs",
            from_histogram(counted),
            f"bare loop: Ruckig, mj_step, copy; {interrupted} of {len(floor)} cycles took 1 ms",
            percentiles(floor),
            ratio_of=EACH,
            aim=AIMS[name],
        )


def go_home(run: Run) -> None:
    """Move home. Works while the arm is still braking because rtloop was silent during a motion."""
    with Client(run.url, motion_timeout_s=30.0) as client:
        client.stop()
        client.move_named("home", speed=0.5)
