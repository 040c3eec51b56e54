"""The REST API over real HTTP, against a running simulation on the fast clock.

Oracles: the manual's table of endpoints and statuses, scipy's rotations, numpy, the state that the
service reports after a refusal.
"""

from __future__ import annotations

import io
import socket
import threading
import time
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, Run, until
from foreign_trajectories import trapezoid
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0]
MANUAL = {
    ("get", "/robot/joint_states"),
    ("get", "/robot/pose"),
    ("get", "/robot/positions"),
    ("post", "/robot/positions"),
    ("post", "/robot/move/named"),
    ("post", "/robot/move/pose"),
    ("post", "/robot/move/arc"),
    ("post", "/robot/move/sequence"),
    ("post", "/robot/move/joints"),
    ("post", "/robot/plan/named"),
    ("post", "/robot/plan/joints"),
    ("post", "/robot/plan/pose"),
    ("post", "/robot/plan/arc"),
    ("post", "/robot/plan/path"),
    ("post", "/robot/plan/sequence"),
    ("post", "/robot/plan/gripper"),
    ("post", "/robot/execute"),
    ("get", "/robot/motion"),
    ("get", "/robot/plans"),
    ("post", "/robot/approve"),
    ("post", "/trajectory/send"),
    ("post", "/trajectory/send_csv"),
    ("get", "/trajectory/logs"),
    ("post", "/sequences/start"),
    ("get", "/sequences/status"),
    ("get", "/sequences/logs"),
    ("post", "/stop"),
}


def joints(http: httpx.Client) -> list[float]:
    return http.get("/robot/joint_states").json()["position"]


def motion(http: httpx.Client) -> dict[str, Any]:
    return http.get("/health").json()["robot"]


def slow_trajectory(http: httpx.Client) -> int:
    """Start a motion that takes more robot time than any test."""
    body = {"points": [{"positions": AWAY, "time_from_start": 3000.0}]}
    answer = http.post("/trajectory/send", json=body)
    assert answer.status_code == 200, answer.text
    return answer.json()["motion_id"]


def test_every_endpoint_of_the_manual_is_in_the_schema(http: httpx.Client) -> None:
    paths = http.get("/openapi.json").json()["paths"]
    assert {(method, path) for path, methods in paths.items() for method in methods} >= MANUAL


def test_the_documentation_needs_no_internet(http: httpx.Client) -> None:
    for page in ("/docs", "/redoc"):
        html = http.get(page).text
        assert "//" not in html.replace("http://www.w3.org", "").split("<body>")[0].replace("<!--", "")
        scripts = [part.split('"')[0] for part in html.split('src="')[1:]]
        assert scripts
        for script in scripts:
            assert script.startswith("/")
            assert http.get(script).status_code == 200


def test_the_state_is_what_the_manual_shows(http: httpx.Client) -> None:
    state = http.get("/robot/joint_states").json()
    assert set(state) == {"name", "position", "velocity", "effort"}
    assert state["name"] == [f"joint{n}" for n in range(1, 8)]
    np.testing.assert_allclose(state["position"], HOME, atol=1e-3)
    np.testing.assert_allclose(state["velocity"], 0.0, atol=5e-3)
    assert abs(state["effort"][1]) > 5.0, "joint 2 carries the arm"


def test_the_pose_states_one_orientation_in_three_ways(http: httpx.Client) -> None:
    pose = http.get("/robot/pose").json()
    assert pose["frame_id"] == "base_link"
    np.testing.assert_allclose([pose["position"][k] for k in "xyz"], [0.4, 0.0, 0.65], atol=0.01)
    orientation = pose["orientation"]
    quaternion = Rotation.from_quat([orientation["quaternion"][k] for k in "xyzw"])
    rad = [orientation["euler_rad"][k] for k in "abc"]
    assert (Rotation.from_euler("ZYX", rad).inv() * quaternion).magnitude() < 1e-6
    np.testing.assert_allclose([orientation["euler_deg"][k] for k in "abc"], np.degrees(rad), atol=1e-9)
    assert quaternion.apply([0.0, 0.0, 1.0])[2] == pytest.approx(-1.0, abs=1e-3), "the tool points down"


def test_the_named_positions_are_those_of_the_srdf(http: httpx.Client) -> None:
    positions = http.get("/robot/positions").json()
    assert [position["name"] for position in positions] == ["home", "work", "transport"]
    assert all(
        set(position) == {"name", "label", "group", "description", "joints", "taught"}
        for position in positions
    )
    assert positions[0]["joints"] == HOME


