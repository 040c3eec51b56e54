"""KUKA's FRI: how soon a cabinet has its answer, with the whole cycle behind it; what faults cost."""

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
from arm_activities import robot_health
from cobot_run import WAIT_S
from fri_run import CabinetProcess, RunOverFri

from benchmarks.loop.idle import busy
from benchmarks.service import background
from benchmarks.table import Row, percentiles, row

PERIODS_MS = (5, 2, 1)
PRIORITY = 90
"""Of the cabinet, above rtloop's: it is another computer, with a real-time system of its own."""
GOAL = [0.5, 0.2, 0.0, -1.4, 0.0, 1.4, 0.2]
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
LOSS = 0.05
WARM = 200
"""Answers that the client begins with."""
FAULTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "an emergency stop": ({"safety_stop": 0}, {"safety_stop": -1}),
    "a safety stop": ({"safety_stop": 1}, {"safety_stop": -1}),
    "a change of the operation mode": ({"mode": "T2"}, {"mode": "AUT"}),
    "a closed session": ({"close": True}, {}),
    "90 % of loss": ({"loss": 0.9}, {"loss": 0.0}),
    "answers three periods late": ({"delay": 3}, {"delay": 0}),
    "a pulled cable": ({"loss": 1.0}, {"loss": 0.0}),
    "values that are no numbers": ({"spoil": "nan"}, {"spoil": ""}),
    "values that never change": ({"spoil": "frozen"}, {"spoil": ""}),
}
"""Each in the middle of a motion, with what ends it."""


@contextlib.contextmanager
def robot(period_ms: int) -> Iterator[tuple[CabinetProcess, RunOverFri]]:
    """A cabinet without patience, and the service."""
    with (
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
        CabinetProcess("--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0) as cabinet,
    ):
        run = RunOverFri(Path(folder), cabinet, period_ms=period_ms)
        try:
            run.until(lambda: run.healthy() or (_reset(run) and run.healthy()))
            acknowledged = httpx.post(f"{run.url}/robot/acknowledge", json={"payload_checked": True})
            acknowledged.raise_for_status()
            yield cabinet, run
        finally:
            run.end()


def fri(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Answers at each period in motion, alone and beside two busy loops; then losses, and recoveries."""
    for period_ms in PERIODS_MS:
        for loops in (0, 2):
            with busy(loops):
                floor, missed = _floor(period_ms, answers)
                with robot(period_ms) as (cabinet, run):
                    before = cabinet.ask()
                    while cabinet.ask()["answered"] - before["answered"] < answers:
                        if not (_move(run, GOAL) and _move(run, HOME)):
                            _reset(run)
                    after = cabinet.ask()
            name = f"FRI at {period_ms} ms{', beside two busy loops' if loops else ''}"
            yield _answer_row(name, after, floor)
            yield _punctual_row(name, before, after, missed)
    with robot(5) as (cabinet, run):
        yield _moves_row(cabinet, run, moves)
        for name, (fault, end) in FAULTS.items():
            yield _recovery_row(cabinet, run, name, fault, end, repetitions)


def _answer_row(name: str, told: dict[str, Any], floor: tuple[float, float, float]) -> Row:
    times = tuple(told["answer_s"][share] * 1e6 for share in ("p50", "p99", "p99.9"))
    return row(
        f"{name}: a message to its answer, the whole cycle behind it",
        "µs",
        times,
        "a client that only echoes",
        floor,
    )


def _punctual_row(name: str, before: dict[str, Any], after: dict[str, Any], missed: float) -> Row:
    """The cabinet's own count; a session that is closed has no messages."""
    answered, sent = _counted(before, after)
    below = after["below_good"] - before["below_good"]
    late_ms = 1e3 * after["lateness_s"]["p99.9"]
    return row(
        f"{name}: of {sent} messages while it moves, not answered in time; {below} times below GOOD; "
        f"the cabinet itself is {late_ms:.1f} ms late at p99.9",
        "",
        (1e5 * (sent - answered) / sent,),
        "a client that only echoes",
        (1e5 * missed,),
        columns=("of 100,000",),
        aim="0, 0 below GOOD",
    )


def _floor(period_ms: int, answers: int) -> tuple[tuple[float, float, float], float]:
    """µs of the least client, and which share of the messages it does not answer in time."""
    with (
        CabinetProcess("--priority", str(PRIORITY), period_ms=period_ms, patience_s=0.0) as cabinet,
        background("benchmarks.backends.bare_fri", str(cabinet.port)),
    ):
        deadline_s = time.monotonic() + WAIT_S
        while cabinet.ask()["answers"] < WARM and time.monotonic() < deadline_s:
            time.sleep(0.1)
        before = after = cabinet.ask()
        deadline_s += 2e-3 * period_ms * answers
        while after["answered"] - before["answered"] < answers and time.monotonic() < deadline_s:
            time.sleep(0.1)
            after = cabinet.ask()
        times = after["answer_s"]
    answered, sent = _counted(before, after)
    return (times["p50"] * 1e6, times["p99"] * 1e6, times["p99.9"] * 1e6), 1.0 - answered / sent


def _counted(before: dict[str, Any], after: dict[str, Any]) -> tuple[int, int]:
    """Messages that were answered in time meanwhile, and all."""
    answered, missing = (after[each] - before[each] for each in ("answered", "missing"))
    return answered, answered + missing


def _move(run: RunOverFri, joints: list[float]) -> bool:
    body = {"joints": joints, "speed": 1.0}
    answer = httpx.post(f"{run.url}/robot/move/joints", json=body, timeout=WAIT_S)
    return answer.status_code == 200 and bool(answer.json()["success"])


@contextlib.contextmanager
def _moving(run: RunOverFri) -> Iterator[None]:
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


def _reset(run: RunOverFri) -> bool:
    try:
        answer = httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S)
    except httpx.TransportError:  # it starts
        return False
    return answer.status_code == 200 and bool(answer.json()["success"])


def _moves_row(cabinet: CabinetProcess, run: RunOverFri, moves: int) -> Row:
    cabinet.ask(loss=LOSS)
    arrived = 0
    for number in range(moves):
        if _move(run, GOAL if number % 2 == 0 else HOME):
            arrived += 1
        else:
            _reset(run)
    cabinet.ask(loss=0.0)
    return row(
        "FRI: moves that arrive under 5 % of loss in each direction",
        "",
        (arrived,),
        "all of them",
        (moves,),
        columns=("arrived",),
        aim="all",
    )


def _recovery_row(
    cabinet: CabinetProcess,
    run: RunOverFri,
    name: str,
    fault: dict[str, Any],
    end: dict[str, Any],
    times: int,
) -> Row:
    """From the end of a fault; a reset is asked for as soon as the cabinet takes commands."""
    cabinet_s, arm_s = [], []
    for _ in range(times):
        with _moving(run):
            cabinet.ask(**fault)
            run.until(lambda: not run.healthy())
        cabinet.ask(**end)
        begun_s = time.monotonic()
        run.until(lambda: cabinet.ask()["state"] == "COMMANDING_ACTIVE")
        cabinet_s.append(time.monotonic() - begun_s)
        run.until(lambda: _reset(run) and run.healthy())
        arm_s.append(time.monotonic() - begun_s)
    return row(
        f"FRI: from the end of {name} until the arm can be moved",
        "ms",
        percentiles([1e3 * each for each in arm_s]),
        "until the cabinet takes commands",
        percentiles([1e3 * each for each in cabinet_s]),
    )
