"""Sequences, with a real runner process against a real service.

Oracles: the process table, the runner's return code, `rosbags` as the reader of recordings.
"""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import pytest
from cobot_run import Run, require_quick, until
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

HOME = [0, 0, 0, -1.57, 0, 1.57, 0]
SHORT = {
    "home": {"joints": HOME, "speed": 1.0},
    "waypoints": [
        {"joints": [0.3, 0.3, 0, -1.2, 0, 1.4, 0], "speed": 1.0, "label": "first"},
        {"x": 0.5, "y": 0.0, "z": 0.5, "a": 0, "b": 3.14159, "c": 0, "speed": 1.0, "planner": "PTP"},
        {"named": "home", "speed": 1.0},
    ],
}
LONG = {"waypoints": [{"joints": [1.5, 0, 0, -1.57, 0, 1.57, 0], "speed": 0.01}] * 50}


def start(http: httpx.Client, content: Any, path: str = "/sequences/start", **fields: Any) -> httpx.Response:
    raw = content if isinstance(content, bytes) else json.dumps(content).encode()
    data = {"n_iterations": 1, "delay_between_iterations": 0, **fields}
    return http.post(path, files={"config": ("s.json", raw, "application/json")}, data=data)


def status(http: httpx.Client) -> dict[str, Any]:
    return http.get("/sequences/status").json()


def finished(http: httpx.Client) -> dict[str, Any]:
    return until(lambda: status(http)["status"] == "finished" and status(http))


def moving(http: httpx.Client) -> bool:
    return http.get("/health").json()["robot"]["mode"] == "TRAJECTORY"


def at_rest(http: httpx.Client) -> bool:
    health = http.get("/health").json()
    robot = health["robot"]
    return robot["mode"] == "HOLD" and robot["settled"] and health["service"]["motion"] is None


def test_a_sequence_visits_all_points_in_all_iterations(http: httpx.Client) -> None:
    answer = start(http, SHORT, n_iterations=2, joints_action="my/action")
    assert answer.status_code == 200, answer.text
    assert answer.json()["status"] == "started"
    assert psutil.pid_exists(answer.json()["pid"])
    end = finished(http)
    lines = http.get("/sequences/logs", params={"n": 50}).json()["lines"]
    assert end["returncode"] == 0, lines
    assert (end["iteration"], end["n_iterations"], end["waypoint"], end["n_waypoints"]) == (2, 2, 3, 3)
    assert end["started_at"] < end["finished_at"]
    assert sum("arrived" in line for line in lines[-20:]) == 8
    assert any("(first)" in line for line in lines)
    assert any("my/action" in line for line in lines)
    np.testing.assert_allclose(http.get("/robot/joint_states").json()["position"], HOME, atol=1e-3)
    assert http.get("/health").json()["service"]["motion"] is None


def test_a_sequence_has_the_control_of_who_has_started_it(http: httpx.Client) -> None:
    token = http.post("/robot/control", json={"timeout_s": 600}).raise_for_status().json()["token"]
    refused = start(http, SHORT)
    assert refused.status_code == 409
    assert "has control of the robot" in refused.json()["detail"]
    http.headers["X-Control-Token"] = token
    assert start(http, SHORT).status_code == 200
    assert finished(http)["returncode"] == 0
    http.delete("/robot/control").raise_for_status()


def test_while_a_sequence_runs_nobody_else_moves_the_arm(http: httpx.Client) -> None:
    pid = start(http, LONG).json()["pid"]
    until(lambda: moving(http))
    second = start(http, SHORT)
    assert second.status_code == 409
    assert f"pid {pid}" in second.json()["detail"]
    move = http.post("/robot/move/named", json={"name": "home"})
    assert move.status_code == 409
    assert "sequence" in move.json()["detail"] or "POST /robot/move/joints" in move.json()["detail"]
    stop = http.post("/stop").json()
    assert stop["success"]
    assert any(f"pid {pid}" in item for item in stop["stopped"])
    end = status(http)
    assert end["status"] == "finished"
    # It has a second to go by itself, which may be too short on a busy computer.
    lines = http.get("/sequences/logs", params={"n": 5}).json()["lines"]
    killed = any("does not end on SIGTERM and is killed" in line for line in lines)
    assert end["returncode"] == (-signal.SIGKILL if killed else 128 + signal.SIGTERM)
    assert not psutil.pid_exists(pid)
    assert at_rest(http)


