"""FANUC's Stream Motion: how soon a controller has its answer from the whole cycle; what faults cost.

The controller is ours, in another process with SCHED_FIFO above rtloop's. That the backend drives one that
nobody here wrote is in the tests.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from crx_arm import POSITIONS, crx_folder
from fanuc_run import ControllerProcess, RunOverFanuc

from benchmarks.backends.driven import (
    PRIORITY,
    SPOILED,
    WARM,
    Driven,
    Faults,
    Times,
    Words,
    answer_rows,
    driven,
    floor_of,
)
from benchmarks.service import background
from benchmarks.table import Row, row
from cobot.config import SETTINGS_FILE

PERIODS_MS = (8, 1)
WORDS = Words("packet", "answer", "controller", "commands")
PROGRAM_MS = 40.0
"""Time after which the program of the simulated controller runs."""
HOME = np.radians(POSITIONS["home"]).tolist()
GOAL = np.radians([-30.0, 10.0, -10.0, 10.0, -60.0, 60.0]).tolist()
FAULTS: Faults = {
    "an emergency stop": ({"e_stop": True}, {"e_stop": False}),
    "an open fence": ({"fence": True}, {"fence": False}),
    "a collision": ({"collision": True}, {"collision": False}),
    "a change of the operation mode": ({"mode": "T1"}, {"mode": "AUTO"}),
    "a contact stop": ({"contact_stop": 2}, {"contact_stop": 1}),
    "a pulled cable": ({"loss": 1.0}, {"loss": 0.0}),
    "90 % of loss": ({"loss": 0.9}, {"loss": 0.0}),
    "a closed connection of RMI and an alarm": ({"close": True, "alarm": "SRVO-023 Stop error"}, {}),
    **SPOILED,
}
"""Each in the middle of a motion, with what ends it."""


def fanuc(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Answer times during motion at each period, next to those of an echo; then lost packets, derivatives and
    recoveries.
    """
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        arm = crx_folder(Path(folder)) / SETTINGS_FILE
        for period_ms in PERIODS_MS:
            count = max(answers * PERIODS_MS[-1] // period_ms, WARM)
            floor = _floor(arm, period_ms, count)
            name = f"FANUC at {period_ms} ms"
            state = yield from answer_rows(name, WORDS, robot(arm, period_ms), count, floor)
            yield _peaks_row(period_ms, state)
        with robot(arm, PERIODS_MS[0]) as made:
            yield made.moves_row(moves)
            until = "the program of the simulated controller"
            yield from made.recovery_rows(FAULTS, repetitions, until, PROGRAM_MS)


@contextlib.contextmanager
def robot(arm: Path, period_ms: int) -> Iterator[Driven]:
    """A controller that does not wait for late answers, and the service."""
    with (
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
        _punctual(arm, period_ms) as controller,
    ):
        ports = controller.stream_port, controller.rmi_port
        run = RunOverFanuc(Path(folder), arm, *ports, period_ms=period_ms, silence_s=0.1)
        with driven("FANUC", controller, run, (GOAL, HOME)) as made:
            yield made


def _punctual(arm: Path, period_ms: int) -> ControllerProcess:
    """A controller that does not wait for late answers."""
    return ControllerProcess(arm, "--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0)


def _floor(arm: Path, period_ms: int, answers: int) -> tuple[Times, float]:
    with (
        _punctual(arm, period_ms) as controller,
        background("benchmarks.backends.bare_fanuc", str(controller.stream_port), str(controller.rmi_port)),
    ):
        return floor_of(controller, WORDS.count, answers, period_ms)


def _peaks_row(period_ms: int, state: dict[str, Any]) -> Row:
    peaks = tuple(max(state["peaks"][rate]) for rate in ("velocity", "acceleration", "jerk"))
    return row(
        f"FANUC at {period_ms} ms: largest share of the controller's limits that commands have used",
        "",
        peaks,
        "the controller's alarm",
        (1.01,) * 3,
        columns=("velocity", "acceleration", "jerk"),
        aim="below 1",
    )
