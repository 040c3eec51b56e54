"""What was refused that would have moved or changed something is an event, whoever asked and over whatever.

Oracle: the answers that who has asked has got.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from mcp_agent import HOME, Agent, token
from virtual_service import VirtualService, virtual_service

from app.services.events.ring import LOG_BURST
from cobot.access.roles import Role
from cobot.addresses import address

Heard = Callable[[], list[dict[str, Any]]]
FAR = {"joints": [9.0, *HOME[1:]]}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    with virtual_service(
        tmp_path_factory.mktemp("refused"), more="web: {tokens: tokens.json}\nmcp: {execution: approved}\n"
    ) as started:
        yield started


@pytest.fixture
def heard(run: VirtualService) -> Callable[[], list[dict[str, Any]]]:
    """What has been refused in the test so far."""
    run.sleep(60.0)  # nothing of what was before is held back
    events = run.app.state.events
    begun = events.newest

    def told() -> list[dict[str, Any]]:
        return [each for each in map(json.loads, texts()) if each["type"] == "refused"]

    def texts() -> list[str]:
        return [each.text for each in events.since(begun, 1000)]

    return told


def test_a_motion_that_is_refused_is_told_to_all_with_who_and_why(run: VirtualService, heard: Heard) -> None:
    """By its body, by who has the control, by what is not there."""
    answers = [run.ask("POST", "/robot/move/joints", json=FAR)]
    lease = run.ask("POST", "/robot/control", json={"timeout_s": 60.0}).json()["token"]
    answers.append(run.ask("POST", "/robot/move/named", json={"name": "work"}))
    run.ask("DELETE", "/robot/control", headers={"X-Control-Token": lease})
    answers.append(run.ask("POST", address("", run.name) + "/move/named", json={"name": "nowhere"}))
    answers.append(run.ask("PUT", "/robot/io/Gripper.Close", json={"value": True}))
    assert [each.status_code for each in answers] == [422, 409, 422, 404]
    assert [each["data"] for each in heard()] == [
        {
            "by": "anonymous from 127.0.0.1",
            "what": f"{each.request.method} {each.request.url.path}",
            "code": each.json()["code"],
            "reason": each.json()["detail"],
        }
        for each in answers
    ]
    assert {each["robot"] for each in heard()} == {run.name}


def test_reads_plans_and_what_is_done_are_not_told(run: VirtualService, heard: Heard) -> None:
    assert run.ask("GET", "/jobs/nobody").status_code == 404
    assert run.ask("POST", "/robot/plan/joints", json=FAR).status_code == 422
    assert run.ask("POST", f"/{run.name}/RobotState/getTcp", json={"a": 1}).status_code in (404, 422)
    assert run.ask("POST", "/robot/move/named", json={"name": "home"}).json()["success"]
    assert run.ask("POST", "/nothing").status_code == 404
    assert heard() == []


def test_whose_role_does_not_suffice_is_told(run: VirtualService, heard: Heard) -> None:
    shown = {"authorization": f"Bearer {token(run, Role.OBSERVER)}"}
    answer = run.ask("POST", "/robot/move/named", json={"name": "work"}, headers=shown)
    assert answer.status_code == 403
    with run.connect("/robot/stream", **shown) as socket:
        socket.send(json.dumps({"type": "jog", "joints": [0.1] * 7}))
        run.until(lambda: len(heard()) == 2)
    told = [each["data"] for each in heard()]
    assert [each["what"] for each in told] == ["POST /robot/move/named", "jog on the stream"]
    assert {each["code"] for each in told} == {"forbidden"}
    assert all(each["by"].startswith("observer") and "operator" in each["reason"] for each in told)


def test_of_vendor_services_streams_actions_and_agents_it_is_told_too(
    run: VirtualService, heard: Heard
) -> None:
    robot = run.name
    moved = run.ask(
        "POST", f"/{robot}/MotionControl/moveJoint", json={"q": FAR["joints"], "a": 1.0, "v": 1.0}
    )
    assert moved.json()["code"] != 0
    assert run.ask("POST", f"/{robot}/MotionControl/moveJoint", json={"q": "up"}).status_code == 422
    with run.connect("/robot/stream") as socket:
        socket.send(json.dumps({"type": "jog", "joints": [0.1]}))
        run.until(lambda: len(heard()) == 3)
    said = Agent(run, token(run, Role.AGENT)).refused("execute", plan_id="nothing")
    told = [each["data"] for each in heard()]
    assert [each["what"] for each in told] == [
        f"{robot}/MotionControl/moveJoint",
        f"POST /{robot}/MotionControl/moveJoint",
        "jog on the stream",
        "MCP execute",
    ]
    assert told[0]["reason"] == moved.json()["message"]
    assert told[3]["reason"] in said
    assert told[3]["by"].startswith("agent")
    assert told[3]["code"] == "not_found"


def test_who_asks_in_vain_for_ever_pushes_out_nothing(run: VirtualService, heard: Heard) -> None:
    for _ in range(5 * LOG_BURST):
        run.ask("POST", "/robot/move/named", json={"name": "nowhere"})
    assert len(heard()) <= 2 * LOG_BURST
    run.sleep(10.0)
    run.ask("POST", "/robot/move/named", json={"name": "nowhere" * 1000})
    last = heard()[-1]["data"]
    assert last["held_back"] >= 3 * LOG_BURST
    assert len(last["reason"]) <= 320