def test_a_killed_runner_is_reported_and_the_arm_stops(http: httpx.Client) -> None:
    pid = start(http, LONG).json()["pid"]
    until(lambda: moving(http))
    os.kill(pid, signal.SIGKILL)
    assert finished(http)["returncode"] == -signal.SIGKILL
    until(lambda: at_rest(http))
    assert http.post("/robot/move/named", json={"name": "home", "speed": 1.0}).json()["success"]
    assert any("return code -9" in line for line in http.get("/sequences/logs").json()["lines"])


def test_a_runner_that_hangs_is_ended_by_stop(http: httpx.Client) -> None:
    """SIGSTOP: the process takes no SIGTERM any more. A stop shall take two seconds at the most."""

    def stopping_s() -> float:
        pid = start(http, LONG).json()["pid"]
        until(lambda: moving(http))
        os.kill(pid, signal.SIGSTOP)
        stop = http.post("/stop").json()
        assert stop["success"]
        assert status(http)["returncode"] == -signal.SIGKILL
        return float(stop["duration_s"])

    require_quick(stopping_s, 2.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"{", ["not valid JSON"]),
        (b"\x00\xff", ["cannot be read"]),
        (b"[" * 200_000, ["nested too deeply"]),
        ({"waypoints": []}, ["waypoints", "at least 1"]),
        ({"waypoints": [{"joints": HOME, "sped": 1}]}, ["waypoints[0]", "'sped'", "did you mean 'speed'"]),
        ({"waypoints": [{"x": 0.5, "y": 0}]}, ["waypoints[0].z: is missing"]),
        ({"waypoints": [{"joints": HOME, "speed": 7}]}, ["waypoints[0].speed", "got 7"]),
    ],
)
def test_a_bad_file_ends_the_runner_with_its_reason(
    http: httpx.Client, content: Any, words: list[str]
) -> None:
    assert start(http, content).status_code == 200
    assert finished(http)["returncode"] == 2
    log = "\n".join(http.get("/sequences/logs", params={"n": 5}).json()["lines"])
    for word in words:
        assert word in log


def test_a_waypoint_that_cannot_be_reached_ends_the_sequence_with_its_number(http: httpx.Client) -> None:
    far = {"x": 3.0, "y": 0, "z": 0.5, "a": 0, "b": 3.14, "c": 0}
    start(http, {"waypoints": [SHORT["waypoints"][0], far]})  # type: ignore[index]
    assert finished(http)["returncode"] == 3
    log = "\n".join(http.get("/sequences/logs", params={"n": 5}).json()["lines"])
    assert "iteration 1/1, waypoint 2/2" in log
    assert "cannot reach" in log


def test_a_recording_can_be_read_by_rosbags(shared: Run, http: httpx.Client) -> None:
    assert start(http, SHORT, bag_path="run/one").status_code == 200
    end = finished(http)
    assert end["returncode"] == 0
    bag = shared.config.parent / "recordings" / "run" / "one"
    assert end["bag_path"] == str(bag)
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        messages: dict[str, list[Any]] = {}
        for connection, _, raw in reader.messages():
            messages.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    states = messages["/joint_states"]
    assert states[0].name == [f"joint{n}" for n in range(1, 8)]
    np.testing.assert_allclose(states[0].position, HOME, atol=2e-3)
    assert np.ptp([state.position[0] for state in states]) > 0.1
    events = [json.loads(message.data) for message in messages["/motion_events"]]
    assert [event["event"] for event in events] == ["start", "arrived"] * 4


def test_a_recording_survives_a_stop_and_holds_only_the_chosen_topic(shared: Run, http: httpx.Client) -> None:
    start(http, LONG, bag_path="stopped", topics="/joint_states")
    until(lambda: moving(http))
    http.post("/stop").raise_for_status()
    bag = shared.config.parent / "recordings" / "stopped"
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        assert {connection.topic for connection in reader.connections} == {"/joint_states"}


