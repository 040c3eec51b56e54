"""GET /events and its WebSocket on virtual time; tests/e2e/test_events.py has what needs a network.

Oracles: a reader of text/event-stream after the HTML standard, made of `json` alone
(tests/support/asgi_client.py); what REST says about the same arm.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asgi_client import Closed, EventStream, Refused, Socket
from virtual_service import VirtualService, virtual_service

from app.api.routers.events import MAX_LISTENERS
from app.services.events.ring import TYPES

AWAY = [0.3, 0.2, 0.0, -1.2, 0.0, 1.4, 0.0]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    """One for all tests here."""
    with virtual_service(tmp_path_factory.mktemp("events")) as started:
        yield started


@pytest.fixture
def run(service: VirtualService) -> VirtualService:
    service.go_home()
    return service


def heard(events: EventStream, kind: str, what: str) -> dict[str, Any]:
    """The data of the next event of this kind that says this."""
    while (data := events.event(kind)["data"])["what"] != what:
        pass
    return data


def received(socket: Socket, *types: str) -> dict[str, Any]:
    while (found := json.loads(socket.recv()))["type"] not in types:
        pass
    return dict(found)


def test_a_motion_is_told_from_its_beginning_to_its_end(run: VirtualService) -> None:
    with run.listen("/events?types=motion,mode") as events:
        assert events.headers["content-type"].startswith("text/event-stream")
        answer = run.post("/robot/move/joints", {"joints": AWAY, "speed": 1.0}).json()
        begun = events.event("motion")
        assert begun["robot"] == run.name
        assert begun["data"] == {
            "what": "begun",
            "motion": answer["motion_id"],
            "duration_s": pytest.approx(answer["duration_s"], abs=1.0),
            "by": "anonymous from 127.0.0.1",
        }
        mode = events.event("mode")["data"]
        assert (mode["before"], mode["mode"]) == ("HOLD", "TRAJECTORY")
        finished = heard(events, "motion", "finished")
        assert finished["motion"] == answer["motion_id"]
        assert finished["path_time_s"] == finished["duration_s"] == begun["data"]["duration_s"]


def test_a_stop_is_told_with_who_and_the_motion_that_it_stopped(run: VirtualService) -> None:
    with run.listen("/events") as events:
        moving = run.begin(run.asking("POST", "/robot/move/joints", json={"joints": AWAY, "speed": 0.1}))
        number = heard(events, "motion", "begun")["motion"]
        run.ask("POST", "/stop", headers={"X-Request-Id": "press-1"})
        assert events.event("stop")["data"] == {
            "by": "anonymous from 127.0.0.1",
            "reason": "stopped by POST /stop",
            "cause": "stop",
            "request": "press-1",
            "category": 2,
        }
        stopped = heard(events, "motion", "stopped")
        assert stopped["motion"] == number
        assert stopped["path_time_s"] < stopped["duration_s"]
        run.end(moving)


def test_an_estop_and_the_way_out_of_it_are_told(run: VirtualService) -> None:
    with run.listen("/events?types=estop,mode,reset") as events:
        run.app.state.services.link.request_estop()
        asked = events.event("estop")["data"]
        assert asked["what"] == "asked for"
        assert events.event("mode")["data"]["mode"] == "ESTOP"
        latched = events.event("estop")["data"]
        assert (latched["what"], bool(latched["reason"])) == ("latched", True)
        run.post("/robot/reset").raise_for_status()
        assert events.event("reset")["data"] == {"by": "anonymous from 127.0.0.1"}
        assert events.event("mode")["data"]["mode"] == "HOLD"


def test_the_control_is_told_as_it_changes_hands(run: VirtualService) -> None:
    with run.listen("/events?types=lease") as events:
        first = run.post("/robot/control", {"timeout_s": 2.0}).json()["token"]
        taken = events.event("lease")["data"]
        assert taken == {"what": "taken", "holder": "anonymous", "address": "127.0.0.1", "timeout_s": 2.0}
        run.post("/robot/control", {"timeout_s": 2.0, "force": True})
        over = events.event("lease")["data"]
        assert (over["what"], over["by"]) == ("taken over", "anonymous from 127.0.0.1")
        assert events.event("lease")["data"]["what"] == "taken"
        assert events.event("lease")["data"]["what"] == "expired", "nobody has looked"
        assert first not in str(run.app.state.events.since(0, 5000)), "a token is nobody else's business"


def test_scene_tool_positions_and_sessions_are_told(run: VirtualService) -> None:
    with run.listen("/events?types=scene,tool,positions,session") as events:
        box = {"shape": "box", "size": [0.1, 0.1, 0.1], "x": 2.0, "y": 0, "z": 0}
        run.post("/scene", {"objects": {"box": box}}).raise_for_status()
        assert events.event()["type"] == "hello"
        assert events.event()["data"]["objects"] == ["box"]
        run.post("/scene", {"clear": True}).raise_for_status()
        assert events.event("scene")["data"]["objects"] == []
        run.post("/robot/tool", {"name": "gripper", "mass": 0.5}).raise_for_status()
        assert events.event("tool")["data"]["name"] == "gripper"
        run.post("/robot/tool", {"clear": True}).raise_for_status()
        run.post("/robot/positions", {"name": "beside"}).raise_for_status()
        assert events.event("positions")["data"] == {"what": "taught", "name": "beside", "label": "beside"}
        run.ask("DELETE", "/robot/positions/beside").raise_for_status()
        assert events.event("positions")["data"] == {"what": "forgotten", "name": "beside", "label": "beside"}
        with run.connect("/robot/stream") as socket:
            socket.send(json.dumps({"type": "session"}))
            begun = events.event("session")["data"]
            assert begun["what"] == "begun"
            assert begun["client"].startswith("a streaming client")
        assert heard(events, "session", "ended")["session"] == begun["session"]


def test_lines_of_the_log_are_told_and_their_number_is_bounded(run: VirtualService) -> None:
    log = logging.getLogger("cobot.somewhere")
    with run.listen("/events?types=log") as events:
        log.info("nothing to see")
        for number in range(10_000):
            log.warning("line %d\nof many", number)
        line = events.event("log")["data"]
        assert (line["level"], line["logger"]) == ("warning", "cobot.somewhere")
        assert line["message"] == r"line 0\nof many"
        run.sleep(10.0)
        log.error("the end")
        while line["message"] != "the end":
            line = events.event("log")["data"]
        assert line["held_back"] > 9000


def test_who_comes_back_gets_what_it_has_missed_and_nothing_twice(run: VirtualService) -> None:
    with run.listen("/events") as events:
        events.event("hello")
        run.post("/stop")
        events.event("stop")
        last = events.last_id
    run.post("/robot/control", {"timeout_s": 600})
    token = run.post("/robot/control", {"timeout_s": 600, "force": True}).json()["token"]
    known = int(last.partition("-")[2])
    with run.listen("/events?after=0", **{"Last-Event-ID": last}) as events:
        assert events.event()["id"] == known, "what the browser knows is newer than its address"
        missed = [events.event() for _ in range(3)]
        assert [each["id"] for each in missed] == sorted({each["id"] for each in missed})
        assert missed[0]["id"] > known
    with run.listen(f"/events?after={last}&types=lease") as events:
        found = [events.event("lease")["data"]["what"] for _ in range(3)]
        assert found == ["taken", "taken over", "taken"]
        run.ask("DELETE", "/robot/control", headers={"X-Control-Token": token}).raise_for_status()
        assert events.event("lease")["data"]["what"] == "released"


def test_everything_that_is_kept_begins_with_the_start_of_the_service(service: VirtualService) -> None:
    with service.listen("/events?after=0") as events:
        assert events.event("hello")["id"] == 0
        first = events.event("service", "lost")
        assert (first["type"], first["id"]) == ("service", 1)
        assert first["data"]["what"] == "started"
        assert first["data"]["robots"] == [service.name]
    with service.listen("/events", **{"Last-Event-ID": "0badcafe-12"}) as events:
        assert events.event("lost")["data"]["why"] == "restarted"


def test_states_come_at_the_rate_that_was_asked_for(run: VirtualService) -> None:
    with run.listen("/events?state_hz=50&types=mode") as events:
        events.event("state")
        run.sleep(2.0)
        state = events.event("state")
        count = 1
        begun_s = run.clock.now_s()
        while run.clock.now_s() - begun_s < 1.0:
            state = events.event("state")
            count += 1
        assert 140 <= count <= 160, "those of two seconds that waited to be read, and one second more"
    data = state["data"]
    assert "id" not in state
    assert data["mode"] == "HOLD"
    np.testing.assert_allclose(data["joints"], run.joints(), atol=1e-4)
    pose = run.get("/robot/pose").json()
    assert data["tcp"]["z"] == pytest.approx(pose["position"]["z"], abs=1e-3)
    assert data["tcp"]["qw"] == pytest.approx(pose["orientation"]["quaternion"]["w"], abs=1e-3)
    assert data["motion"] is None
    assert 0.0 <= data["utilisation"]["velocity"] < 0.01 < data["utilisation"]["effort"] < 1.0


def test_a_state_says_how_far_the_motion_is(run: VirtualService) -> None:
    with run.listen("/events?state_hz=100") as events:
        moving = run.begin(run.asking("POST", "/robot/move/joints", json={"joints": AWAY, "speed": 1.0}))
        while (motion := events.event("state")["data"]["motion"]) is None:
            pass
        assert motion["duration_s"] > motion["path_time_s"] >= 0.0
        run.end(moving)


def test_a_state_says_how_old_it_is(run: VirtualService) -> None:
    run.cycles[run.name].stopped = True
    try:
        with run.listen("/events?state_hz=10") as events:
            assert events.event("rtloop")["data"] == {"what": "silent"}
            while events.event("state")["data"]["age_s"] < 0.5:
                pass
    finally:
        run.cycles[run.name].stopped = False
    run.until(run.healthy)


def test_the_websocket_says_the_same(run: VirtualService) -> None:
    with run.connect("/events?state_hz=10&types=stop,service") as socket:
        hello = json.loads(socket.recv())
        assert (hello["type"], hello["epoch"]) == ("hello", run.app.state.events.epoch)
        run.post("/stop")
        stop = received(socket, "stop")
        assert stop["id"] > hello["id"]
        assert received(socket, "state")["robot"] == run.name
        socket.send("what is this?" * 1000)
        socket.send(b"\x00" * 1000)
        assert received(socket, "state")["data"]["mode"] == "HOLD"
    with run.connect(f"/events?after={hello['epoch']}-{hello['id']}") as socket:
        assert received(socket, "stop")["id"] == stop["id"]
    with run.connect("/events?types=fault") as socket:
        assert received(socket, "alive")["id"] >= stop["id"]


@pytest.mark.parametrize(
    ("query", "status", "words"),
    [
        ("state_hz=nan", 422, "state_hz: "),
        ("state_hz=inf", 422, "state_hz: "),
        ("state_hz=0", 422, "greater than or equal to 0.1, got '0'"),
        ("state_hz=101", 422, "less than or equal to 100, got '101'"),
        ("state_hz=-1e309", 422, "state_hz: "),
        ("state_hz=fast", 422, "state_hz: "),
        ("after=99999999999999999999", 422, "has not happened yet; the newest event is "),
        ("after=99999999999999999999999999999999", 422, "is neither EPOCH-NUMBER nor a number"),
        ("after=-1", 422, "is neither EPOCH-NUMBER nor a number"),
        ("after=", 422, "is neither EPOCH-NUMBER nor a number"),
        ("types=mode,moed", 422, "types: 'moed' is not an event type; valid types: service, rtloop, mode"),
        ("types=", 422, "types: '' is not an event type"),
        ("type=mode", 422, "did you mean 'types'?"),
        ("robot=nobody", 404, "robot: 'nobody' is not a robot of this service; valid names: "),
    ],
)
def test_what_makes_no_sense_is_refused_on_both_ways(
    run: VirtualService, query: str, status: int, words: str
) -> None:
    with run.listen(f"/events?{query}") as events:
        answer = json.loads(events.body())
    assert (events.status, answer["code"]) == (status, "not_found" if status == 404 else "input")
    assert words in answer["detail"]
    with pytest.raises(Refused) as refused:
        run.connect(f"/events?{query}")
    assert refused.value.status == status
    assert words in json.loads(refused.value.body)["detail"]


def test_who_goes_is_forgotten_and_who_is_one_too_many_is_refused(run: VirtualService) -> None:
    ring = run.app.state.events
    listeners = [run.listen("/events") for _ in range(MAX_LISTENERS)]
    assert len(ring.on_news) == MAX_LISTENERS
    with run.listen("/events") as events:
        assert events.status == 503
        assert "224 clients already listen to events" in json.loads(events.body())["detail"]
    with pytest.raises(Refused) as refused:
        run.connect("/events")
    assert refused.value.status == 503
    for each in listeners:
        each.close()
    run.connect("/events").close()
    assert not ring.on_news


def test_one_robot_of_several_is_heard_alone(pair: VirtualService) -> None:
    left, right = pair.names
    with (
        pair.listen(f"/robots/{right}/events?types=stop,service") as by_path,
        pair.listen(f"/events?robot={right}&types=stop&state_hz=10") as by_query,
        pair.listen("/events?types=stop&state_hz=10") as both,
    ):
        for name in pair.names:
            pair.post(f"/robots/{name}/stop")
        assert [both.event("stop")["robot"] for _ in range(2)] == [left, right]
        assert by_path.event("stop")["robot"] == right
        assert by_query.event("stop")["robot"] == right
        assert {both.event("state")["robot"] for _ in range(8)} == {left, right}
        assert {by_query.event("state")["robot"] for _ in range(8)} == {right}
        pair.app.state.events.publish("service", what="tested")
        assert by_path.event("service")["robot"] is None
    with pair.listen(f"/robots/{right}/events?robot={left}") as events:
        assert events.status == 404
    with pair.listen("/robots/nobody/events") as events:
        assert events.status == 404


def test_listening_ends_with_the_service(tmp_path: Path) -> None:
    with virtual_service(tmp_path) as own:
        events, socket = own.listen("/events"), own.connect("/events")
        own.app.state.events.close()
        assert heard(events, "service", "ends") == {"what": "ends"}
        with pytest.raises(Closed):
            events.event()
        assert received(socket, "service")["data"] == {"what": "ends"}
        with pytest.raises(Closed):
            received(socket, "alive")
        with own.listen("/events") as late:
            assert late.status == 503


def test_every_type_is_in_the_documentation() -> None:
    page = (Path(__file__).parents[4] / "docs" / "events.md").read_text(encoding="utf-8")
    for kind in (*TYPES, "hello", "lost", "alive", "state"):
        assert f"| `{kind}` |" in page
