"""Who did what, over every transport; and the ids by which lines of the log are found.

Oracle: the list of the application's own routes and vendor services; the audit file, read by json.
"""

from __future__ import annotations

import hashlib
import json
import logging
import re
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from asgi_client import Refused
from cobot_run import WAIT_S
from fastapi.routing import APIRoute
from virtual_service import VirtualService

from app.aubo.classes import REGISTRY
from cobot.logs.lines import Line

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
CSV = "joint1,joint2,joint3,joint4,joint5,joint6,joint7,t\n"
BODIES: dict[str, dict[str, Any]] = {
    "/trajectory/send_csv": {"files": {"file": ("points.csv", CSV)}},
    "/sequences/start": {"files": {"config": ("a.json", "{}")}, "data": {"n_iterations": "0"}},
    "/stop": {},
    "/robot/reset": {},
    "/robot/control": {"json": {"timeout_s": 0}},  # refused, too: the tests that follow have no lease
    "/robot/freedrive": {"json": {"timeout_s": 0}},  # likewise: they have the arm
}
WRONG_QUERIES: list[dict[str, object]] = [
    {"limit": 0},
    {"limit": 1001},
    {"since": "yesterday"},
    {"since": "0001-01-01T00:00:00+14:00"},
    {"who": "ada"},
]
READ = {"getDof", "isPowerOn", "hasNamedVariable", "peek", "socketReadLine", "frameGetPose", "poseAdd"}
CHANGES = r"set|move|stop|start|poweron|modbusSet|\w+(Delete|Add|Open|Close)"
WRITTEN = {"setSpeedFraction", "moveJoint", "stopJoint", "setTcpOffset", "startup", "loadProgram", "textmsg"}


@pytest.fixture(scope="module")
def run(service: VirtualService) -> VirtualService:
    return service


def entries(run: VirtualService, **query: object) -> list[dict[str, Any]]:
    answer = run.ask("GET", "/audit", params={"limit": 1000, **query})
    assert answer.status_code == 200, answer.text
    found: list[dict[str, Any]] = answer.json()["entries"]
    return found


def entry(run: VirtualService, request: str) -> dict[str, Any]:
    """Of a request."""
    (found,) = [each for each in entries(run) if each["request"] == request]
    return found


def ask(run: VirtualService, method: str, path: str, **content: Any) -> tuple[int, str]:
    """The status, and the id of the request."""
    answer = run.ask(method, path, **content)
    return answer.status_code, answer.headers["x-request-id"]


def test_every_endpoint_that_changes_something_leaves_an_entry(run: VirtualService) -> None:
    """A route that somebody adds is here by itself."""
    paths = [
        (method, route.path)
        for route in run.app.routes
        if isinstance(route, APIRoute)
        for method in route.methods
        if method != "GET"
    ]
    assert {path for _, path in paths} > {"/stop", "/robot/reset", "/robots/{robot}/stop", "/sequences/start"}
    for method, template in paths:
        path = template.format(
            robot=run.name,
            Class="RobotConfig",
            method="setPayload",
            name="table",
            job="1",
            plan="1",
            program="p",
            study="s",
        )
        plain = re.sub(r"^/robots/[^/]+", "", path)
        if plain not in BODIES and plain.startswith(("/move", "/reset", "/control", "/freedrive")):
            plain = f"/robot{plain}"
        status, request = ask(run, method, path, **BODIES.get(plain, {"json": {}}))
        found = entry(run, request)
        assert (found["who"], found["what"]) in (
            ("anonymous", f"{method} {path}"),
            ("anonymous", path.removeprefix("/")),
        )
        assert found["outcome"] == str(status) or template.startswith("/{robot}/"), found
        assert found["from"].startswith("127.0.0.1:")


def test_every_vendor_service_says_whether_it_changes_something() -> None:
    """By their names; those of which a name does not tell are in a list above."""
    for (robot_class, method), found in REGISTRY.items():
        reads = method in READ or method.startswith("get") or robot_class in ("RobotState", "Math")
        if reads or method in WRITTEN or re.match(CHANGES, method):
            assert found.changes is not reads, f"{robot_class}/{method}"


def test_what_only_reads_leaves_none(run: VirtualService) -> None:
    for method, path in (
        ("GET", "/robot/joint_states"),
        ("GET", "/health"),
        ("GET", "/audit"),
        ("POST", f"/{run.name}/RobotConfig/getDof"),
        ("GET", "/nowhere"),
    ):
        _, request = ask(run, method, path)
        assert request not in {each["request"] for each in entries(run)}