@pytest.mark.parametrize(
    "path", ["../outside", "/etc/cobot", "a/../../outside", "link/out", ".", "nul\0", "x" * 300]
)
def test_a_recording_cannot_leave_its_folder(shared: Run, http: httpx.Client, path: str) -> None:
    folder = shared.config.parent / "recordings"
    folder.mkdir(exist_ok=True)
    link = folder / "link"
    if not link.is_symlink():
        link.symlink_to(shared.config.parent)
    answer = start(http, SHORT, bag_path=path)
    assert answer.status_code == 422, answer.text
    assert "bag_path" in answer.json()["detail"]
    assert not Path(shared.config.parent / "outside").exists()


def test_an_unknown_topic_ends_the_runner_with_the_valid_ones(http: httpx.Client) -> None:
    start(http, SHORT, bag_path="topics", topics="/tf")
    assert finished(http)["returncode"] == 2
    log = "\n".join(http.get("/sequences/logs", params={"n": 5}).json()["lines"])
    assert "'/tf'" in log
    assert "/joint_states, /motion_events" in log


def test_topics_that_no_command_line_can_have_are_refused_and_the_arm_is_free(http: httpx.Client) -> None:
    answer = start(http, SHORT, bag_path="nul", topics="/joint_states\0")
    assert answer.status_code == 422
    assert "topics" in answer.json()["detail"]
    assert http.get("/health").json()["service"]["motion"] is None


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"n_iterations": 0}, "n_iterations"),
        ({"n_iterations": "many"}, "n_iterations"),
        ({"delay_between_iterations": -1}, "delay_between_iterations"),
        ({"delay_between_iterations": "nan"}, "delay_between_iterations"),
    ],
)
def test_bad_form_fields_are_named(http: httpx.Client, fields: dict[str, Any], word: str) -> None:
    answer = start(http, SHORT, **fields)
    assert answer.status_code == 422
    assert word in answer.json()["detail"]
    missing = http.post("/sequences/start", data={"n_iterations": 1}, files={})
    assert missing.status_code == 415


def test_a_sequence_waits_at_waypoints_steps_and_goes_on_from_any_of_them(http: httpx.Client) -> None:
    points = [{"joints": [0.1 * n, *HOME[1:]], "speed": 1.0} for n in range(1, 6)]
    job = start(http, {"waypoints": points}, "/sequences/start?wait=false", from_waypoint=2).json()
    assert job["kind"] == "sequence"

    def tell(what: str, **query: int) -> dict[str, Any]:
        return http.post(f"/jobs/{job['id']}/{what}", params=query).raise_for_status().json()

    def held_at(waypoint: int) -> None:
        until(lambda: http.get(f"/jobs/{job['id']}").json()["state"] == "paused")
        until(lambda: at_waypoint(waypoint))

    def at_waypoint(waypoint: int) -> bool:
        return abs(http.get("/robot/joint_states").json()["position"][0] - 0.1 * waypoint) < 1e-3

    tell("pause", at_waypoint=3)
    held_at(3)
    tell("step")
    held_at(4)
    assert http.post(f"/jobs/{job['id']}/resume", params={"waypoint": 6}).status_code == 422
    tell("resume", waypoint=1)
    end = finished(http)
    lines = http.get("/sequences/logs", params={"n": 50}).json()["lines"]
    assert end["returncode"] == 0, lines
    visited = [line.split("waypoint ")[1][0] for line in lines if "waypoint" in line and "arrived" in line]
    assert visited[-8:] == list("23412345")
    jobs = http.get("/jobs", params={"n": 20}).json()["jobs"]
    assert len([each for each in jobs if each["parent"] == job["id"]]) == 8
    assert http.get(f"/jobs/{job['id']}").json()["state"] == "finished"


def test_a_held_sequence_ends_with_a_stop(http: httpx.Client) -> None:
    before = http.get("/robot/joint_states").json()["position"]
    job = start(http, SHORT, "/sequences/start?wait=false", hold=True).json()
    until(lambda: http.get(f"/jobs/{job['id']}").json()["state"] == "paused")
    assert http.get("/robot/joint_states").json()["position"] == pytest.approx(before, abs=1e-3)
    assert http.post("/stop").json()["success"]
    ended = http.get(f"/jobs/{job['id']}").json()
    assert (ended["state"], ended["error"]["code"]) == ("cancelled", "stopped")