@pytest.mark.parametrize(
    ("path", "body", "goal"),
    [
        ("/robot/move/joints", {"joints": AWAY, "speed": 1.0}, AWAY),
        ("/robot/move/joints", {"joints": [0, 0.25, 0, -1.57, 0, 1.57, 0], "speed": 1}, None),
        ("/robot/move/named", {"name": "work", "speed": 0.9, "accel_scale": 0.5}, None),
    ],
)
def test_a_joint_motion_answers_when_the_arm_has_arrived(
    http: httpx.Client, path: str, body: dict[str, Any], goal: list[float] | None
) -> None:
    answer = http.post(path, json=body).json()
    assert answer["success"] is True
    assert answer["message"] == "Motion completed successfully"
    if goal is None:
        goal = body.get("joints") or next(
            p["joints"] for p in http.get("/robot/positions").json() if p["name"] == body["name"]
        )
    np.testing.assert_allclose(joints(http), goal, atol=1e-3)


@pytest.mark.parametrize("planner", ["ptp", "LIN", "circ", "ompl", "chomp", "auto"])
def test_every_planner_brings_the_tcp_to_the_pose(http: httpx.Client, planner: str) -> None:
    body: dict[str, Any] = {"x": 0.45, "y": 0.1, "z": 0.5, "b": 3.14159, "speed": 0.8, "planner": planner}
    if planner == "circ":
        body["via"] = {"x": 0.45, "y": 0.0, "z": 0.6}
    answer = http.post("/robot/move/pose", json=body).json()
    assert answer["success"], answer
    position = http.get("/robot/pose").json()["position"]
    np.testing.assert_allclose([position[k] for k in "xyz"], [0.45, 0.1, 0.5], atol=2e-3)


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/robot/move/joints", {"joints": [0.3, 0.1, 0.0, -1.5, 0.0, 1.5, 0.0]}),
        ("/robot/move/named", {"name": "work"}),
        ("/robot/move/pose", {"x": 0.45, "y": 0.0, "z": 0.5, "b": 3.14159}),
    ],
)
def test_auto_says_what_it_took_and_the_others_say_nothing(
    http: httpx.Client, path: str, body: dict[str, Any]
) -> None:
    answer = http.post(path, json={**body, "speed": 0.8, "planner": "Auto"}).json()
    assert answer["success"], answer
    assert answer["note"] == "auto used ptp: the direct joint motion is free"
    back = http.post("/robot/move/joints", json={"joints": HOME, "speed": 0.8, "planner": "ompl"}).json()
    assert back["success"], back
    assert back["note"] == ""
    refused = http.post(path, json={**body, "planner": "ompl", "algorithm": "A*"})
    assert refused.status_code == 422
    assert "algorithm" in refused.json()["detail"]


def test_a_motion_to_where_the_arm_is_succeeds_without_one(http: httpx.Client) -> None:
    answer = http.post("/robot/move/joints", json={"joints": HOME}).json()
    assert answer["success"] is True
    assert answer["motion_id"] is None


@pytest.mark.parametrize(
    ("body", "code", "words"),
    [
        ({"x": 3.0, "y": 0.0, "z": 0.5}, "unreachable", ["x 3,", "mm"]),
        ({"x": 0.4, "y": 0.0, "z": -0.2, "b": 3.14159}, None, []),
        ({"x": -0.5, "y": 0.1, "z": 0.5, "b": 3.14159, "planner": "lin"}, None, ["lin"]),
    ],
)
def test_a_pose_that_cannot_be_reached_says_why_and_nothing_moves(
    http: httpx.Client, body: dict[str, Any], code: str | None, words: list[str]
) -> None:
    before = motion(http)["motion_id"]
    response = http.post("/robot/move/pose", json=body)
    answer = response.json()
    assert response.status_code == 200
    assert answer["success"] is False
    assert answer["motion_id"] is None
    assert code is None or answer["code"] == code
    assert all(word in answer["message"] for word in words), answer["message"]
    assert motion(http)["motion_id"] == before


