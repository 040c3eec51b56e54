"""Who controls the robot, on virtual time: over REST, the stream and rosbridge, and in the vendor's services.

Oracle: the design of the lease (docs/conventions.md), written out by hand; where the arm is.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import httpx
import pytest
from asgi_client import Socket
from virtual_service import VirtualService

from app.services.clients import CLIENT, RequestClient
from cobot.codes import Code
from cobot.errors import ConflictError

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.5, *HOME[1:]]
POINTS = {
    "points": [{"positions": HOME, "time_from_start": 0.0}, {"positions": AWAY, "time_from_start": 30.0}]
}
PATH = "/robot/control"


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    """Nobody has the control; the arm is at home."""
    service.go_home()
    yield service
    token = service.post(PATH, {"force": True}).json()["token"]
    called(service, "MotionControl", "setSpeedFraction", fraction=1.0, token=token)
    service.ask("DELETE", PATH, headers=shown(token))


def shown(token: str) -> dict[str, str]:
    return {"X-Control-Token": token}


def take(run: VirtualService, **body: Any) -> str:
    answer = run.post(PATH, body)
    assert answer.status_code == 200, answer.text
    token: str = answer.json()["token"]
    return token


def move(run: VirtualService, token: str = "") -> httpx.Response:
    body = {"joints": AWAY, "speed": 1.0}
    return run.ask("POST", "/robot/move/joints", json=body, headers=shown(token) if token else {})


def called(run: VirtualService, robot_class: str, method: str, token: str = "", **fields: Any) -> Any:
    headers = shown(token) if token else {}
    answer = run.ask("POST", f"/{run.name}/{robot_class}/{method}", json=fields, headers=headers)
    return answer.json()


def heard(socket: Socket, kind: str) -> dict[str, Any]:
    """The next frame of a type."""
    while True:
        frame: dict[str, Any] = json.loads(socket.recv())
        if kind in (frame.get("type"), frame.get("op")):
            return frame


def test_nobody_has_it_then_a_motion_has_then_nobody(run: VirtualService) -> None:
    free = run.get(PATH).json()
    assert (free["held"], free["holder"], free["how"], free["what"]) == (False, None, None, None)
    run.post("/trajectory/send", POINTS).raise_for_status()
    taken = run.get(PATH).json()
    assert (taken["held"], taken["holder"], taken["address"]) == (True, "anonymous", "127.0.0.1")
    assert (taken["how"], taken["until"]) == ("implicit", None)
    assert "POST /trajectory/send" in taken["what"]
    now_s = run.clock.wall_ns() * 1e-9
    assert 0.0 <= now_s - datetime.fromisoformat(taken["since"]).timestamp() < 1.0
    run.post("/stop").raise_for_status()
    assert run.get(PATH).json() == free


def test_who_has_taken_it_moves_and_others_are_told_who_has(run: VirtualService) -> None:
    token = take(run, timeout_s=20.0)
    state = run.get(PATH).json()
    assert (state["held"], state["how"], state["what"]) == (True, "explicit", None)
    until_s = datetime.fromisoformat(state["until"]).timestamp()
    assert 19.0 < until_s - run.clock.wall_ns() * 1e-9 <= 20.0 + 1e-6  # which ISO 8601 rounds it to
    refused = move(run)
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert "anonymous from 127.0.0.1 has control of the robot" in refused.json()["detail"]
    assert refused.json()["details"] == {"cause": "control", "by": "anonymous from 127.0.0.1"}
    assert run.post(PATH, {}).status_code == 409
    assert move(run, token).json()["success"]
    later_s = datetime.fromisoformat(run.get(PATH).json()["until"]).timestamp()
    assert later_s > until_s  # a motion renews it
    assert run.ask("DELETE", PATH).status_code == 409
    assert run.ask("DELETE", PATH, headers=shown(token)).json()["held"] is False
    assert move(run).json()["success"]


def test_every_way_to_move_asks_for_it_and_no_way_to_stop_does(run: VirtualService) -> None:
    token = take(run, timeout_s=600.0)
    ways = [
        ("/robot/move/named", {"json": {"name": "work"}}),
        ("/robot/move/pose", {"json": {"x": 0.5, "y": 0.0, "z": 0.5, "b": 3.1}}),
        ("/trajectory/send", {"json": POINTS}),
        ("/trajectory/send_csv", {"files": {"file": ("a.csv", b"x")}}),
        ("/sequences/start", {"files": {"config": ("a.json", b"{}")}}),
    ]
    for path, content in ways:
        refused = run.ask("POST", path, **content)
        assert refused.status_code == 409, path
        assert "has control of the robot" in refused.json()["detail"]
    for method, fields in (
        ("moveJoint", {"q": AWAY}),
        ("setServoMode", {"enable": True}),
        ("setSpeedFraction", {"fraction": 0.5}),
        ("startMove", {}),
    ):
        assert called(run, "MotionControl", method, **fields)["code"] == Code.CONFLICT, method
    with run.connect("/robot/stream") as socket:
        socket.send('{"type": "session"}')
        assert "has control of the robot" in heard(socket, "error")["detail"]
    run.ask("POST", "/trajectory/send", json=POINTS, headers=shown(token)).raise_for_status()
    assert called(run, "MotionControl", "stopJoint")["code"] == 0
    assert run.post("/stop").json()["success"]


def test_what_decides_how_its_motions_go_is_its_holders_alone(run: VirtualService) -> None:
    """And what only tells, or brings the arm to rest, is everybody's."""
    token = take(run, timeout_s=600.0)
    ball = {"objects": {"ball": {"shape": "sphere", "radius": 0.05, "x": -0.8, "y": 0.0, "z": 0.9}}}
    refused = run.post("/scene", ball)
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert "anonymous from 127.0.0.1 has control of the robot" in refused.json()["detail"]
    assert run.post("/robot/tool", {"mass": 0.5}).status_code == 409
    for refused in (
        run.post("/robot/positions", {"name": "beside", "joints": AWAY}),
        run.ask("DELETE", "/robot/positions/beside"),
        run.post("/robot/acknowledge", {"payload_checked": True}),
    ):
        assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert run.get("/scene").json()["objects"] == []
    slower = [0.5] * 7
    theirs = (
        ("RobotConfig", "setJointMaxSpeeds", {"speeds": slower}),
        ("RobotConfig", "resetLimits", {}),
        ("IoControl", "setStandardDigitalOutput", {"index": 0, "value": True}),
        ("ForceControl", "fcSetSensorThresholds", {"thresholds": [5.0] * 6}),
        ("SyncMove", "frameAdd", {"name": "table", "pose": [0.0] * 6}),
        ("SyncMove", "frameMove", {"name": "table", "pose": [0.1] * 6}),
        ("SyncMove", "frameAttach", {"frame": "table"}),
        ("SyncMove", "frameDelete", {"name": "table"}),
        ("SyncMove", "frameDeleteAll", {}),
        ("SyncMove", "axisGroupAdd", {"name": "both", "robots": [run.name]}),
        ("SyncMove", "axisGroupDelete", {"name": "both"}),
    )
    for robot_class, method, fields in theirs:
        answer = called(run, robot_class, method, **fields)
        assert answer["code"] == Code.CONFLICT, method
        assert "has control of the robot" in answer["message"]
        assert called(run, robot_class, method, token=token, **fields)["code"] == 0, method
    # Or its runProgram would run another one.
    assert called(run, "RuntimeMachine", "loadProgram", program="other.lua")["code"] == Code.CONFLICT
    everybodys = (
        ("RegisterControl", "setBool", {"key": "seen", "value": True}),
        ("RobotConfig", "getJointMaxSpeeds", {}),
        ("MotionControl", "stopJoint", {}),
    )
    for robot_class, method, fields in everybodys:
        assert called(run, robot_class, method, **fields)["code"] == 0, method
    for change in (ball, {"clear": True}):
        run.ask("POST", "/scene", json=change, headers=shown(token)).raise_for_status()
    assert called(run, "ForceControl", "fcSetSensorThresholds", token, thresholds=[0.0] * 6)["code"] == 0
    assert called(run, "RobotConfig", "resetLimits", token)["code"] == 0


