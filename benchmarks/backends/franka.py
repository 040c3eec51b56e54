"""Franka: the age of a state when the command that answers it arrives, including the whole cycle."""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
from cobot_run import WAIT_S
from franky_run import ADDRESS, FrankySimulator, RunOfFranka

from benchmarks.service import background
from benchmarks.table import Row, row

NEEDED = ("pylibfranka", "franky_sim")


def franka(answers: int) -> Iterator[Row]:
    """Measure with franky-sim, which waits for the answer to each state. The arm moves during the
    measurement.
    """
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        print(f"franka: {missing[0]} is not installed")
        return
    with FrankySimulator() as simulator, background("benchmarks.backends.bare_franka", ADDRESS):
        floor = _ages(simulator, answers)
    with FrankySimulator() as simulator, tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        run = RunOfFranka(Path(folder), simulator)
        try:
            run.until(run.healthy)
            _post(run, "acknowledge", payload_checked=True)
            while simulator.ask()["answers"] < answers:
                _post(run, "move/named", name="work", speed=1.0)
                _post(run, "move/named", name="home", speed=1.0)
            ages = _ages(simulator, answers)
        finally:
            run.end()
    yield row(
        "Franka: a state to the arrival of the command that answers it, the whole cycle behind it",
        "µs",
        ages,
        "pylibfranka alone, which holds the arm",
        floor,
    )


def _ages(simulator: FrankySimulator, answers: int) -> tuple[float, float, float]:
    """At least this number of ages, µs."""
    deadline_s = time.monotonic() + WAIT_S
    while (told := simulator.ask())["answers"] < answers and time.monotonic() < deadline_s:
        time.sleep(0.1)
    ages: dict[str, Any] = told["age_s"]
    return ages["p50"] * 1e6, ages["p99"] * 1e6, ages["p99.9"] * 1e6


def _post(run: RunOfFranka, path: str, **body: object) -> None:
    httpx.post(f"{run.url}/robot/{path}", json=body, timeout=WAIT_S).raise_for_status()