BAD_BODIES: list[tuple[str, Any, list[str]]] = [
    ("/robot/move/joints", {"joints": [0] * 6}, ["joints must have 7 angles, got 6"]),
    ("/robot/move/joints", {"joints": [9, 0, 0, 0, 0, 0, 0]}, ["joint1", "is 9 rad", "-2.97 to 2.97 rad"]),
    ("/robot/move/joints", {"joints": [1e308, 0, 0, 0, 0, 0, 0]}, ["joint1 is 1e+308 rad"]),
    ("/robot/move/joints", {"joints": ["0", 0, 0, 0, 0, 0, 0]}, ["joints[0]", "'0'"]),
    ("/robot/move/joints", {"joints": [True, 0, 0, 0, 0, 0, 0]}, ["joints[0]", "got true"]),
    ("/robot/move/joints", {"joints": 5}, ["joints must have 7 angles, got 1"]),
    ("/robot/move/joints", {}, ["joints: is missing"]),
    ("/robot/move/joints", [], ["the body must be an object, got []"]),
    ("/robot/move/joints", {"joints": HOME, "speed": 0.001}, ["speed", "0.01", "0.001"]),
    ("/robot/move/joints", {"joints": HOME, "speed": 1.5}, ["speed", "1.5"]),
    ("/robot/move/joints", {"joints": HOME, "speed": "0.5"}, ["speed", "'0.5'"]),
    ("/robot/move/joints", {"joints": HOME, "accel_scale": -1}, ["accel_scale", "-1"]),
    ("/robot/move/joints", {"joints": HOME, "spede": 1}, ["'spede'", "did you mean 'speed'", "accel_scale"]),
    ("/robot/move/named", {"name": "hom"}, ["'hom'", "home, work, transport"]),
    ("/robot/move/named", {"name": 7}, ["name", "7"]),
    ("/robot/move/pose", {"x": 0.4, "y": 0.0}, ["z: is missing"]),
    ("/robot/move/pose", {"x": 0.4, "y": 0, "z": 0.5, "planner": "stomp"}, ["planner", "'chomp'", "'stomp'"]),
    ("/robot/move/pose", {"x": 0.4, "y": 0, "z": 0.5, "planner": "circ"}, ["via", "circ"]),
    ("/robot/move/pose", {"x": 0.4, "y": 0, "z": 0.5, "via": {"x": 0, "y": 0, "z": 0}}, ["via", "ptp"]),
    ("/robot/move/pose", {"x": 0.4, "y": 0, "z": 0.5, "frame_id": "moon"}, ["'moon'", "base_link"]),
    ("/trajectory/send", {"points": []}, ["points", "at least 1"]),
    ("/trajectory/send", {"points": [{"positions": HOME, "time_from_start": -1}]}, ["points[0]", "-1"]),
    (
        "/trajectory/send",
        {"points": [{"positions": AWAY, "time_from_start": 0}, {"positions": HOME, "time_from_start": 3}]},
        ["points[0]", "joint2", "0.5000 rad apart", "move_to_start"],
    ),
    (
        "/trajectory/send",
        {"points": [{"positions": HOME, "time_from_start": 1}, {"positions": AWAY, "time_from_start": 1}]},
        ["points[1]", "time_from_start", "later"],
    ),
    (
        "/trajectory/send",
        {"points": [{"positions": AWAY, "time_from_start": 0.1}]},
        ["points[0]", "joint2", "limit"],
    ),
    (
        "/trajectory/send",
        {"points": [{"positions": [0] * 6, "time_from_start": 1}]},
        ["points[0]", "7", "6"],
    ),
    (
        "/trajectory/send",
        {"points": [{"positions": HOME, "time_from_start": 1, "velocities": [0] * 3}]},
        ["points[0]", "velocities", "7", "3"],
    ),
    (
        "/trajectory/send",
        {"points": [{"positions": HOME, "time_from_start": 1, "effort": []}]},
        ["points[0]", "'effort'", "accelerations"],
    ),
]


@pytest.mark.parametrize(("path", "body", "words"), BAD_BODIES)
def test_bad_input_is_named_and_moves_nothing(
    http: httpx.Client, path: str, body: Any, words: list[str]
) -> None:
    before = motion(http)["motion_id"]
    response = http.post(path, json=body)
    assert response.status_code == 422, response.text
    answer = response.json()
    assert set(answer) - ({"explain"} if answer["code"] == "limit" else set()) == {"detail", "code"}
    for word in words:
        assert word in answer["detail"]
    assert motion(http)["motion_id"] == before