def test_an_entry_tells_what_became_of_it(run: VirtualService) -> None:
    _, request = ask(run, "POST", "/robot/move/named", json={"name": "home", "speed": 1.0})
    assert entry(run, request)["details"].keys() >= {"motion"}
    _, request = ask(run, "POST", "/robot/move/named", json={"name": "nowhere"})
    found = entry(run, request)
    assert (found["outcome"], found["details"]["code"]) == ("422", "input")
    assert "nowhere" in found["details"]["error"]
    _, request = ask(run, "POST", "/stop")
    assert "at rest" in entry(run, request)["details"]["message"]
    _, request = ask(run, "POST", f"/{run.name}/MotionControl/setSpeedFraction", json={"fraction": 0.5})
    found = entry(run, request)
    assert (found["what"], found["outcome"]) == (f"{run.name}/MotionControl/setSpeedFraction", "ok")
    assert "0.5" in found["details"]["arguments"]
    _, request = ask(run, "POST", f"/{run.name}/MotionControl/setSpeedFraction", json={"fraction": 7})
    assert entry(run, request)["outcome"] != "ok"
    ask(run, "POST", f"/{run.name}/MotionControl/setSpeedFraction", json={"fraction": 1.0})


def test_an_upload_is_known_by_its_digest(run: VirtualService) -> None:
    files = {"config": ("a\x1b[2J.json", b"{}")}
    status, request = ask(run, "POST", "/sequences/start", files=files, data={"bag_path": "../../x"})
    assert status == 422
    details = entry(run, request)["details"]
    assert details["sha256"] == "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"
    assert details["bytes"] == 2
    assert details["file"].isprintable()
    _, request = ask(run, "POST", "/trajectory/send_csv", files={"file": ("points.csv", CSV)})
    details = entry(run, request)["details"]
    assert details["sha256"] == hashlib.sha256(CSV.encode()).hexdigest()
    assert (details["file"], details["bytes"]) == ("points.csv", len(CSV))


def test_a_websocket_is_opened_and_closed_and_its_session_too(run: VirtualService) -> None:
    socket = run.connect("/robot/stream")
    json.loads(socket.recv())
    socket.send(json.dumps({"type": "session"}))
    assert json.loads(socket.recv())["type"] == "session"
    socket.send(json.dumps({"type": "end"}))
    run.until(lambda: any(each["what"] == "session ended" for each in entries(run)))
    socket.close()
    run.until(lambda: any(each["what"] == "WS /robot/stream closed" for each in entries(run)))
    found = [each for each in entries(run) if "session" in each["what"] or "WS /robot/stream" in each["what"]]
    whats = [each["what"] for each in reversed(found)]
    assert whats == ["WS /robot/stream opened", "session opened", "session ended", "WS /robot/stream closed"]
    assert len({each["request"] for each in found}) == 1
    run.go_home()


def test_a_websocket_that_is_refused_leaves_its_attempt(run: VirtualService) -> None:
    with pytest.raises(Refused):
        run.connect("/robot/stream", origin="http://evil.example")
    assert [each["what"] for each in entries(run, limit=1)] == ["WS /robot/stream refused"]


def test_what_rosbridge_changes_leaves_entries_and_what_it_reads_does_not(run: VirtualService) -> None:
    socket = run.connect("/rosbridge")

    def call(service: str, **arguments: object) -> None:
        socket.send(
            json.dumps({"op": "call_service", "service": f"/{run.name}/{service}", "args": arguments})
        )
        while json.loads(socket.recv(WAIT_S))["op"] != "service_response":
            pass

    call("RobotConfig/getDof")
    call("IoControl/setStandardDigitalOutput", index=0, value=True)
    message = {"data": json.dumps({"type": "fjt_control", "enable": True})}
    socket.send(json.dumps({"op": "advertise", "topic": f"/{run.name}/joint_cmd", "type": "std_msgs/String"}))
    socket.send(json.dumps({"op": "publish", "topic": f"/{run.name}/joint_cmd", "msg": message}))
    goal = {"trajectory": {"joint_names": ["nobody"]}}
    action = f"/{run.name}/follow_joint_trajectory"
    send = {"op": "send_action_goal", "id": uuid.uuid4().hex, "action": action}
    socket.send(json.dumps({**send, "args": goal}))
    while json.loads(socket.recv(WAIT_S))["op"] != "action_result":
        pass
    found = [each for each in entries(run) if each["request"] == entries(run)[0]["request"]]
    whats = [each["what"] for each in reversed(found)]
    assert whats[:2] == ["WS /rosbridge opened", f"{run.name}/IoControl/setStandardDigitalOutput"]
    assert whats[2:] == ["joint_cmd", f"goal of {action}"]
    assert not any("getDof" in what for what in whats)
    socket.close()


