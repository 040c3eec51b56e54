"""What becomes an event of what rtloop publishes.

Oracle: the events that a person would write down looking at these states.
"""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.services.events.ring import Events
from app.services.reports.watch import StateWatch
from app.services.state.robot_state import RobotState
from cobot.ipc.layout import Intervention
from cobot.ipc.state_fields import state_dtype
from cobot.types import LoopMode

STALE_S = 0.25


def rest(age_s: float = 0.001, **fields: Any) -> RobotState:
    """At rest but for these fields of the record."""
    record = np.zeros((), state_dtype(7))
    for name, value in {"mode": LoopMode.HOLD, "settled": True, **fields}.items():
        record[name] = value
    return RobotState(record, round(age_s * 1e9))


class Bench:
    """A watch at rest that has had its first look."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.replaced = 3
        self.fields: dict[str, Any] = {}
        self.cycle = 1000
        clock: Any = SimpleNamespace(now_s=lambda: self.now_s, wall_ns=lambda: 0)
        self.events = Events(clock)
        self.watch = StateWatch(self.events.of("left"), STALE_S, lambda: "a joystick", lambda: self.replaced)
        assert self.look() == []

    def look(self, **changes: Any) -> list[tuple[str, dict[str, Any]]]:
        """What is told at a look at the state with these changes, 10 ms later."""
        self.fields |= changes
        return self.see(rest(**self.fields))

    def see(self, state: RobotState | None) -> list[tuple[str, dict[str, Any]]]:
        self.now_s += 0.01
        self.cycle += 10
        before = self.events.newest
        self.watch.look(state, self.cycle if state else 0, self.now_s)
        found = [json.loads(each.text) for each in self.events.since(before, 100)]
        assert all(each["robot"] == "left" for each in found)
        return [(each["type"], each["data"]) for each in found]

    def caught(self, **counts: int) -> list[int]:
        interventions = rest(**self.fields).interventions
        for name, count in counts.items():
            interventions[Intervention[name.upper()]] = count
        return interventions


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_modes_are_told_and_why_nothing_moves(bench: Bench) -> None:
    assert bench.look(mode=LoopMode.TRAJECTORY) == [
        ("mode", {"mode": "TRAJECTORY", "before": "HOLD", "reason": ""})
    ]
    assert bench.look() == []
    reason = "joint3 is 0.2 rad from where it should be"
    assert bench.look(mode=LoopMode.FAULT, reason=reason) == [
        ("mode", {"mode": "FAULT", "before": "TRAJECTORY", "reason": reason}),
        ("fault", {"reason": reason}),
    ]
    assert bench.look(mode=LoopMode.HOLD, reason="") == [
        ("mode", {"mode": "HOLD", "before": "FAULT", "reason": ""})
    ]
    assert bench.look(mode=LoopMode.ESTOP, reason="an e-stop")[1] == (
        "estop",
        {"what": "latched", "reason": "an e-stop"},
    )


def test_sessions_are_told_with_their_client(bench: Bench) -> None:
    (begun,) = bench.look(session=4)
    assert begun == ("session", {"what": "begun", "session": 4, "client": "a joystick"})
    ended, begun = bench.look(session=5, reason="the client has ended the session")
    assert ended == (
        "session",
        {"what": "ended", "session": 4, "reason": "the client has ended the session"},
    )
    assert begun[1]["session"] == 5
    assert [each[1]["what"] for each in bench.look(session=0)] == ["ended"]


def test_an_intervention_is_told_at_once_and_then_once_a_second_with_how_many(bench: Bench) -> None:
    assert bench.look(interventions=bench.caught(jerk=1)) == [
        ("intervention", {"kind": "jerk", "new": 1, "count": 1})
    ]
    told = []
    for count in range(2, 302):  # three seconds at a hundred looks
        told += bench.look(interventions=bench.caught(jerk=10 * count))
    assert 2 <= len(told) <= 4
    assert [each[1]["count"] for each in told] == sorted({each[1]["count"] for each in told})
    for _ in range(200):
        told += bench.look()
    assert sum(each[1]["new"] for each in told) == 3010 - 1
    assert bench.look(interventions=bench.caught(contact=2)) == [
        ("intervention", {"kind": "contact", "new": 2, "count": 2})
    ]


def test_what_was_there_at_the_first_look_is_no_news() -> None:
    bench = Bench()
    first = StateWatch(bench.events.of("left"), STALE_S, lambda: None, lambda: 7)
    state = rest(mode=LoopMode.FAULT, session=3, interventions=[5] * len(Intervention))
    first.look(state, 1000, 1.0)
    assert bench.events.newest == 0


def test_silence_of_rtloop_and_its_return_are_told_once_each(bench: Bench) -> None:
    assert bench.look(age_s=0.3) == [("rtloop", {"what": "silent"})]
    assert bench.look(age_s=0.5) == []
    assert bench.see(None) == []
    assert bench.look(age_s=0.01) == [("rtloop", {"what": "back"})]
    assert bench.see(None) == [("rtloop", {"what": "silent"})]
    bench.cycle = 0
    assert bench.look() == [("rtloop", {"what": "restarted"})]
    assert bench.look(interventions=[0] * len(Intervention)) == []


def test_counts_of_another_rtloop_begin_anew(bench: Bench) -> None:
    bench.look(interventions=bench.caught(jerk=50))
    bench.cycle = 0
    assert bench.look(interventions=bench.caught(jerk=0)) == [("rtloop", {"what": "restarted"})]
    assert bench.look(interventions=bench.caught(jerk=2)) == [
        ("intervention", {"kind": "jerk", "new": 2, "count": 2})
    ]


def test_replaced_planners_are_told(bench: Bench) -> None:
    bench.replaced = 5
    assert bench.look() == [("planning", {"what": "replaced", "replaced": 5})]
    assert bench.look() == []