@pytest.mark.parametrize(
    ("content", "kind", "status", "word"),
    [
        (b'{"joints": [NaN, 0, 0, 0, 0, 0, 0]}', "application/json", 422, "finite"),
        (b'{"joints": [Infinity, 0, 0, 0, 0, 0, 0]}', "application/json", 422, "finite"),
        (b'{"joints": [1e999, 0, 0, 0, 0, 0, 0]}', "application/json", 422, "finite"),
        (b"", "application/json", 422, "missing"),
        (b'{"joints": [', "application/json", 422, "not valid JSON"),
        (b"\xff\xfe\x00", "application/json", 422, "send it encoded as UTF-8"),
        (
            b'{"joints":' + b"[" * 100_000 + b"]" * 100_000 + b"}",
            "application/json",
            422,
            "nested too deeply",
        ),
        (b"joints=1", "application/x-www-form-urlencoded", 415, "application/json"),
        (b"{}", "text/plain", 415, "text/plain"),
    ],
)
def test_a_body_that_is_no_request_is_refused(
    http: httpx.Client, content: bytes, kind: str, status: int, word: str
) -> None:
    response = http.post("/robot/move/joints", content=content, headers={"content-type": kind})
    assert response.status_code == status, response.text
    assert word in response.json()["detail"]


@pytest.mark.parametrize(
    ("path", "content_type", "limit"),
    [
        ("/robot/move/joints", "application/json", "2097152"),
        ("/trajectory/send_csv", "multipart/form-data; boundary=b", "33554432"),
    ],
)
def test_a_body_beyond_the_limit_is_refused(
    shared: Run, http: httpx.Client, path: str, content_type: str, limit: str
) -> None:
    """50 MB against web.max_json_bytes and web.max_body_bytes, announced and chunked."""
    head = b'--b\r\nContent-Disposition: form-data; name="file"; filename="points.csv"\r\n\r\n'
    chunks = [head.ljust(1_000_000, b"0"), *[b"0" * 1_000_000] * 49]
    for headers in ({"content-length": "50000000"}, {}):
        with httpx.Client(base_url=shared.url, timeout=WAIT_S) as other:
            try:
                response = other.post(
                    path,
                    content=iter(chunks),
                    headers={"content-type": content_type, **headers},
                )
            except (httpx.WriteError, httpx.ReadError):
                continue  # the service has answered and hung up before all was sent
            assert response.status_code == 413
            assert limit in response.json()["detail"]
    assert http.get("/health").json()["status"] == "ok"


def test_an_endpoint_without_a_body_does_not_mind_one(http: httpx.Client) -> None:
    answer = http.post("/stop", content=b"0" * 5_000_000)
    assert answer.status_code == 200
    assert answer.json()["success"] is True


LARGE = 60_000


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"{" + b'"a": 1,' * LARGE + b'"b": 1}', "the key 'a' occurs twice"),
        (b"{" + b",".join(b'"k%d": 1' % n for n in range(LARGE)) + b"}", "unknown key 'k0'"),
        (b'{"points": [' + b"{}," * (LARGE - 1) + b"{}]}", "points[0].positions: is missing"),
        (
            b'{"points": [' + b'{"positions": ["x", "x", 1]},' * (LARGE - 1) + b"{}]}",
            "points[0].positions[0]",
        ),
        (b'{"' + b"x" * 2_000_000 + b'": 1}', "unknown key 'xxx"),
        (b'{"points": [' + b'"",' * (LARGE - 1) + b"0]}", "points[0]: "),
    ],
)
def test_a_large_body_full_of_mistakes_gets_a_short_answer(
    http: httpx.Client, body: bytes, words: str
) -> None:
    answer = http.post("/trajectory/send", content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 422
    assert words in answer.json()["detail"]
    assert len(answer.content) < 2000


@pytest.mark.parametrize("planner", ["ptp", "lin"])
def test_an_acceleration_of_all_but_nothing_says_so(http: httpx.Client, planner: str) -> None:
    for scale in (1e-300, 5e-324):
        body = {"x": 0.45, "y": 0.0, "z": 0.5, "b": 3.14159, "planner": planner, "accel_scale": scale}
        answer = http.post("/robot/move/pose", json=body)
        assert answer.status_code == 200, answer.text
        assert (answer.json()["success"], answer.json()["code"]) == (False, "planning")
        assert "too small" in answer.json()["message"]


@pytest.mark.parametrize("path", ["/robot/move/joints", "/trajectory/send_csv", "/sequences/start"])
def test_a_stop_counts_for_a_request_that_is_still_being_sent(
    shared: Run, http: httpx.Client, path: str
) -> None:
    request = {
        "/robot/move/joints": {"json": {"joints": AWAY, "speed": 1.0}},
        "/trajectory/send_csv": {"files": {"file": ("a.csv", b"any")}},
        "/sequences/start": {"files": {"config": ("s.json", b'{"waypoints": [{"named": "work"}]}')}},
    }[path]
    before = motion(http)["motion_id"]
    raw = httpx.Request("POST", shared.url + path, **request)
    content = raw.read()
    head = "".join(f"{name}: {value}\r\n" for name, value in raw.headers.items())
    host, port = shared.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port))) as client:
        client.settimeout(WAIT_S)
        client.sendall(f"POST {path} HTTP/1.1\r\n{head}\r\n".encode() + content[:20])
        time.sleep(0.3)  # for the service to take in the head
        assert http.post("/stop").json()["success"]
        client.sendall(content[20:])
        answer = client.recv(65536).decode()
        while not answer.endswith("}"):
            answer += client.recv(65536).decode()
    assert "a stop was requested while" in answer
    assert motion(http)["motion_id"] == before
    assert http.get("/health").json()["service"]["motion"] is None


