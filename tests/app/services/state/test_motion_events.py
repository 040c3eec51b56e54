"""What is told of motions. Oracle: the order in which things have happened."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any, cast

from app.services.events.ring import Events
from app.services.state.motion_events import MotionEvents
from app.services.state.robot_state import RobotState
from cobot.ipc.layout import MotionResult
from cobot.reasons import Reason


class Bench:
    """Motions of one robot, and what was told of them."""

    def __init__(self) -> None:
        self.events = Events()
        self.motions = MotionEvents(self.events.of("left"))

    def look(self, motion_id: int, result: MotionResult) -> None:
        state = SimpleNamespace(
            motion_id=motion_id,
            motion_result=result,
            reason=Reason("why"),
            path_time_s=0.5,
            path_duration_s=2.0,
        )
        self.motions.look(cast(RobotState, state))

    @property
    def told(self) -> list[tuple[int, str, str]]:
        found: list[dict[str, Any]] = [json.loads(each.text)["data"] for each in self.events.since(0, 100)]
        return [(each["motion"], each["what"], each.get("reason", "")) for each in found]


def test_a_motion_begins_and_ends_once_however_often_somebody_looks() -> None:
    bench = Bench()
    bench.motions.prepare(1, 2.0)
    bench.motions.publish_begin()
    for result in (MotionResult.RUNNING, MotionResult.RUNNING, MotionResult.STOPPED, MotionResult.STOPPED):
        bench.look(1, result)
    assert bench.told == [(1, "begun", ""), (1, "stopped", "why")]
    assert bench.motions.ended[MotionResult.STOPPED] == 1


def test_a_motion_that_has_ended_before_anybody_knew_that_it_began_is_told_in_order() -> None:
    bench = Bench()
    bench.motions.prepare(1, 0.001)
    bench.look(1, MotionResult.ARRIVED)
    bench.motions.publish_begin()
    assert bench.told == [(1, "begun", ""), (1, "finished", "")]


def test_nothing_is_told_of_a_motion_that_was_refused() -> None:
    bench = Bench()
    bench.motions.prepare(1, 2.0)
    bench.motions.forget_begin()
    bench.motions.publish_begin()
    assert bench.told == []
    assert not any(bench.motions.ended.values())
