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
    SPOILED,
    Driven,
    Faults,
    Times,
    Words,
    answer_rows,
    driven,
    floor_of,
)
from benchmarks.loop.idle import busy
from benchmarks.service import background
from benchmarks.table import Row
from cobot.config import load_settings

PERIODS_MS = (5, 2, 1)
WORDS = Words("message", "answer", "cabinet", "answered")
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
    **SPOILED,
}
"""Each in the middle of a motion, with what ends it."""


@contextlib.contextmanager
def robot(period_ms: int) -> Iterator[Driven]:
    """A cabinet that does not wait for late answers, and the service."""
    with (
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
        CabinetProcess("--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0) as cabinet,
        driven("FRI", cabinet, RunOverFri(Path(folder), cabinet, period_ms=period_ms), (GOAL, HOME)) as made,
    ):
        yield made


def fri(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Derivatives; answer times during motion at each period, alone and next to two busy loops; lost packets,
    recoveries.
    """
    yield commands_row("FRI: commands that the cabinet is sent", load_settings(), "fri")
    for period_ms in PERIODS_MS:
        for loops in (0, 2):
            name = f"FRI at {period_ms} ms{', beside two busy loops' if loops else ''}"
            with busy(loops):
                floor, aim = _floor(period_ms, answers), "0, 0 below GOOD"
                yield from answer_rows(name, WORDS, robot(period_ms), answers, floor, aim)
    with robot(5) as made:
        yield made.moves_row(moves)
        yield from made.recovery_rows(
            FAULTS,
            repetitions,
            "until the cabinet takes commands",
            lambda _: made.controller.ask()["state"] == "COMMANDING_ACTIVE",
        )


def _floor(period_ms: int, answers: int) -> tuple[Times, float]:
    with (
        CabinetProcess("--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0) as cabinet,
        background("benchmarks.backends.bare_fri", str(cabinet.port)),
    ):
        return floor_of(cabinet, WORDS.count, answers, period_ms)