def test_a_key_that_stands_twice_is_refused(http: httpx.Client) -> None:
    """JSON leaves open which of the two counts."""
    body = b'{"joints": [0,0,0,-1.57,0,1.57,0], "speed": 0.1, "joints": [1,0,0,-1.57,0,1.57,0]}'
    answer = http.post("/robot/move/joints", content=body, headers={"content-type": "application/json"})
    assert answer.status_code == 422
    assert answer.json() == {
        "detail": "the body: the key 'joints' occurs twice in one object",
        "code": "input",
    }


@pytest.mark.parametrize(
    ("path", "file", "fields", "words"),
    [
        ("/sequences/start", "config", {"n_iteration": "1"}, "did you mean 'n_iterations'?"),
        ("/trajectory/send_csv", "file", {"separator": ";"}, "unknown key 'separator'; valid keys: file"),
    ],
)
def test_unknown_form_fields_are_refused_with_the_valid_names(
    http: httpx.Client, path: str, file: str, fields: dict[str, str], words: str
) -> None:
    answer = http.post(path, files={file: ("name", b"{}")}, data=fields)
    assert answer.status_code == 422
    assert words in answer.json()["detail"]


def test_text_where_a_file_belongs_is_refused_in_words_for_users(http: httpx.Client) -> None:
    answer = http.post("/trajectory/send_csv", files={"file": (None, b"joint1,t")})
    assert answer.status_code == 422
    assert answer.json()["detail"] == "file: must be an uploaded file, got the text 'joint1,t'"


def test_wrong_paths_and_methods_answer_in_the_same_form(http: httpx.Client) -> None:
    missing = http.get("/robot/moov")
    assert (missing.status_code, missing.json()["code"]) == (404, "not_found")
    wrong = http.get("/stop")
    assert (wrong.status_code, wrong.headers["allow"]) == (405, "POST")
    assert "POST" in wrong.json()["detail"]
    assert http.get("/trajectory/logs", params={"n": 301}).status_code == 422
    assert "'m'" in http.get("/trajectory/logs", params={"m": 3}).json()["detail"]


def test_the_limits_in_the_schema_are_those_of_joint_limits_yaml(http: httpx.Client) -> None:
    schema = http.get("/openapi.json").json()["components"]["schemas"]["MoveJoints"]["properties"]["joints"]
    limits = [(item["minimum"], item["maximum"]) for item in schema["prefixItems"]]
    assert limits == [(-m, m) for m in (2.97, 2.10, 2.97, 2.10, 2.97, 2.10, 3.05)]


@pytest.mark.thorough
def test_every_example_of_the_schema_works_unedited(http: httpx.Client) -> None:
    """What Swagger's "Try it out" sends, in the order of the page, from home. Only the id of a plan has to be
    that of the plan that was made last."""
    schema = http.get("/openapi.json").json()
    models = schema["components"]["schemas"]
    tried, plan = 0, {}
    for path, methods in schema["paths"].items():
        content = methods.get("post", {}).get("requestBody", {}).get("content", {})
        if (
            "application/json" in content
            and not path.startswith("/{robot}/")
            and not {"{name}", "{program}", "{study}", "{job}", "{plan}"} & set(path.split("/"))
        ):
            if "/gripper" in path:  # this robot has none: tests/app/api/routers/test_gripper.py
                continue
            if path.endswith("/time_factor"):  # no fast clock: tests/app/api/routers/test_simulation.py
                continue
            if path == "/access/tokens":  # this service has none: tests/e2e/test_access.py
                continue
            path = path.replace("{robot}", http.get("/robots").json()[0]["name"])
            model = content["application/json"]["schema"]["$ref"].rsplit("/", 1)[1]
            for example in models[model]["examples"]:
                answer = http.post(path, json=example | plan if "plan_id" in example else example)
                assert answer.status_code == 200, answer.text
                plan = {name: value for name, value in answer.json().items() if name == "plan_id"} or plan
                assert answer.json().get("success", True), answer.text
                if "token" in answer.json():  # the next one is somebody without it
                    http.delete(path, headers={"X-Control-Token": answer.json()["token"]}).raise_for_status()
                if path.endswith("/freedrive"):  # nor does anybody hold the arm
                    http.delete(path).raise_for_status()
                if path.endswith("/studies"):  # one runs at a time
                    until(lambda: http.get("/studies").json()["studies"][0]["state"] != "running")
                until(lambda: motion(http)["mode"] == "HOLD")
                tried += 1
    http.post("/robot/tool", json={"clear": True}).raise_for_status()
    http.delete("/robot/positions/aside").raise_for_status()
    assert tried == 2 * 28, "of the default robot, and of a robot by name"


