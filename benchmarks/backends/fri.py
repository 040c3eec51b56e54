"""KUKA's FRI: how soon a cabinet has its answer, with the whole cycle behind it; what faults cost."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

from fri_run import CabinetProcess, RunOverFri

from benchmarks.backends.derivatives import commands_row
from benchmarks.backends.driven import (
    PRIORITY,
    Driven,
    Faults,
    Times,
    answer_row,
    driven,
    floor_of,
    punctual_row,
)
from benchmarks.loop.idle import busy
from benchmarks.service import background
from benchmarks.table import Row
from cobot.config import load_settings

PERIODS_MS = (5, 2, 1)
COUNT = "answered"
"""Name of the cabinet's count of answers in time."""
GOAL = [0.5, 0.2, 0.0, -1.4, 0.0, 1.4, 0.2]
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
FAULTS: Faults = {
    "an emergency stop": ({"safety_stop": 0}, {"safety_stop": -1}),
    "a safety stop": ({"safety_stop": 1}, {"safety_stop": -1}),
    "a change of the operation mode": ({"mode": "T2"}, {"mode": "AUT"}),
    "a closed session": ({"close": True}, {}),
    "90 % of loss": ({"loss": 0.9}, {"loss": 0.0}),
    "answers three periods late": ({"delay": 3}, {"delay": 0}),
    "a pulled cable": ({"loss": 1.0}, {"loss": 0.0}),
    "values that are not numbers": ({"spoil": "nan"}, {"spoil": ""}),
    "values that never change": ({"spoil": "frozen"}, {"spoil": ""}),
}
"""Each in the middle of a motion, with what ends it."""


@contextlib.contextmanager
def robot(period_ms: int) -> Iterator[Driven]:
    """A cabinet without patience, and the service."""
    with (
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
        CabinetProcess("--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0) as cabinet,
        driven("FRI", cabinet, RunOverFri(Path(folder), cabinet, period_ms=period_ms), (GOAL, HOME)) as made,
    ):
        yield made


def fri(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Derivatives; answers at each period in motion, alone and beside two busy loops; losses, recoveries."""
    yield commands_row("FRI: commands that the cabinet is sent", load_settings(), "fri")
    for period_ms in PERIODS_MS:
        for loops in (0, 2):
            with busy(loops):
                floor, missed = _floor(period_ms, answers)
                with robot(period_ms) as made:
                    states = made.move_for(answers, COUNT)
            name = f"FRI at {period_ms} ms{', beside two busy loops' if loops else ''}"
            yield answer_row(f"{name}: a message to its answer, the whole cycle behind it", states[1], floor)
            yield punctual_row(name, "messages", "cabinet", states, COUNT, missed, "0, 0 below GOOD")
    with robot(5) as made:
        yield made.moves_row(moves)
        for name, (fault, end) in FAULTS.items():
            yield made.recovery_row(
                name,
                fault,
                end,
                repetitions,
                "until the cabinet takes commands",
                lambda _: made.controller.ask()["state"] == "COMMANDING_ACTIVE",
            )


def _floor(period_ms: int, answers: int) -> tuple[Times, float]:
    with (
        CabinetProcess("--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0) as cabinet,
        background("benchmarks.backends.bare_fri", str(cabinet.port)),
    ):
        return floor_of(cabinet, COUNT, answers, period_ms)