LOOP = {"steps": [{"repeat": {}, "do": [{"wait_s": 0.01}, {"wait_s": 0.02}]}, {"named": "home"}]}


def test_a_loop_without_end_is_paused_stepped_and_left(http: httpx.Client) -> None:
    """Oracle: the steps that the status names, one after the other."""
    job = start(http, LOOP, "/sequences/start?wait=false", hold=True).json()

    def tell(what: str, **query: int) -> dict[str, Any]:
        return http.post(f"/jobs/{job['id']}/{what}", params=query).raise_for_status().json()

    def held_at(step: str) -> None:
        until(lambda: status(http)["step"] == step)
        until(lambda: http.get(f"/jobs/{job['id']}").json()["state"] == "paused")

    held_at("step 1 of 2")
    for step in ("step 1.1 of 2 (round 1)", "step 1.2 of 2 (round 1)", "step 1.1 of 2 (round 2)"):
        tell("step")
        held_at(step)
    tell("resume", waypoint=2)
    end = finished(http)
    assert (end["returncode"], end["step"]) == (0, "step 2 of 2")


def test_a_pause_holds_a_loop_and_a_stop_ends_it(http: httpx.Client) -> None:
    job = start(http, LOOP, "/sequences/start?wait=false").json()
    until(lambda: "round 3" in (status(http)["step"] or ""))
    assert http.post(f"/jobs/{job['id']}/pause").json()["state"] == "paused"

    def last() -> str:
        return str(http.get("/sequences/logs", params={"n": 1}).json()["lines"][0])

    def rests() -> bool:
        """A loop that runs has ten steps in this time."""
        before = last()
        time.sleep(0.5)
        return last() == before

    until(rests)
    held = last()
    http.post(f"/jobs/{job['id']}/resume").raise_for_status()
    until(lambda: last() != held)
    assert http.post("/stop").json()["success"]
    assert status(http)["returncode"] in (-signal.SIGKILL, 128 + signal.SIGTERM)
    assert http.get(f"/jobs/{job['id']}").json()["state"] == "cancelled"


def test_files_of_the_folder_of_programs_are_called(shared: Run, http: httpx.Client) -> None:
    folder = shared.config.parent / "programs"
    folder.mkdir(exist_ok=True)
    (folder / "inner.json").write_text(json.dumps({"waypoints": [{"named": "home", "speed": 1.0}]}))
    (folder / "circle.json").write_text(json.dumps({"steps": [{"call": "circle.json"}]}))
    start(http, {"steps": [{"call": "inner.json"}]})
    assert finished(http)["returncode"] == 0
    lines = http.get("/sequences/logs", params={"n": 5}).json()["lines"]
    assert any("step 1 of 1, inner.json waypoint 1/1: arrived" in line for line in lines)
    start(http, {"steps": [{"call": "circle.json"}]})
    assert finished(http)["returncode"] == 2
    lines = http.get("/sequences/logs", params={"n": 5}).json()["lines"]
    assert any(
        "s.json calls circle.json calls circle.json: a sequence cannot call itself" in line for line in lines
    )


def test_a_stored_program_runs_by_its_name(http: httpx.Client) -> None:
    """Oracle: the simulated arm's joints."""
    text = json.dumps({"waypoints": [{"named": "work", "speed": 1.0}]})
    saved = http.put("/programs/kiste-1", json={"label": "Über Kiste 1", "text": text})
    assert saved.status_code == 200, saved.text
    http.post("/programs/kiste-1/run", json={"n_iterations": 1}).raise_for_status()
    assert finished(http)["returncode"] == 0
    (work,) = (each["joints"] for each in http.get("/robot/positions").json() if each["name"] == "work")
    found = http.get("/robot/joint_states").json()["position"]
    assert max(abs(one - other) for one, other in zip(found, work, strict=True)) < 5e-3
    http.delete("/programs/kiste-1").raise_for_status()