def test_a_second_motion_is_refused_with_the_name_of_the_first(http: httpx.Client) -> None:
    number = slow_trajectory(http)
    second = http.post("/robot/move/named", json={"name": "home"})
    assert second.status_code == 409
    assert f"motion {number}" in second.json()["detail"]
    assert "POST /trajectory/send" in second.json()["detail"]
    http.post("/stop").raise_for_status()


def test_what_takes_long_to_read_is_not_read_while_the_arm_is_somebody_elses(http: httpx.Client) -> None:
    """Else its owner's service would lose time to requests that it refuses anyway."""
    slow_trajectory(http)
    large = b'{"points": [' + b"{}," * LARGE + b"{}]}"
    headers = {"content-type": "application/json"}
    assert http.post("/trajectory/send", content=large, headers=headers).status_code == 409
    assert http.post("/trajectory/send_csv", files={"file": ("a.csv", b"\xff")}).status_code == 409
    assert http.post("/stop").json()["success"]
    assert http.post("/trajectory/send", content=large, headers=headers).status_code == 422
    assert http.post("/trajectory/send_csv", files={"file": ("a.csv", b"\xff")}).status_code == 422


def test_stop_says_what_it_stopped_and_may_be_repeated(http: httpx.Client) -> None:
    number = slow_trajectory(http)
    stop = http.post("/stop").json()
    assert stop["success"] is True
    assert stop["at_rest"] is True
    assert any(f"motion {number}" in item for item in stop["stopped"])
    np.testing.assert_allclose(stop["position"], joints(http), atol=1e-3)
    again = http.post("/stop", json={}).json()
    assert again["success"] is True
    assert again["stopped"] == []
    lines = http.get("/trajectory/logs", params={"n": 5}).json()["lines"]
    assert any(f"motion {number}" in line and "POST /stop" in line for line in lines)


def test_reads_answer_while_a_planner_thinks(shared: Run, http: httpx.Client) -> None:
    """Many points keep a planning process busy; a stop ends it."""
    answers: list[Any] = []

    def think() -> None:
        points = [{"positions": HOME, "time_from_start": float(n)} for n in range(1, 25_000)]
        response = httpx.post(f"{shared.url}/trajectory/send", json={"points": points}, timeout=WAIT_S)
        answers.append(response)

    thinker = threading.Thread(target=think)
    thinker.start()
    until(lambda: http.get("/health").json()["service"]["motion"] or answers)
    assert http.get("/robot/joint_states").status_code == 200
    stop = http.post("/stop").json()
    assert stop["success"]
    assert http.get("/health").json()["service"]["motion"] is None, "the arm is free at once"
    thinker.join(WAIT_S)
    assert answers[0].status_code in (200, 409)
    answer = http.post("/robot/move/joints", json={"joints": AWAY, "speed": 1.0}).json()
    assert answer["success"], "planning works again"


def test_a_trajectory_passes_through_its_points_and_its_log_tells_its_end(http: httpx.Client) -> None:
    points = [
        {"positions": HOME, "time_from_start": 0.0},
        {"positions": AWAY, "time_from_start": 3.0, "velocities": [0.0] * 7, "accelerations": [0.0] * 7},
    ]
    sent = http.post("/trajectory/send", json={"points": points}).json()
    assert (sent["status"], sent["points"], sent["duration_s"]) == ("sent", 2, 3.0)
    until(
        lambda: any(
            f"motion {sent['motion_id']}: arrived" in line
            for line in http.get("/trajectory/logs").json()["lines"]
        )
    )
    np.testing.assert_allclose(joints(http), AWAY, atol=1e-3)


def test_one_point_may_come_as_an_object_as_matlab_encodes_it(http: httpx.Client) -> None:
    body = {"points": {"positions": AWAY, "time_from_start": 5}}
    assert http.post("/trajectory/send", json=body).json()["points"] == 1


