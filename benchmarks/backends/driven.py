"""The common part of the benchmarks of the makers' protocols: a service drives a simulated controller."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import httpx
from arm_activities import robot_health
from cobot_run import WAIT_S, Run

from benchmarks.table import Row, percentiles, row

PRIORITY = 90
"""Of the controller, above rtloop's: it is another computer, with a real-time system of its own."""
WARM = 200
"""Number of answers after which the least client is measured."""
BELOW = "below_good"
"""Count of the times at which a connection became worse than GOOD, which FRI has."""
Request = Mapping[str, Any]
LOSS: Request = {"loss": 0.05}
NO_LOSS: Request = {"loss": 0.0}
Faults = dict[str, tuple[dict[str, Any], dict[str, Any]]]
"""Requests to the controller in the middle of a motion, by the name of the fault: its begin and its end."""
SPOILED: Faults = {
    "values that are not numbers": ({"spoil": "nan"}, {"spoil": ""}),
    "values that never change": ({"spoil": "frozen"}, {"spoil": ""}),
}
"""Faults that every simulated controller has."""
Times = tuple[float, float, float]
"""Percentiles 50, 99 and 99.9, µs."""


class Controller(Protocol):
    """A simulated controller in another process."""

    def ask(self, **request: Any) -> dict[str, Any]:
        """Change the controller's behaviour, and read its state."""
        ...


