"""Universal Robots: how soon the controller has its command after a package; what faults cost."""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import yaml
from arm_activities import robot_health
from cobot_run import WAIT_S
from ur_arm import POSITIONS, ur_folder
from ur_run import ControllerProcess, RunOverUr

from benchmarks.service import background
from benchmarks.table import Row, percentiles, row
from cobot.config import SETTINGS_FILE

PERIODS_MS = (8, 2)
PRIORITY = 90
"""Of the controller, above rtloop's: it is another computer, with a real-time system of its own."""
HOME = np.radians(POSITIONS["home"]).tolist()
GOAL = np.radians([20.0, -80.0, 90.0, -100.0, -80.0, 20.0]).tolist()
DELAY_S = 0.02
LOSS = 0.05
FAULTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "an emergency stop": ({"safety": 7}, {"safety": 1}),
    "a protective stop": ({"safety": 3, "blocked": "Cannot unlock"}, {"blocked": ""}),
    "a safeguard stop": ({"safety": 5}, {"safety": 1}),
    "a program stopped at the pendant": ({"program": "stop"}, {}),
    "a silent network": ({"silent": True}, {"silent": False}),
    "values that are no numbers": ({"spoil": "nan"}, {"spoil": ""}),
}
"""Each in the middle of a motion, with what ends it."""


@contextlib.contextmanager
def robot(period_ms: int) -> Iterator[tuple[ControllerProcess, RunOverUr]]:
    """A controller without patience, and the service."""
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        arm = ur_folder(Path(folder)) / SETTINGS_FILE
        with ControllerProcess(arm, "--priority", str(PRIORITY), patience_s=0.0) as controller:
            run = RunOverUr(Path(folder), arm, controller.address, period_ms=period_ms, silence_s=0.1)
            try:
                run.until(lambda: run.healthy() or (_reset(run) and run.healthy()))
                acknowledged = httpx.post(f"{run.url}/robot/acknowledge", json={"payload_checked": True})
                acknowledged.raise_for_status()
                yield controller, run
            finally:
                run.end()


def ur(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Commands at two periods in motion; then packages left out, late commands, and recoveries."""
    for period_ms in PERIODS_MS:
        floor = _floor(period_ms, answers)
        with robot(period_ms) as (controller, run):
            before = controller.ask()["answers"]
            while controller.ask()["answers"] - before < answers:
                if not (_move(run, GOAL) and _move(run, HOME)):
                    _reset(run)
            told = controller.ask()
        yield _answer_row(f"Universal Robots at {period_ms} ms", told, floor)
    with robot(8) as (controller, run):
        yield _moves_row(
            controller, run, moves, "5 % of the packages left out", {"loss": LOSS}, {"loss": 0.0}
        )
        late = f"commands {1e3 * DELAY_S:.0f} ms late"
        yield _moves_row(controller, run, moves, late, {"delay_s": DELAY_S}, {"delay_s": 0.0})
        for name, (fault, end) in FAULTS.items():
            yield _recovery_row(controller, run, name, fault, end, repetitions)


def _answer_row(name: str, told: dict[str, Any], floor: tuple[float, float, float]) -> Row:
    late_ms = 1e3 * told["lateness_s"]["p99.9"]
    return row(
        f"{name}: a package to its command, the whole cycle behind it; "
        f"the controller itself is {late_ms:.1f} ms late at p99.9",
        "µs",
        _times(told),
        "a client that only echoes",
        floor,
    )


def _times(told: dict[str, Any]) -> tuple[float, float, float]:
    times = told["answer_s"]
    return times["p50"] * 1e6, times["p99"] * 1e6, times["p99.9"] * 1e6


def _floor(period_ms: int, answers: int) -> tuple[float, float, float]:
    """µs of the least client."""
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        arm = ur_folder(Path(folder)) / SETTINGS_FILE
        with ControllerProcess(arm, "--on", "--priority", str(PRIORITY), patience_s=0.0) as controller:
            settings = yaml.safe_load(arm.read_text())
            settings["robot"]["backend"] = {"type": "ur", "address": controller.address, "port": 0}
            settings.setdefault("rt", {})["period_s"] = period_ms * 1e-3
            arm.write_text(yaml.safe_dump(settings))
            with background("benchmarks.backends.bare_ur", str(arm)):
                until_s = time.monotonic() + WAIT_S + 2e-3 * period_ms * answers
                while controller.ask()["answers"] < answers and time.monotonic() < until_s:
                    time.sleep(0.2)
                return _times(controller.ask())


def _move(run: RunOverUr, joints: list[float]) -> bool:
    body = {"joints": joints, "speed": 1.0}
    answer = httpx.post(f"{run.url}/robot/move/joints", json=body, timeout=WAIT_S)
    return answer.status_code == 200 and bool(answer.json()["success"])


def _reset(run: RunOverUr) -> bool:
    try:
        answer = httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S)
    except httpx.TransportError:  # it starts
        return False
    return answer.status_code == 200 and bool(answer.json()["success"])


@contextlib.contextmanager
def _moving(run: RunOverUr) -> Iterator[None]:
    """A motion has begun, and has ended behind the block."""
    here = np.array(run.joints())
    goal = max((GOAL, HOME), key=lambda joints: float(np.linalg.norm(here - joints)))
    thread = threading.Thread(target=_move, args=(run, goal))
    thread.start()
    try:
        run.until(lambda: robot_health(run).get("mode") == "TRAJECTORY")
        yield
    finally:
        thread.join()


def _moves_row(
    controller: ControllerProcess,
    run: RunOverUr,
    moves: int,
    name: str,
    fault: dict[str, Any],
    end: dict[str, Any],
) -> Row:
    controller.ask(**fault)
    arrived = 0
    for number in range(moves):
        if _move(run, GOAL if number % 2 == 0 else HOME):
            arrived += 1
        else:
            _reset(run)
    controller.ask(**end)
    return row(
        f"Universal Robots: moves that arrive with {name}",
        "",
        (arrived,),
        "all of them",
        (moves,),
        columns=("arrived",),
        aim="all",
    )


def _recovery_row(
    controller: ControllerProcess,
    run: RunOverUr,
    name: str,
    fault: dict[str, Any],
    end: dict[str, Any],
    times: int,
) -> Row:
    """From the end of a fault, with a reset as soon as it is accepted; switching on takes 0.2 s of it."""
    arm_s, controller_s = [], []
    for _ in range(times):
        with _moving(run):
            controller.ask(**fault)
            run.until(lambda: not run.healthy())
        controller.ask(**end)
        begun_s = time.monotonic()
        run.until(lambda: _reset(run) or controller.ask()["runtime"] == "PLAYING")
        controller_s.append(time.monotonic() - begun_s)
        run.until(lambda: run.healthy() or (_reset(run) and run.healthy()))
        arm_s.append(time.monotonic() - begun_s)
    return row(
        f"Universal Robots: from the end of {name} until the arm can be moved",
        "ms",
        percentiles([1e3 * each for each in arm_s]),
        "until cobot's program plays on the controller",
        percentiles([1e3 * each for each in controller_s]),
    )