def test_a_scene_that_somebody_looks_after_changes_during_motions_of_others(run: VirtualService) -> None:
    """As a camera's does: without a lease nobody has asked to be left alone."""
    run.post("/trajectory/send", POINTS).raise_for_status()
    run.sleep(3.0)
    ball = {"shape": "sphere", "radius": 0.05, "x": -0.8, "y": 0.0, "z": 0.9}
    assert run.post("/scene", {"objects": {"ball": ball}}).json()["stopped"] == ""
    assert run.post("/scene", {"clear": True}).status_code == 200
    assert run.post("/stop").json()["success"]


def test_it_expires_when_nothing_moves_and_not_during_a_long_motion(run: VirtualService) -> None:
    token = take(run, timeout_s=2.0)
    first, last = POINTS["points"]
    long = {"points": [first, last | {"time_from_start": 8.0}]}
    run.ask("POST", "/trajectory/send", json=long, headers=shown(token)).raise_for_status()
    run.sleep(6.0)
    assert run.get(PATH).json()["how"] == "explicit"
    run.until(lambda: run.get(PATH).json()["what"] is None)
    run.sleep(1.5)
    assert run.get(PATH).json()["held"]
    run.sleep(1.0)
    assert not run.get(PATH).json()["held"]
    assert "has expired" in move(run, token).json()["detail"]
    assert move(run).json()["success"]


