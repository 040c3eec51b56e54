"""Insertions of a peg with 0.2 mm of clearance, from random places and directions, on virtual time.

Oracle: the peg's body in MuJoCo, which is to be in the hole, however the service reports it.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from physical_cell import EXAMPLE
from plant_service import ServiceOfPlant

from benchmarks.table import Row, row
from cobot.types import Array

CELL = EXAMPLE.parent / "insert_peg"
HOLE = np.array([0.55, 0.15, 0.23])
"""Middle of the hole's upper edge."""
HALF_PEG_M = 0.035
TCP_M = 0.155
"""The TCP is at the lower end of the peg, this far from the flange."""
OFF_M, OFF_RAD = 0.002, math.radians(2.0)
"""Range of each offset: along x and y, and about x and y."""
DEPTH_M = 0.02
SLACK_M = 0.001
"""The peg is in the hole when its end is so near to the depth."""
MAX_TIME_S = 30.0
INSERT: dict[str, Any] = {
    "force": 12.0,
    "max_force": 60.0,
    "depth": DEPTH_M,
    "radius": 0.004,
    "pitch": 0.0008,
    "search_speed": 0.005,
    "drop": 0.001,
    "max_time_s": MAX_TIME_S,
}


@dataclass(frozen=True)
class Insertion:
    """How an insertion ended.

    Attributes:
        is_in: whether the peg is in the hole.
    """

    is_in: bool
    duration_s: float
    max_force_n: float


def insertions(count: int) -> Iterator[Row]:
    """Grasp the peg, then insert it, starting above the hole with random offsets."""
    random = np.random.default_rng(28)
    with (
        tempfile.TemporaryDirectory() as folder,
        ServiceOfPlant(Path(folder), of_robot=f"cell: {CELL}").serving() as run,
    ):
        assert isinstance(run, ServiceOfPlant)
        run.until(lambda: run.get("/robot/gripper").json()["connected"])
        run.post("/robot/tool", {"tcp": {"z": TCP_M}}).raise_for_status()
        found = [_insert(run, *random.uniform(-1.0, 1.0, (2, 2))) for _ in range(count)]
    inside = [each for each in found if each.is_in]
    yield row(
        f"peg with 0.2 mm of clearance, ±{1e3 * OFF_M:g} mm and ±{math.degrees(OFF_RAD):g}° off: inserted",
        "of all, % / median, s / median of the largest forces, N",
        (
            100.0 * len(inside) / count,
            float(np.median([each.duration_s for each in found])),
            float(np.median([each.max_force_n for each in found])),
        ),
        f"all of {count}, the time that is allowed, the force asked for",
        (100.0, MAX_TIME_S, INSERT["force"]),
        columns=("inserted, %", "s", "largest force, N"),
        aim="≥ 95 %",
    )


def _insert(run: ServiceOfPlant, off: Array, lean: Array) -> Insertion:
    _grasp(run)
    x, y, z = HOLE + np.array([*(OFF_M * off), 0.004])
    place = {"x": x, "y": y, "b": math.pi + OFF_RAD * lean[0], "c": OFF_RAD * lean[1]}
    _do(run, "/robot/move/pose", {**place, "z": z + 0.05, "speed": 1.0})
    _do(run, "/robot/move/pose", {**place, "z": z, "planner": "lin", "speed_m_s": 0.1})
    run.sleep(0.5)
    answer = run.post("/robot/force/insert", INSERT).json()
    depth_m = HOLE[2] - _end_of_peg(run)[2]
    return Insertion(depth_m > DEPTH_M - SLACK_M, answer["duration_s"], answer["max_force_n"])


def _grasp(run: ServiceOfPlant) -> None:
    """Put the peg back in its place, and grasp it."""
    _do(run, "/robot/gripper/release", {})
    run.go_home()
    run.post("/cell/reset").raise_for_status()
    peg = {"x": 0.5, "y": -0.2, "b": math.pi}
    _do(run, "/robot/move/pose", {**peg, "z": 0.3, "speed": 1.0})
    _do(run, "/robot/move/pose", {**peg, "z": 0.2, "planner": "lin", "speed_m_s": 0.2})
    _do(run, "/robot/gripper/grasp", {"width": 0.014, "force": 200.0})
    _do(run, "/robot/move/pose", {**peg, "z": 0.3, "planner": "lin", "speed_m_s": 0.2})


def _do(run: ServiceOfPlant, path: str, body: dict[str, Any]) -> None:
    answer = run.post(path, body).json()
    assert answer.get("success"), f"{path} {body}: {answer}"


def _end_of_peg(run: ServiceOfPlant) -> Array:
    """The position of the peg's end according to MuJoCo, in the base frame, which is the world frame here."""
    body, data = run.plant.plant.parts[0], run.plant._plant_data
    down: Array = data.xpos[body] - HALF_PEG_M * data.xmat[body].reshape(3, 3)[:, 2]
    return down
