"""A service that stood still, as by SIGSTOP: what was asked for before or meanwhile moves nothing later.

On virtual time, of which a part goes by without a turn of the event loop. Oracle: the cycle's motion numbers.
"""

from __future__ import annotations

from typing import Any

import pytest
from virtual_service import PlanningHere, VirtualService

from app.services.state.heartbeat import CATCH_UP_S, PAUSE_S

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.3, *HOME[1:]]
MOVE = {"joints": AWAY, "speed": 0.5}


def stand_still(service: VirtualService, seconds: float) -> None:
    """Have so much time go by in which nothing of the service does anything."""
    service.loop._now_s += seconds


def motions(service: VirtualService) -> int:
    return int(service.rig.memory.state.data["motion_id"])


def requests(service: VirtualService) -> dict[str, Any]:
    """The ways in which somebody asks for a motion."""
    points = [{"positions": AWAY, "time_from_start": 5.0}]
    sequence = {"config": ("s.json", b"{}", "application/json")}
    return {
        "a motion": lambda: service.asking("POST", "/robot/move/joints", json=MOVE),
        "a trajectory": lambda: service.asking("POST", "/trajectory/send", json={"points": points}),
        "a sequence": lambda: service.asking("POST", "/sequences/start", files=sequence),
    }


@pytest.mark.parametrize("what", ["a motion", "a trajectory", "a sequence"])
def test_what_waited_for_a_service_that_stood_still_is_refused(service: VirtualService, what: str) -> None:
    before = motions(service)
    stand_still(service, 2.0)
    answer = service.end(service.begin(requests(service)[what]()))
    assert answer.status_code == 503, answer.text
    assert "the service was suspended for 2." in answer.json()["detail"]
    assert answer.json()["code"] == "unavailable"
    again = service.ask("POST", "/robot/move/joints", json=MOVE)
    assert again.status_code == 503, "it may have waited too: nobody knows"
    service.sleep(CATCH_UP_S)
    assert motions(service) == before
    service.go_home()
    assert "the service was suspended for 2." in service.output


def test_a_short_pause_is_nobody_s_business(service: VirtualService) -> None:
    stand_still(service, 0.9 * PAUSE_S)
    assert service.post("/robot/move/joints", MOVE).json()["success"]
    service.go_home()


@pytest.mark.parametrize("pause_s", [3.0, 100.0])
def test_a_motion_that_was_being_planned_does_not_begin_later(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch, pause_s: float
) -> None:
    """Its client may have given up; after 100 s its own time is up too, which is 60 s."""
    before, planned = motions(service), PlanningHere.compute

    async def plan_and_stand_still(self: PlanningHere, *arguments: Any) -> Any:
        found = await planned(self, *arguments)
        stand_still(service, pause_s)
        return found

    monkeypatch.setattr(PlanningHere, "compute", plan_and_stand_still)
    answer = service.post("/robot/move/joints", MOVE)
    service.sleep(5.0)
    assert motions(service) == before
    if pause_s > 60.0:
        assert answer.json()["code"] == "planning_timeout"
    else:
        assert answer.status_code == 503
        assert "was suspended" in answer.json()["detail"]


def test_a_stop_is_carried_out_whenever_it_was_asked_for(service: VirtualService) -> None:
    stand_still(service, 5.0)
    assert service.post("/stop").json()["success"]