def test_retime_and_move_to_start_make_an_impossible_trajectory_possible(http: httpx.Client) -> None:
    points = [{"positions": AWAY, "time_from_start": 0.0}, {"positions": HOME, "time_from_start": 0.2}]
    body = {"points": points, "retime": True, "move_to_start": True}
    sent = http.post("/trajectory/send", json=body)
    assert sent.status_code == 200, sent.text
    assert sent.json()["duration_s"] > 0.2
    until(lambda: motion(http)["mode"] == "HOLD")
    np.testing.assert_allclose(joints(http), HOME, atol=1e-3)


def test_a_trapezoid_that_knows_no_jerk_takes_its_time_and_the_answer_says_what_was_changed(
    http: httpx.Client,
) -> None:
    here = joints(http)
    times_s = np.append(np.arange(0.0, 1.32, 0.01), 1.32)
    points = [
        {"positions": [here[0] + 1e-5 - way, *here[1:]], "time_from_start": time_s}
        for way, time_s in zip(trapezoid(times_s, 0.6, 0.5, 1.32).tolist(), times_s.tolist(), strict=True)
    ]
    exactly = http.post("/trajectory/send", json={"points": points, "smoothing_rad": 0.0})
    assert exactly.status_code == 422
    assert "of joint1 reaches" in exactly.json()["detail"]
    sent = http.post("/trajectory/send", json={"points": points}).json()
    assert sent["duration_s"] <= 1.05 * 1.32
    assert 0.0 < sent["smoothed_rad"] <= 0.001
    assert sent["blended_rad"] == pytest.approx(1e-5, abs=2e-4)  # here is where it was measured
    assert sent["stretch"] == pytest.approx(sent["duration_s"] / 1.32)
    assert sent["note"]
    until(lambda: motion(http)["mode"] == "HOLD" and motion(http)["settled"])
    np.testing.assert_allclose(joints(http), points[-1]["positions"], atol=1e-3)


def test_without_its_check_a_trajectory_still_meets_the_safety_layer(http: httpx.Client) -> None:
    """0.5 rad in 0.1 s: refused by the check, caught within the limits by rtloop."""
    before = http.get("/health").json()["interventions"]
    body = {"points": [{"positions": AWAY, "time_from_start": 0.1}], "validate_limits": False}
    assert http.post("/trajectory/send", json=body).status_code == 200
    until(lambda: motion(http)["mode"] == "HOLD" and motion(http)["settled"])
    after = http.get("/health").json()["interventions"]
    assert sum(after.values()) > sum(before.values())
    np.testing.assert_allclose(joints(http), AWAY, atol=2e-3)


CSV = (
    "t;Joint_1;joint2;joint3;joint4;joint5;joint6;joint7\r\n"
    "0;0;0;0;-1,57;0;1,57;0\r\n3;0;0,5;0;-1,57;0;1,57;0\r\n\r\n"
)


def test_a_csv_with_semicolons_and_decimal_commas_runs(http: httpx.Client) -> None:
    files = {"file": ("t.csv", b"\xef\xbb\xbf" + CSV.encode(), "text/csv")}
    sent = http.post("/trajectory/send_csv", params={"separator": ";"}, files=files)
    assert sent.status_code == 200, sent.text
    assert sent.json()["points"] == 2
    until(lambda: motion(http)["mode"] == "HOLD")
    np.testing.assert_allclose(joints(http), AWAY, atol=1e-3)


@pytest.mark.parametrize(
    ("content", "params", "status", "words"),
    [
        (b"\x00\x01\x02\xff" * 1000, {}, 422, ["row 1"]),
        (CSV.encode(), {"separator": ","}, 422, ["row 1"]),  # without one it is found in the header
        (CSV.encode().replace(b"0,5", b"x"), {"separator": ";"}, 422, ["row 3", "joint2", "'x'"]),
        (CSV.encode(), {"separator": "7"}, 422, ["separator", "'7'"]),
        (CSV.encode(), {"separator": ";;"}, 422, ["separator"]),
        (CSV.encode(), {"seperator": ";"}, 422, ["'seperator'", "did you mean 'separator'"]),
        (b"", {}, 422, ["empty"]),
    ],
)
def test_a_bad_csv_is_refused_with_row_and_column(
    http: httpx.Client, content: bytes, params: dict[str, str], status: int, words: list[str]
) -> None:
    files = {"file": ("t.csv", content, "text/csv")}
    response = http.post("/trajectory/send_csv", params=params, files=files)
    assert response.status_code == status
    for word in words:
        assert word in response.json()["detail"]