def test_a_take_over_ends_the_motion_and_tells_the_former_holder(run: VirtualService) -> None:
    first = take(run)
    run.ask("POST", "/trajectory/send", json=POINTS, headers=shown(first)).raise_for_status()
    run.sleep(3.0)
    refused = run.post(PATH, {})
    assert refused.status_code == 409
    assert "POST /trajectory/send" in refused.json()["detail"]
    with run.listen("/events?types=stop") as events:
        answer = run.post(PATH, {"force": True})
        taken = answer.json()
        assert "POST /trajectory/send" in taken["stopped"][0]
        stop = events.event("stop")
    assert stop["data"]["reason"] == "anonymous from 127.0.0.1 has taken control"
    assert (taken["held"], taken["what"]) == (True, None)
    request, taking_over = run.get("/audit?limit=2").json()["entries"]
    assert (request["what"], request["outcome"]) == ("POST /robot/control", "200")
    assert (taking_over["what"], taking_over["outcome"]) == ("control taken over", "ok")
    assert taking_over["details"] == {"former": "anonymous from 127.0.0.1"}
    for each in (request, taking_over):
        assert (each["who"], each["request"]) == ("anonymous", answer.headers["x-request-id"])
        assert each["from"].startswith("127.0.0.1:")
    line = run.get("/trajectory/logs").json()["lines"][-1]
    assert "anonymous from 127.0.0.1 has taken control: the arm stopped" in line
    told = move(run, first)
    assert told.status_code == 409
    assert "was taken over by anonymous from 127.0.0.1" in told.json()["detail"]
    assert move(run, taken["token"]).json()["success"]


def test_a_stream_takes_it_and_loses_it_with_its_connection(run: VirtualService) -> None:
    with run.connect("/robot/stream") as socket:
        socket.send('{"type": "control", "timeout_s": 600}')
        token = heard(socket, "control")["token"]
        assert move(run).status_code == 409
        assert move(run, token).json()["success"]
        socket.send('{"type": "session"}')
        assert heard(socket, "session")
        socket.send('{"type": "end"}')
        assert heard(socket, "session_ended")
        socket.send('{"type": "release"}')
        heard(socket, "control_released")
        assert not run.get(PATH).json()["held"]
        socket.send('{"type": "control"}')
        heard(socket, "control")
    assert not run.get(PATH).json()["held"]
    assert move(run).json()["success"]


def test_who_only_looks_stops_the_arm_over_the_stream(run: VirtualService) -> None:
    """Whosever the control is. One that comes while another one is under way follows it."""
    token = take(run)
    body = {"joints": AWAY, "speed": 0.1}
    moving = run.begin(run.asking("POST", "/robot/move/joints", json=body, headers=shown(token)))
    run.until(lambda: run.health()["robot"]["mode"] == "TRAJECTORY")
    with run.connect(f"/robots/{run.name}/stream") as socket:
        for number in range(1, 101):
            socket.send(f'{{"type": "stop", "number": {number}}}')
        socket.send('{"type": "stop", "category": 1}')
        refused = heard(socket, "error")
        assert (refused["code"], refused["about"]) == ("input", "stop")
        stopped = [heard(socket, "stopped") for _ in range(2)]
        socket.send('{"type": "control"}')
        assert heard(socket, "error")["about"] == "control", "no third stop is answered before it"
    assert all(each["success"] for each in stopped)
    assert 1 <= stopped[0]["number"] < stopped[1]["number"] == 100
    assert "the arm is at rest" in stopped[0]["message"]
    ended = run.end(moving).json()
    assert ended["code"] == "stopped"
    assert "stopped over the WebSocket by anonymous from 127.0.0.1" in ended["message"]
    entries = [each for each in run.get("/audit").json()["entries"] if each["what"] == "stop"]
    assert len(entries) == 2
    assert entries[0]["who"] == "anonymous"


