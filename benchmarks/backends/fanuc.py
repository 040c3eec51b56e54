"""FANUC's Stream Motion: how soon a controller has its answer from the whole cycle; what faults cost.

The controller is ours, in another process with SCHED_FIFO above rtloop's. That the backend drives one that
nobody here wrote is in the tests.
"""

from __future__ import annotations

import contextlib
import math
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from arm_activities import robot_health
from cobot_run import WAIT_S
from crx_arm import POSITIONS, crx_folder
from fanuc_run import ControllerProcess, RunOverFanuc

from benchmarks.service import background
from benchmarks.table import Row, percentiles, row
from cobot.config import SETTINGS_FILE

PERIODS_MS = (8, 1)
PRIORITY = 90
"""Of the controller, above rtloop's: it is another computer, with a real-time system of its own."""
HOME = np.radians(POSITIONS["home"]).tolist()
GOAL = np.radians([-30.0, 10.0, -10.0, 10.0, -60.0, 60.0]).tolist()
LOSS = 0.05
WARM = 200
"""Answers that the client begins with."""
FAULTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "an emergency stop": ({"e_stop": True}, {"e_stop": False}),
    "an open fence": ({"fence": True}, {"fence": False}),
    "a collision": ({"collision": True}, {"collision": False}),
    "a change of the operation mode": ({"mode": "T1"}, {"mode": "AUTO"}),
    "a contact stop": ({"contact_stop": 2}, {"contact_stop": 1}),
    "a pulled cable": ({"loss": 1.0}, {"loss": 0.0}),
    "values that are no numbers": ({"spoil": "nan"}, {"spoil": ""}),
    "a closed connection of RMI and an alarm": ({"close": True, "alarm": "SRVO-023 Stop error"}, {}),
}
"""Each in the middle of a motion, with what ends it."""


