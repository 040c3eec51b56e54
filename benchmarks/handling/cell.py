"""The simulated cell: its cost per cycle, and whether a grasp survives transports at full speed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from physical_cell import EXAMPLE, CellArm

from benchmarks.table import Row, percentiles, row
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.robot.description import load_robot
from cobot.types import Array
from rtloop.backends import Measured, make_backend

LOST_M = 0.02
"""A part that has moved so far in the hand counts as lost."""
SPREAD_RAD = np.array([0.9, 0.36, 0.36, 0.36, 0.48, 0.36, 1.2])
PARTS = ("cube", "can")


def step(slices: int, cycles: int) -> Iterator[Row]:
    """Time of one step of the simulation with one held part and two parts at rest, in slices that alternate
    with those of the bare arm.
    """
    settings = load_settings(None)
    held = CellArm(settings, load_robot(settings), EXAMPLE)
    held.pick("cube")
    limits = load_robot(settings).limits
    bare = make_backend(settings, limits)
    bare.open(held.joints)
    command = np.zeros((3, limits.dof))
    command[0] = held.joints
    found: dict[str, list[float]] = {"cell": [], "bare": []}
    for _ in range(slices):
        found["cell"] += _steps_us(held.backend, command, cycles)
        found["bare"] += _steps_us(bare, command, cycles)
    yield row(
        "simulation step with a held part and two at rest",
        "µs",
        percentiles(found["cell"]),
        "the bare arm's step",
        percentiles(found["bare"]),
    )


def _steps_us(backend: Any, command: Array, cycles: int) -> list[float]:
    measured, times = Measured(command.shape[1]), []
    for _ in range(cycles):
        begin_ns = time.perf_counter_ns()
        backend.try_write(command)
        backend.try_read(measured)
        times.append(1e-3 * (time.perf_counter_ns() - begin_ns))
    return times


def transports(count: int) -> Iterator[Row]:
    """Random ptp motions at full speed with a part that is held with 40 N: the distance by which the part
    slips in the hand.
    """
    settings = load_settings(None)
    rng = np.random.default_rng(28)
    for part in PARTS:
        arm = CellArm(settings, load_robot(settings), EXAMPLE)
        arm.pick(part)
        home = np.array(arm.robot.positions["home"].joints)
        before = arm.part_in_tcp(part).position
        shifts_mm: list[float] = []
        while len(shifts_mm) < count:
            try:
                arm.go(home + rng.uniform(-1.0, 1.0, len(home)) * SPREAD_RAD)
            except CobotError:  # a goal in collision
                continue
            shifts_mm.append(1e3 * float(np.linalg.norm(arm.part_in_tcp(part).position - before)))
            if shifts_mm[-1] > 1e3 * LOST_M:
                break
        survived = sum(shift < 1e3 * LOST_M for shift in shifts_mm)
        yield row(
            f"{part} held by 40 N survives {survived} of {count} transports at full speed; shift in the hand",
            "mm",
            percentiles(shifts_mm),
            "counts as lost",
            (1e3 * LOST_M,) * 3,
        )