def test_a_stream_is_told_when_it_is_taken_over(run: VirtualService) -> None:
    with run.connect("/robot/stream") as socket:
        socket.send('{"type": "session"}')
        heard(socket, "session")
        assert run.get(PATH).json()["how"] == "implicit"
        take(run, force=True)
        assert heard(socket, "control_lost")["reason"] == "anonymous from 127.0.0.1 has taken control"
        assert heard(socket, "session_ended")["reason"] == "anonymous from 127.0.0.1 has taken control"


def test_a_client_of_rosbridge_takes_it_is_told_and_lets_go_by_leaving(run: VirtualService) -> None:
    def asked(socket: Socket, wanted: bool) -> dict[str, Any]:
        name = f"/{run.name}/take_control"
        socket.send(json.dumps({"op": "call_service", "service": name, "args": {"data": wanted}}))
        values: dict[str, Any] = heard(socket, "service_response")["values"]
        return values

    def moves(socket: Socket) -> Any:
        name = f"/{run.name}/MotionControl/moveJoint"
        socket.send(json.dumps({"op": "call_service", "service": name, "args": {"q": HOME}}))
        return heard(socket, "service_response")["values"]["code"]

    with run.connect("/rosbridge") as other:
        with run.connect("/rosbridge") as socket:
            assert asked(socket, True) == {"success": True, "message": ""}
            assert move(run).status_code == 409
            assert moves(other) == Code.CONFLICT
            assert moves(socket) == 0
            run.until(lambda: run.get(PATH).json()["what"] is None)
            assert asked(other, True)["success"] is False
            take(run, force=True)
            assert "has taken control" in heard(socket, "status")["msg"]
            assert moves(socket) == Code.CONFLICT
        run.ask("DELETE", PATH, headers=shown(take(run, force=True)))
        assert asked(other, True)["success"]
    assert not run.get(PATH).json()["held"]


def test_a_sequence_moves_for_who_has_started_it_and_its_speed_ends_with_it(run: VirtualService) -> None:
    token = take(run, timeout_s=5.0)
    ownership = run.app.state.services.ownership
    with pytest.raises(ConflictError, match="has control of the robot"):
        ownership.claim_for_sequence("sequence 1", "secret")
    before = CLIENT.set(RequestClient("anonymous", "127.0.0.1", frozenset({token})))
    ownership.claim_for_sequence("sequence 1", "secret")
    CLIENT.reset(before)
    body, own = {"joints": AWAY, "speed": 1.0}, {"X-Motion-Token": "secret"}
    assert run.ask("POST", "/robot/move/joints", json=body, headers=own).json()["success"]
    assert "has control of the robot" in move(run).json()["detail"]
    path, slower = f"/{run.name}/MotionControl/setSpeedFraction", {"fraction": 0.5}
    assert run.ask("POST", path, json=slower, headers=own).json()["code"] == 0
    run.sleep(20.0)
    assert run.get(PATH).json()["how"] == "explicit"  # as long as it runs
    ownership.release_sequence()
    assert run.get(PATH).json()["speed_fraction"] == 1.0
    run.sleep(6.0)
    assert not run.get(PATH).json()["held"]


def test_the_python_client_holds_it_for_a_block(run: VirtualService) -> None:
    with run.client(run.url) as robot, run.client(run.url) as other:
        with robot.control(timeout_s=30.0):
            assert robot.who_controls()["how"] == "explicit"
            robot.move_joints(AWAY, speed=1.0)
            with pytest.raises(ConflictError, match="has control of the robot"):
                other.move_joints(HOME, speed=1.0)
        other.move_joints(HOME, speed=1.0)
        with robot.control(), other.control(force=True):
            with pytest.raises(ConflictError, match="was taken over by"):
                robot.move_joints(AWAY)
            other.move_joints(AWAY, speed=1.0)
        robot.move_joints(HOME, speed=1.0)