def fanuc(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Answers in motion at each period, beside an echo; then losses, derivatives, and recoveries."""
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        arm = crx_folder(Path(folder)) / SETTINGS_FILE
        for period_ms in PERIODS_MS:
            count = max(answers * PERIODS_MS[-1] // period_ms, WARM)
            floor, missed = _floor(arm, period_ms, count)
            with robot(arm, period_ms) as (controller, run):
                before = controller.ask()
                while controller.ask()["commands"] - before["commands"] < count:
                    if not (_move(run, GOAL) and _move(run, HOME)):
                        _reset(run)
                after = controller.ask()
            yield _answer_row(period_ms, after, floor)
            yield _punctual_row(period_ms, before, after, missed)
            yield _peaks_row(period_ms, after)
        with robot(arm, PERIODS_MS[0]) as (controller, run):
            yield _moves_row(controller, run, moves)
            for name, (fault, end) in FAULTS.items():
                yield _recovery_row(controller, run, name, fault, end, repetitions)


@contextlib.contextmanager
def robot(arm: Path, period_ms: int) -> Iterator[tuple[ControllerProcess, RunOverFanuc]]:
    """A controller without patience, and the service."""
    with (
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
        ControllerProcess(
            arm, "--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0
        ) as controller,
    ):
        ports = controller.stream_port, controller.rmi_port
        run = RunOverFanuc(Path(folder), arm, *ports, period_ms=period_ms, silence_s=0.1)
        try:
            run.until(lambda: run.healthy() or (_reset(run) and run.healthy()))
            httpx.post(f"{run.url}/robot/acknowledge", json={"payload_checked": True}).raise_for_status()
            yield controller, run
        finally:
            run.end()


def _punctual(arm: Path, period_ms: int) -> ControllerProcess:
    """A controller that waits for no late answer."""
    return ControllerProcess(arm, "--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0)


def _floor(arm: Path, period_ms: int, answers: int) -> tuple[tuple[float, float, float], float]:
    """µs of the least client, and which share of the packets it does not answer in time."""
    with (
        ControllerProcess(
            arm, "--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0
        ) as controller,
        background("benchmarks.backends.bare_fanuc", str(controller.stream_port), str(controller.rmi_port)),
    ):
        deadline_s = time.monotonic() + WAIT_S
        while controller.ask()["answers"] < WARM and time.monotonic() < deadline_s:
            time.sleep(0.1)
        before = after = controller.ask()
        deadline_s += 2e-3 * period_ms * answers
        while after["commands"] - before["commands"] < answers and time.monotonic() < deadline_s:
            time.sleep(0.1)
            after = controller.ask()
    times = after["answer_s"]
    answered, sent = _counted(before, after)
    return (times["p50"] * 1e6, times["p99"] * 1e6, times["p99.9"] * 1e6), 1.0 - answered / sent


def _counted(before: dict[str, Any], after: dict[str, Any]) -> tuple[int, int]:
    """Packets that were answered in time meanwhile, and all that needed an answer."""
    answered, missing = (after[each] - before[each] for each in ("commands", "missing"))
    return answered, answered + missing


def _answer_row(period_ms: int, told: dict[str, Any], floor: tuple[float, float, float]) -> Row:
    times = tuple(told["answer_s"][share] * 1e6 for share in ("p50", "p99", "p99.9"))
    return row(
        f"FANUC at {period_ms} ms: a packet to its answer, the whole cycle behind it",
        "µs",
        times,
        "a client that only echoes",
        floor,
    )


def _punctual_row(period_ms: int, before: dict[str, Any], after: dict[str, Any], missed: float) -> Row:
    answered, sent = _counted(before, after)
    late_ms = 1e3 * after["lateness_s"]["p99.9"]
    return row(
        f"FANUC at {period_ms} ms: of {sent} packets while it moves, not answered in time; the controller "
        f"itself is {late_ms:.1f} ms late at p99.9",
        "",
        (1e5 * (sent - answered) / sent,),
        "a client that only echoes",
        (1e5 * missed,),
        columns=("of 100,000",),
        aim="0",
    )


def _peaks_row(period_ms: int, told: dict[str, Any]) -> Row:
    peaks = tuple(max(told["peaks"][rate]) for rate in ("velocity", "acceleration", "jerk"))
    return row(
        f"FANUC at {period_ms} ms: largest share of the controller's limits that commands have used",
        "",
        peaks,
        "the controller's alarm",
        (1.01,) * 3,
        columns=("velocity", "acceleration", "jerk"),
        aim="below 1",
    )


def _moves_row(controller: ControllerProcess, run: RunOverFanuc, moves: int) -> Row:
    controller.ask(loss=LOSS)
    arrived = 0
    for number in range(moves):
        if _move(run, GOAL if number % 2 == 0 else HOME):
            arrived += 1
        else:
            _reset(run)
    controller.ask(loss=0.0)
    return row(
        "FANUC: moves that arrive under 5 % of loss in each direction",
        "",
        (arrived,),
        "all of them",
        (moves,),
        columns=("arrived",),
        aim="all",
    )


def _move(run: RunOverFanuc, joints: list[float]) -> bool:
    body = {"joints": joints, "speed": 1.0}
    answer = httpx.post(f"{run.url}/robot/move/joints", json=body, timeout=WAIT_S)
    return answer.status_code == 200 and bool(answer.json()["success"])


def _reset(run: RunOverFanuc) -> bool:
    try:
        answer = httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S)
    except httpx.TransportError:  # it starts
        return False
    return answer.status_code == 200 and bool(answer.json()["success"])


@contextlib.contextmanager
def _moving(run: RunOverFanuc) -> Iterator[None]:
    """A motion has begun, and has ended behind the block."""
    here = run.joints()
    goal = max((GOAL, HOME), key=lambda joints: math.dist(joints, here))
    thread = threading.Thread(target=_move, args=(run, goal))
    thread.start()
    try:
        run.until(lambda: robot_health(run).get("mode") == "TRAJECTORY")
        yield
    finally:
        thread.join()


def _recovery_row(
    controller: ControllerProcess,
    run: RunOverFanuc,
    name: str,
    fault: dict[str, Any],
    end: dict[str, Any],
    times: int,
) -> Row:
    """From the end of a fault; a reset is asked for until it succeeds."""
    arm_s = []
    for _ in range(times):
        with _moving(run):
            controller.ask(**fault)
            run.until(lambda: not run.healthy())
        controller.ask(**end)
        begun_s = time.monotonic()
        run.until(lambda: _reset(run) and run.healthy())
        arm_s.append(time.monotonic() - begun_s)
    return row(
        f"FANUC: from the end of {name} until the arm can be moved",
        "ms",
        percentiles([1e3 * each for each in arm_s]),
        "the program of the simulated controller",
        (40.0,) * 3,
    )
