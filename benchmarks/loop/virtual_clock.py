"""The speed of the loop and its simulation without waiting for a clock, compared with real time."""

from __future__ import annotations

import time
from collections.abc import Iterator

import mujoco
import numpy as np

from benchmarks.table import Row, row
from benchmarks.virtual import MOVED, eased, rig
from cobot.config import load_settings
from cobot.ipc.layout import Interpolation
from cobot.planners import MotionRequest, plan
from cobot.robot.description import load_robot
from cobot.types import PlannerName, Scaling
from rtloop.loop import ControlLoop

STREAM_CYCLES = 3000
COLUMNS = ("median", "slowest", "fastest")


def factor(repetitions: int) -> Iterator[Row]:
    """Seconds of robot time per second for a planned motion and for a stream, in turn with MuJoCo alone."""
    planned, streamed, bare = [], [], []
    for _ in range(repetitions):
        planned.append(_planned())
        streamed.append(_streamed())
        bare.append(_bare())
    for name, factors in (("ptp", planned), ("stream of 100 Hz, ruckig", streamed)):
        yield row(
            f"virtual clock, robot seconds per second: {name}",
            "",
            _spread(factors),
            "mj_step alone",
            _spread(bare),
            columns=COLUMNS,
        )


def _planned() -> float:
    with rig(simulated=True) as arm:
        goal = np.array(arm.robot.positions["work"].joints)
        trajectory = plan(arm.robot, MotionRequest(arm.home, goal, PlannerName.PTP, Scaling(0.2)))
        refusal = arm.start(trajectory)
        assert not refusal, refusal
        return _timed(arm.loop, round(1000 * trajectory.duration_s))


def _streamed() -> float:
    with rig(simulated=True) as arm:
        refusal = arm.stream(interpolation=Interpolation.RUCKIG, decimation=10)
        assert not refusal, refusal
        times_s = np.arange(0.0, STREAM_CYCLES * 1e-3, 0.01)
        wave = 0.1 * eased(times_s, 1.0) * np.sin(np.pi * times_s)
        begun_s = time.perf_counter()
        for offset in wave:
            arm.aim(joints=arm.home + offset * MOVED)
            for _ in range(10):
                arm.loop.step()
        return STREAM_CYCLES * 1e-3 / (time.perf_counter() - begun_s)


def _timed(loop: ControlLoop, cycles: int) -> float:
    begun_s = time.perf_counter()
    for _ in range(cycles):
        loop.step()
    return cycles * 1e-3 / (time.perf_counter() - begun_s)


def _bare() -> float:
    model = load_robot(load_settings(None)).model.mj
    data = mujoco.MjData(model)
    begun_s = time.perf_counter()
    for _ in range(STREAM_CYCLES):
        mujoco.mj_step(model, data)
    return STREAM_CYCLES * 1e-3 / (time.perf_counter() - begun_s)


def _spread(factors: list[float]) -> tuple[float, float, float]:
    return float(np.median(factors)), min(factors), max(factors)