@pytest.mark.thorough
def test_a_csv_of_a_hundred_thousand_rows_runs(http: httpx.Client) -> None:
    rows = 100_000
    header = ",".join([*(f"joint{n}" for n in range(1, 8)), "t"])
    wave = 0.1 * np.sin(np.linspace(0.0, 6 * np.pi, rows)) ** 3
    body = "\n".join(f"0,{w:.9f},0,-1.57,0,1.57,0,{n * 0.01:.2f}" for n, w in enumerate(wave))
    files = {"file": ("t.csv", f"{header}\n{body}\n".encode(), "text/csv")}
    sent = http.post("/trajectory/send_csv", files=files)
    assert sent.status_code == 200, sent.text
    assert sent.json()["points"] == rows
    assert http.post("/stop").json()["success"]


def test_health_tells_processes_cycle_times_and_versions(http: httpx.Client) -> None:
    health = http.get("/health").json()
    assert health["status"] == "ok"
    assert health["rtloop"]["pid"] != health["service"]["pid"]
    assert health["cycle_us"]["total"]["p50_us"] > 0.0
    assert {"cobot", "mujoco-core", "ruckig", "python", "layout"} <= set(health["versions"])


def test_reset_while_the_arm_moves_is_refused_and_the_motion_goes_on(http: httpx.Client) -> None:
    number = slow_trajectory(http)
    answer = http.post("/robot/reset")
    assert answer.status_code == 409
    assert answer.json()["detail"] == f"motion {number} is TRAJECTORY: there is nothing to reset"
    assert motion(http)["mode"] == "TRAJECTORY"
    assert http.post("/stop").json()["success"]


def test_reset_in_hold_changes_nothing(http: httpx.Client) -> None:
    assert http.post("/robot/reset").json()["success"]
    assert motion(http)["mode"] == "HOLD"


def test_a_recording_is_made_fetched_and_removed(http: httpx.Client) -> None:
    """Oracle: mcap's reader."""
    until(lambda: http.get("/recordings").json()["recorder"]["alive"])
    asked = http.post("/recordings", json={"action": "dump", "seconds": 0.5})
    assert asked.status_code == 200, asked.text
    (name,) = asked.json()["names"]
    listed = next(each for each in http.get("/recordings").json()["recordings"] if each["name"] == name)
    fetched = http.get(f"/recordings/{name}")
    assert len(fetched.content) == listed["size"]
    assert fetched.headers["content-disposition"] == f'attachment; filename="{name}"'
    found = make_reader(io.BytesIO(fetched.content), validate_crcs=True).iter_messages(topics="/joint_states")
    assert 1 <= len(list(found)) <= 500
    shown = http.get(f"/recordings/{name}/path?samples=5").json()
    assert len(shown["path"]) == 5
    assert shown["path"][-1]["time_s"] == shown["duration_s"]
    np.testing.assert_allclose(shown["path"][-1]["joints"], joints(http), atol=1e-3)
    place = http.get("/robot/pose").json()["position"]
    np.testing.assert_allclose(shown["path"][-1]["position"], [place[axis] for axis in "xyz"], atol=1e-3)
    assert http.delete(f"/recordings/{name}").status_code == 200
    for gone in (http.get(f"/recordings/{name}"), http.delete(f"/recordings/{name}")):
        assert (gone.status_code, gone.json()["code"]) == (404, "not_found")


@pytest.mark.parametrize(
    "name", ["x", "..%2f..%2fetc%2fpasswd", "%2e%2e", "iiwa-20260101T000000.000Z-fault.mcap%00", "a" * 201]
)
def test_a_name_of_no_recording_is_refused(http: httpx.Client, name: str) -> None:
    for answer in (http.get(f"/recordings/{name}"), http.delete(f"/recordings/{name}")):
        assert answer.status_code in (404, 422), answer.text
        assert set(answer.json()) >= {"detail", "code"}


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        ({"action": "pause"}, 422, ["action", "'dump'", "'pause'"]),
        ({"seconds": 0}, 422, ["seconds", "0"]),
        ({"seconds": 601}, 422, ["seconds", "600", "601"]),
        ({"second": 1}, 422, ["'second'", "did you mean 'seconds'"]),
        ({"action": "stop"}, 409, ["is not being recorded"]),
    ],
)
def test_what_cannot_be_recorded_is_said(
    http: httpx.Client, body: dict[str, Any], status: int, words: list[str]
) -> None:
    until(lambda: http.get("/recordings").json()["recorder"]["alive"])
    answer = http.post("/recordings", json=body)
    assert answer.status_code == status, answer.text
    assert all(word in answer.json()["detail"] for word in words), answer.text
