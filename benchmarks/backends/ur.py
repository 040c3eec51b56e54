"""Universal Robots: how soon the controller has its command after a package; what faults cost."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml
from ur_arm import POSITIONS, ur_folder
from ur_run import ControllerProcess, RunOverUr

from benchmarks.backends.derivatives import commands_row
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
from benchmarks.table import Row
from cobot.config import SETTINGS_FILE, load_settings

PERIODS_MS = (8, 2)
WORDS = Words("package", "command", "controller", "answers")
HOME = np.radians(POSITIONS["home"]).tolist()
GOAL = np.radians([20.0, -80.0, 90.0, -100.0, -80.0, 20.0]).tolist()
DELAY_S = 0.02
FAULTS: Faults = {
    "an emergency stop": ({"safety": 7}, {"safety": 1}),
    "a protective stop": ({"safety": 3, "blocked": "Cannot unlock"}, {"blocked": ""}),
    "a safeguard stop": ({"safety": 5}, {"safety": 1}),
    "a program stopped at the pendant": ({"program": "stop"}, {}),
    "a silent network": ({"silent": True}, {"silent": False}),
    "90 % of the packages left out": ({"loss": 0.9}, {"loss": 0.0}),
    **SPOILED,
}
"""Each in the middle of a motion, with what ends it."""


@contextlib.contextmanager
def robot(period_ms: int) -> Iterator[Driven]:
    """A controller that does not wait for late answers, and the service."""
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        arm = ur_folder(Path(folder)) / SETTINGS_FILE
        with ControllerProcess(arm, "--priority", str(PRIORITY), patience_s=0.0) as controller:
            run = RunOverUr(Path(folder), arm, controller.address, period_ms=period_ms, silence_s=0.1)
            with driven("Universal Robots", controller, run, (GOAL, HOME)) as made:
                yield made


def ur(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Derivatives, commands during motion at two periods, lost packages, late commands, and recoveries."""
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        settings = load_settings(ur_folder(Path(folder)) / SETTINGS_FILE)
        yield commands_row("Universal Robots: commands that the controller is sent", settings, "ur")
    for period_ms in PERIODS_MS:
        count = max(answers * PERIODS_MS[-1] // period_ms, WARM)
        floor = _floor(period_ms, count)
        yield from answer_rows(f"Universal Robots at {period_ms} ms", WORDS, robot(period_ms), count, floor)
    with robot(8) as made:
        yield made.moves_row(moves, "with 5 % of the packages left out")
        late = f"with commands {1e3 * DELAY_S:.0f} ms late"
        yield made.moves_row(moves, late, {"delay_s": DELAY_S}, {"delay_s": 0.0})
        yield from made.recovery_rows(  # switching on takes 0.2 s of each recovery
            FAULTS,
            repetitions,
            "until cobot's program plays on the controller",
            lambda _: made.reset() or made.controller.ask()["runtime"] == "PLAYING",
        )


def _floor(period_ms: int, answers: int) -> tuple[Times, float]:
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        arm = ur_folder(Path(folder)) / SETTINGS_FILE
        with ControllerProcess(arm, "--on", "--priority", str(PRIORITY), patience_s=0.0) as controller:
            settings = yaml.safe_load(arm.read_text())
            settings["robot"]["backend"] = {"type": "ur", "address": controller.address, "port": 0}
            settings.setdefault("rt", {})["period_s"] = period_ms * 1e-3
            arm.write_text(yaml.safe_dump(settings))
            with background("benchmarks.backends.bare_ur", str(arm)):
                return floor_of(controller, WORDS.count, answers, period_ms)