class Driven:
    """A service that controls an arm of a simulated controller.

    Attributes:
        name: the protocol, for the table.
        controller: the simulated controller.
        run: the service.
    """

    def __init__(
        self,
        name: str,
        controller: Controller,
        run: Run,
        goals: tuple[list[float], list[float]],
        *,
        speed: float = 1.0,
        fault_speed: float = 1.0,
    ) -> None:
        """
        Args:
            goals: joint positions between which it moves, rad.
            speed: speed of the moves, from 0 to 1.
            fault_speed: speed of the moves in whose middle a fault begins.
        """
        self.name, self.controller, self.run = name, controller, run
        self._goals, self._speed, self._fault_speed = goals, speed, fault_speed

    def get_ready(self) -> None:
        """Reset until the arm can be moved, and let it move as fast as it may."""
        self.run.until(self._is_ready)
        acknowledged = httpx.post(f"{self.run.url}/robot/acknowledge", json={"payload_checked": True})
        acknowledged.raise_for_status()

    def move_for(self, answers: int, key: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Move until the controller's count `key` has grown by `answers`. Returns its states before and after
        the moves.
        """
        before = after = self.controller.ask()
        while after[key] - before[key] < answers:
            if not all(self._move(goal, self._speed) for goal in self._goals):
                self.reset()
            after = self.controller.ask()
        return before, after

    def reset(self) -> bool:
        try:
            return self._is_successful("reset")
        except httpx.TransportError:  # it starts
            return False

    def moves_row(
        self,
        moves: int,
        how: str = "under 5 % of loss in each direction",
        fault: Request = LOSS,
        end: Request = NO_LOSS,
    ) -> Row:
        """The row with the number of motions that reach their goal in spite of a network fault."""
        self.controller.ask(**fault)
        arrived = 0
        for number in range(moves):
            if self._move(self._goals[number % 2], self._speed):
                arrived += 1
            else:
                self.reset()
        self.controller.ask(**end)
        return row(
            f"{self.name}: moves that arrive {how}",
            "",
            (arrived,),
            "all of them",
            (moves,),
            columns=("arrived",),
            aim="all",
        )

    def recovery_row(
        self,
        fault_name: str,
        fault: Request,
        end: Request,
        times: int,
        until: str,
        takes_commands: Callable[[dict[str, Any]], bool] | float,
    ) -> Row:
        """The row with the time from the end of a fault until the arm can be moved. The reset is repeated
        until it succeeds.

        Args:
            until: the end of the controller's own part, for the table.
            takes_commands: whether this end has come; its argument is the state at the end of the fault. A
                number is the known duration of the controller's part, ms.
        """
        arm_ms, controller_ms = [], []
        for _ in range(times):
            with self._moving():
                self.controller.ask(**fault)
                self.run.until(lambda: not self.run.healthy())
            ended = self.controller.ask(**end)
            begun_s = time.monotonic()
            if callable(takes_commands):
                self.run.until(partial(takes_commands, ended))
                controller_ms.append(1e3 * (time.monotonic() - begun_s))
            self.run.until(self._is_ready)
            arm_ms.append(1e3 * (time.monotonic() - begun_s))
        return row(
            f"{self.name}: from the end of {fault_name} until the arm can be moved",
            "ms",
            percentiles(arm_ms),
            until,
            percentiles(controller_ms) if callable(takes_commands) else (takes_commands,) * 3,
        )

    def recovery_rows(
        self,
        faults: Faults,
        times: int,
        until: str,
        takes_commands: Callable[[dict[str, Any]], bool] | float,
    ) -> Iterator[Row]:
        """A `recovery_row` for each fault."""
        for name, (fault, end) in faults.items():
            yield self.recovery_row(name, fault, end, times, until, takes_commands)

    def _is_ready(self) -> bool:
        return self.run.healthy() or (self.reset() and self.run.healthy())

    def _move(self, joints: list[float], speed: float) -> bool:
        return self._is_successful("move/joints", joints=joints, speed=speed)

    def _is_successful(self, path: str, **body: object) -> bool:
        answer = httpx.post(f"{self.run.url}/robot/{path}", json=body or None, timeout=WAIT_S)
        return answer.status_code == 200 and bool(answer.json()["success"])

    @contextlib.contextmanager
    def _moving(self) -> Iterator[None]:
        """Context manager that runs its block while a motion is running, and waits for the end of the
        motion.
        """
        here = self.run.joints()
        goal = max(self._goals, key=lambda joints: math.dist(joints, here))
        thread = threading.Thread(target=self._move, args=(goal, self._fault_speed))
        thread.start()
        try:
            self.run.until(lambda: robot_health(self.run).get("mode") == "TRAJECTORY")
            yield
        finally:
            thread.join()


@contextlib.contextmanager
def driven(
    name: str,
    controller: Controller,
    run: Run,
    goals: tuple[list[float], list[float]],
    **speeds: float,
) -> Iterator[Driven]:
    """A service that is ready, with the arguments of `Driven`. The service ends after the block."""
    made = Driven(name, controller, run, goals, **speeds)
    try:
        made.get_ready()
        yield made
    finally:
        run.end()


def times_of(state: dict[str, Any]) -> Times:
    """Times from a packet of the controller to its answer, µs."""
    times = state["answer_s"]
    return times["p50"] * 1e6, times["p99"] * 1e6, times["p99.9"] * 1e6


def counted(before: dict[str, Any], after: dict[str, Any], key: str) -> tuple[int, int]:
    """Packets that were answered in time between two states, and all that needed an answer.

    Args:
        key: name of the controller's count of answers in time.
    """
    answered, missing = (after[each] - before[each] for each in (key, "missing"))
    return answered, answered + missing


def floor_of(controller: Controller, key: str, answers: int, period_ms: int) -> tuple[Times, float]:
    """The times of the minimal client, which is running, and the fraction of packets that it does not answer
    in time.
    """
    deadline_s = time.monotonic() + WAIT_S
    while controller.ask()["answers"] < WARM and time.monotonic() < deadline_s:
        time.sleep(0.1)
    before = after = controller.ask()
    deadline_s += 2e-3 * period_ms * answers
    while after[key] - before[key] < answers and time.monotonic() < deadline_s:
        time.sleep(0.1)
        after = controller.ask()
    answered, sent = counted(before, after, key)
    return times_of(after), 1.0 - answered / sent


@dataclass(frozen=True, slots=True)
class Words:
    """The words for the protocol in the table.

    Attributes:
        packet, answer: for a packet of the controller, and for the answer to it.
        device: for the controller.
        count: name of the controller's count of answers in time.
    """

    packet: str
    answer: str
    device: str
    count: str


def answer_rows(
    name: str,
    words: Words,
    robot: AbstractContextManager[Driven],
    answers: int,
    floor: tuple[Times, float],
    aim: str = "0",
) -> Generator[Row, None, dict[str, Any]]:
    """Times of the answers in motion, and how many are late. Returns the state of the controller afterwards.

    Args:
        floor: see `floor_of`.
        aim: the target for late answers, for the table.
    """
    times, missed = floor
    with robot as made:
        states = made.move_for(answers, words.count)
    what = f"a {words.packet} to its {words.answer}, the whole cycle behind it"
    yield row(f"{name}: {what}", "µs", times_of(states[1]), "a client that only echoes", times)
    yield _punctual_row(name, words, states, missed, aim)
    return states[1]


def _punctual_row(
    name: str,
    words: Words,
    states: tuple[dict[str, Any], dict[str, Any]],
    missed: float,
    aim: str,
) -> Row:
    """The controller's own count of packets without an answer in time; a session that is closed has none.

    Args:
        states: of the controller, before and after the moves.
        missed: fraction of packets that the least client does not answer in time.
    """
    before, after = states
    answered, sent = counted(before, after, words.count)
    below = f"{after[BELOW] - before[BELOW]} times below GOOD; " if BELOW in after else ""
    late_ms = 1e3 * after["lateness_s"]["p99.9"]
    return row(
        f"{name}: of {sent} {words.packet}s while it moves, not answered in time; {below}the {words.device} "
        f"itself is {late_ms:.1f} ms late at p99.9",
        "",
        (1e5 * (sent - answered) / sent,),
        "a client that only echoes",
        (1e5 * missed,),
        columns=("of 100,000",),
        aim=aim,
    )