def test_the_clients_id_is_taken_when_it_is_well_formed(run: VirtualService) -> None:
    mine = f"my-request.{uuid.uuid4().hex}"
    assert ask(run, "POST", "/stop", headers={"X-Request-Id": mine}) == (200, mine)
    assert entry(run, mine)["what"] == "POST /stop"
    for wrong in ("x" * 65, "two words", "a\x7f", '{"a":1}', ""):
        _, request = ask(run, "GET", "/health", headers={"X-Request-Id": wrong})
        assert request != wrong
        assert re.fullmatch(r"[0-9a-f]{8}-[0-9a-f]+", request)
    assert len({ask(run, "GET", "/health")[1] for _ in range(20)}) == 20


class Lines(logging.Handler):
    """What the service's own handler makes of records, in the context of who logs."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[Line] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(Line.of(record, "service"))


@pytest.fixture
def lines() -> Iterator[list[Line]]:
    handler = Lines()
    logger = logging.getLogger("cobot")
    logger.addHandler(handler)
    yield handler.lines
    logger.removeHandler(handler)


def test_lines_of_a_motion_have_its_id_and_that_of_its_request(
    run: VirtualService, lines: list[Line]
) -> None:
    points = [{"positions": run.joints(), "time_from_start": 0.0}]
    points.append({"positions": [0.1, *run.joints()[1:]], "time_from_start": 2.0})
    answer = run.post("/trajectory/send", {"points": points})
    assert answer.status_code == 200, answer.text
    motion, request = str(answer.json()["motion_id"]), answer.headers["x-request-id"]
    run.until(lambda: any("arrived and settled" in each.message for each in lines))
    told = [each for each in lines if each.logger == "cobot.trajectories"]
    assert len(told) == 2
    for each in told:
        assert (each.ids["motion"], each.ids["request"]) == (motion, request)
        assert each.ids["client"] == "127.0.0.1"
    assert entry(run, request)["details"]["motion"] == int(motion)
    run.go_home()


def test_a_clients_text_is_one_line_of_its_request(run: VirtualService, lines: list[Line]) -> None:
    text = "hello\n2026-11-22T00:00:00.000+00:00 INFO service: motion 7: arrived\x1b[2J"
    _, request = ask(run, "POST", f"/{run.name}/Trace/textmsg", json={"msg": text})
    (made,) = [each for each in lines if each.logger == "cobot.trace"]
    assert made.text().decode().count("\n") == 1
    assert made.ids["request"] == request


@pytest.mark.parametrize("path", ["/no%0Awhere", "/robots/%1b%5b2J/stop", "/%E2%80%A8/Trace/textmsg"])
def test_paths_can_forge_nothing(run: VirtualService, path: str) -> None:
    _, request = ask(run, "POST", path)
    found = entry(run, request)
    assert found["outcome"] == "404"
    assert found["what"].isprintable()


def test_health_tells_what_was_lost(run: VirtualService, tmp_path: Path) -> None:
    health = run.health()
    assert health["service"]["lost_lines"] == {"service": 0, "file": 0, "terminal": 0, "audit": 0}
    audit = run.app.state.audit
    audit.problem = "no room"
    health = run.health()
    audit.problem = ""
    assert health["status"] == "degraded"
    assert "the audit: no room" in health["problems"]


@pytest.mark.parametrize("query", WRONG_QUERIES)
def test_a_wrong_question_is_refused(run: VirtualService, query: dict[str, object]) -> None:
    assert run.ask("GET", "/audit", params=query).status_code == 422


def test_since_is_utc_without_a_zone(run: VirtualService) -> None:
    first = entries(run, limit=2)[1]
    for zone in ("Z", "", "+00:00"):
        since = first["time"].removesuffix("Z") + zone
        assert len(entries(run, since=since)) >= 2
    assert entries(run, since="2999-01-01T00:00:00") == []