@pytest.mark.parametrize("method", ["stopJoint", "stopLine"])
def test_anybodys_stop_stops_anybodys_motion(run: VirtualService, method: str) -> None:
    run.post("/trajectory/send", POINTS).raise_for_status()
    run.sleep(3.0)
    for queue_only in ("stopMove", "clearPath"):
        refused = called(run, "MotionControl", queue_only)
        assert refused["code"] == Code.CONFLICT
        assert "POST /trajectory/send" in refused["message"]
    assert called(run, "MotionControl", method)["code"] == 0
    assert called(run, "RobotState", "isSteady")["result"]
    line = run.get("/trajectory/logs").json()["lines"][-1]
    assert f"stopped by MotionControl/{method}: the arm stopped on its path" in line
    with run.connect("/robot/stream") as socket:
        socket.send('{"type": "session"}')
        heard(socket, "session")
        assert called(run, "MotionControl", method)["code"] == 0
        assert heard(socket, "session_ended")["reason"] == f"stopped by MotionControl/{method}"
    assert move(run).json()["success"]


def test_a_motion_that_cobot_stop_has_stopped_says_so(run: VirtualService) -> None:
    """That is, somebody on this computer, through shared memory; what POST /stop does says POST /stop."""
    for stop, who, by in (
        (run.rig.memory.outside_stops.add, "cobot stop", "cobot stop"),
        (lambda: run.post("/stop"), "POST /stop", "anonymous from 127.0.0.1"),
    ):
        run.post("/trajectory/send", POINTS).raise_for_status()
        run.sleep(3.0)
        stop()
        run.until(lambda: run.health()["service"]["motion"] is None)
        line = run.get("/trajectory/logs").json()["lines"][-1]
        assert f"stopped by {who}: the arm stopped on its path" in line
        details = run.get("/jobs?limit=1").json()["jobs"][0]["error"]["details"]
        assert (details["cause"], details["by"]) == ("stop", by)
        run.go_home()


def test_a_speed_fraction_set_during_a_session_does_not_slow_what_follows(run: VirtualService) -> None:
    with run.connect("/robot/stream") as socket:
        socket.send('{"type": "session"}')
        heard(socket, "session")
        refused = called(run, "MotionControl", "setSpeedFraction", fraction=0.1)
        assert refused["code"] == Code.CONFLICT
        assert "because it has no path" in refused["message"]
        socket.send('{"type": "end"}')
        heard(socket, "session_ended")
    assert called(run, "MotionControl", "getSpeedFraction")["result"] == 1.0
    began_s = run.clock.now_s()
    assert move(run).json()["success"]
    assert run.clock.now_s() - began_s < 3.0


@pytest.mark.parametrize("how", ["released", "expired", "taken over"])
def test_a_speed_fraction_ends_with_the_lease_of_who_has_set_it(run: VirtualService, how: str) -> None:
    called(run, "MotionControl", "setSpeedFraction", fraction=0.8)
    token = take(run, timeout_s=5.0)
    assert called(run, "MotionControl", "setSpeedFraction", token=token, fraction=0.3)["code"] == 0
    assert run.get(PATH).json()["speed_fraction"] == 0.3
    if how == "released":
        run.ask("DELETE", PATH, headers=shown(token))
    elif how == "expired":
        run.sleep(6.0)
    else:
        take(run, force=True)
    assert called(run, "MotionControl", "getSpeedFraction")["result"] == 0.8
    assert run.get(PATH).json()["speed_fraction"] == 0.8


def test_points_of_others_do_not_reach_a_session_of_who_has_the_control(run: VirtualService) -> None:
    token = take(run, timeout_s=60.0)
    assert called(run, "MotionControl", "setServoMode", token=token, enable=True)["code"] == 0
    assert called(run, "MotionControl", "servoJoint", token=token, q=HOME)["code"] == 0
    refused = called(run, "MotionControl", "servoJoint", q=HOME)
    assert refused["code"] == Code.CONFLICT
    assert "has control of the robot" in refused["message"]
    assert called(run, "MotionControl", "setServoMode", token=token, enable=False)["code"] == 0
