"""Actions and conditions of motions over REST, on virtual time.

Oracles: the outputs that the simulated device was told to set, and numpy's length of the planned path.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cobot_run import until
from wired_arm import WiredService

from app.services.rights.job_book import JobBook
from cobot.client.rest import Client
from cobot.errors import ConditionNotMet
from cobot.types import LoopMode

NAMED = {"name": "work", "speed": 0.5}
DOWN = {"x": 0.55, "y": 0.0, "z": 0.45, "b": 3.14159, "planner": "lin", "speed": 0.2}
START = {"x": 0.55, "y": 0.0, "z": 0.6, "b": 3.14159, "speed": 0.8}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WiredService]:
    with WiredService(tmp_path_factory.mktemp("signals")).serving() as made:
        yield made


@pytest.fixture
def run(service: WiredService) -> WiredService:
    service.cycles[service.name].watch = lambda: None
    service.arm.push = np.zeros(6)
    if service.rig.mode is not LoopMode.HOLD:
        service.post("/robot/reset").raise_for_status()
    service.go_home()
    service.arm.wire()
    return service


@pytest.fixture
def robot(run: WiredService) -> Client:
    return run.client(run.url)


def setting(value: float = 1.5, **at: Any) -> dict[str, Any]:
    return {"at": at, "set": {"output": "pressure", "value": value}}


def test_the_answer_says_where_each_action_has_fired(run: WiredService) -> None:
    begin = np.array(list(run.get("/robot/pose").json()["position"].values()))
    actions = [
        setting(distance_m=0.05),
        setting(2.5, **{"distance_m": 0.05, "from": "end"}),
        setting(time_s=0.4),
    ]
    answer = run.post("/robot/move/named", {**NAMED, "actions": actions}).json()
    assert answer["success"], answer
    assert [each["fired"] for each in answer["actions"]] == [True] * 3
    assert [each.value for each in run.arm.set] == [1.5, 1.5, 2.5]
    first, last, third = answer["actions"]
    assert first["does"] == "set pressure to 1.5"
    assert first["at"] == "0.05 m after the start"
    assert last["at"] == "0.05 m before the end"
    # Near the start the path is hardly bent.
    assert np.linalg.norm(np.array(first["position"]) - begin) == pytest.approx(0.05, abs=2e-3)
    end = np.array(list(run.get("/robot/pose").json()["position"].values()))
    assert np.linalg.norm(np.array(last["position"]) - end) == pytest.approx(0.05, abs=3e-3)
    assert third["planned_s"] == pytest.approx(0.4)
    assert 0.0 <= third["path_time_s"] - 0.4 < 1.1e-3


def test_distances_are_lengths_of_the_path_of_the_tcp(run: WiredService) -> None:
    plan = run.post(
        "/robot/plan/named", {**NAMED, "samples": 1000, "actions": [setting(distance_m=0.2)]}
    ).json()
    places = np.array([point["position"] for point in plan["path"]])
    times = np.array([point["time_s"] for point in plan["path"]])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    expected_s = float(np.interp(0.2, lengths, times))
    (sentence,) = plan["signals"]
    assert sentence.endswith("s: set pressure to 1.5")
    assert float(sentence.split(" s")[0]) == pytest.approx(expected_s, abs=1e-3)
    answer = run.post("/robot/execute", {"plan_id": plan["plan_id"]}).json()
    assert [each["fired"] for each in answer["actions"]] == [True]


@pytest.mark.parametrize(
    ("fields", "status", "detail"),
    [
        ({"actions": [setting(distance_m=9.0)]}, 422, "actions[0].at.distance_m: is 9 m, but the path is 0."),
        ({"actions": [setting(time_s=99.0)]}, 422, "actions[0].at.time_s: is 99 s, but the path is "),
        (
            {"actions": [{"at": {"fraction": 0.5}, "set": {"output": "lamp", "value": True}}]},
            422,
            "actions[0].set: there is no output 'lamp'; the device's outputs are: glue, speed, pressure",
        ),
        (
            {"actions": [{"at": {"fraction": 0.5}, "set": {"output": "part", "value": True}}]},
            422,
            "actions[0].set: part is an input, which only the device sets; name an output",
        ),
        (
            {"actions": [{"at": {"fraction": 0.5}, "set": {"output": "glue", "value": 2}}]},
            422,
            "actions[0].set: glue is boolean: the value must be true or false, got 2",
        ),
        (
            {"actions": [{"at": {"fraction": 0.5, "time_s": 1.0}, "event": "half"}]},
            422,
            "actions[0].at: give one of distance_m, time_s, fraction, got distance_m",
        ),
        ({"actions": [{"at": {"fraction": 1.5}, "event": "half"}]}, 422, "actions[0].at.fraction: must be"),
        ({"actions": [{"at": {"fraction": 0.5}}]}, 422, "give one of set, event and gripper, got none"),
        (
            {"actions": [{"at": {"fraction": 0.5}, "gripper": {"command": "release"}}]},
            501,
            "actions[0].gripper: this robot has no gripper",
        ),
        ({"actions": [setting(fraction=0.1)] * 65}, 422, "actions: must have at most 64 items"),
        (
            {"start_when": {"input": "light", "is": True}},
            422,
            "start_when.input: there is no input 'light'; valid names: part, distance",
        ),
        (
            {"start_when": {"input": "part", "above": 1.0}},
            422,
            "start_when: part is boolean; give is or edge",
        ),
        ({"start_when": {"input": "distance", "is": True}}, 422, "distance is analog; give above or below"),
        (
            {"pause_while": {"input": "part", "edge": "rising"}},
            422,
            "pause_while.edge: an edge has no duration",
        ),
        (
            {"until": {"force": {"direction": {"x": 0.0, "y": 0.0, "z": 0.0}}}},
            422,
            "until.force.direction: the length",
        ),
        ({"until": {"torque": {"joint": "elbow"}}}, 422, "until.torque.joint: there is no joint 'elbow'"),
        ({"until": {"force": {}, "relative_to": "zero"}}, 409, "set it with POST /robot/force/zero"),
    ],
)
def test_what_is_wrong_is_said_before_anything_moves(
    run: WiredService, fields: dict[str, Any], status: int, detail: str
) -> None:
    if "fraction" in str(fields) and "time_s" in str(fields):
        detail = "give one of distance_m, time_s, fraction, got time_s, fraction"
    before = run.joints()
    answer = run.post("/robot/move/named", {**NAMED, **fields})
    assert answer.status_code == status, answer.text
    assert detail in answer.json()["detail"]
    assert np.allclose(run.joints(), before, atol=1e-4)
    assert not run.arm.set


def test_an_event_is_reported_to_those_who_listen(run: WiredService) -> None:
    with run.listen("/events?types=action") as events:
        run.post("/robot/move/named", {**NAMED, "actions": [{"at": {"fraction": 0.5}, "event": "half way"}]})
        found = events.event("action")["data"]
    assert found["what"] == "fired"
    assert found["text"] == "half way"
    assert found["action"] == "actions[0]"


def test_what_a_stop_leaves_is_reported_in_the_job(run: WiredService) -> None:
    actions = [setting(time_s=0.1), setting(**{"time_s": 0.0, "from": "end"})]
    job = run.post("/robot/move/named?wait=false", {**NAMED, "speed": 0.1, "actions": actions}).json()
    run.sleep(0.5)
    run.post("/stop").raise_for_status()
    record = run.get(f"/jobs/{job['id']}").json()
    assert record["state"] == "cancelled"
    assert [each["fired"] for each in record["actions"]] == [True, False]


def test_after_a_kill_no_action_is_told_as_not_fired(run: WiredService, tmp_path: Path) -> None:
    """The next start reads the file of jobs as it is in the middle of the motion. The first action has fired
    and the last has not: the file knows neither."""
    actions = [setting(time_s=0.1), setting(**{"time_s": 0.0, "from": "end"})]
    job = run.post("/robot/move/named?wait=false", {**NAMED, "speed": 0.1, "actions": actions}).json()
    run.sleep(0.5)
    assert len(run.arm.set) == 1
    (file,) = run.config.parent.rglob("*.jobs.jsonl")
    until(lambda: [line for line in file.read_text().splitlines() if job["id"] in line and "running" in line])
    left = tmp_path / file.name
    left.write_bytes(file.read_bytes())
    run.post("/stop").raise_for_status()
    link: Any = SimpleNamespace(clock=run.clock, label="", memory=SimpleNamespace(robot=run.name))
    book = JobBook(link, left)
    record = book.find(job["id"])
    book.close()
    assert record is not None
    assert record.state == "interrupted"
    assert [each.fired for each in record.actions] == [None, None]
    assert [each.does for each in record.actions] == ["set pressure to 1.5"] * 2


def test_a_rejected_output_is_in_the_answer(run: WiredService) -> None:
    run.arm.refuses = "the valve block is off"
    answer = run.post("/robot/move/named", {**NAMED, "actions": [setting(time_s=0.1)]}).json()
    assert answer["success"]
    assert answer["actions"][0]["fired"] is False
    assert answer["actions"][0]["problem"] == "the valve block is off"
    stopping = {**setting(time_s=0.1), "on_failure": "stop"}
    answer = run.post("/robot/move/named", {"name": "home", "speed": 0.5, "actions": [stopping]}).json()
    assert not answer["success"]
    assert "output pressure was rejected: the valve block is off" in answer["message"]


def test_actions_of_motions_in_a_sequence_belong_to_their_own_motion(run: WiredService) -> None:
    motions = [
        {**NAMED, "actions": [setting(1.0, fraction=0.5)]},
        {"name": "home", "speed": 0.5, "actions": [setting(2.0, distance_m=0.0), setting(3.0, fraction=1.0)]},
    ]
    answer = run.post("/robot/move/sequence", {"motions": motions, "radii": [0.05]}).json()
    assert answer["success"], answer
    assert [each.value for each in run.arm.set] == [1.0, 2.0, 3.0]
    assert [each["action"] for each in answer["actions"]] == ["actions[0]", "actions[0]", "actions[1]"]


@pytest.mark.parametrize(
    ("index", "fields", "detail"),
    [
        (1, {"start_when": {"input": "part", "is": True}}, "motions[1].start_when: only the first motion"),
        (0, {"until": {"input": "part", "is": True}}, "motions[0].until: only the last motion"),
        (1, {"actions": [setting(distance_m=9.0)]}, "motions[1].actions[0].at.distance_m: is 9 m"),
    ],
)
def test_errors_of_a_sequence_name_the_motion(
    run: WiredService, index: int, fields: dict[str, Any], detail: str
) -> None:
    motions = [dict(NAMED), {"name": "home", "speed": 0.5}]
    motions[index] |= fields
    answer = run.post("/robot/move/sequence", {"motions": motions})
    assert answer.status_code == 422, answer.text
    assert detail in answer.json()["detail"]


def test_a_motion_waits_for_an_input_and_its_job_says_so(run: WiredService) -> None:
    body = {**NAMED, "start_when": {"input": "part", "is": True}}
    job = run.post("/robot/move/named?wait=false", body).json()
    run.sleep(1.0)
    record = run.get(f"/jobs/{job['id']}").json()
    assert record["waits_for"] == "start_when: input part is true"
    assert record["progress"] == 0.0
    run.arm.inputs["part"] = 1.0
    run.until(lambda: run.get(f"/jobs/{job['id']}").json()["state"] == "finished")
    assert run.get(f"/jobs/{job['id']}").json()["waits_for"] is None


def test_a_stop_of_a_motion_that_waits_says_what_it_waited_for(run: WiredService) -> None:
    body = {**NAMED, "start_when": {"input": "part", "is": True}}
    moving = run.begin(run.asking("POST", "/robot/move/named", json=body))
    run.sleep(0.5)
    run.post("/stop").raise_for_status()
    answer = run.end(moving).json()
    assert not answer["success"]
    assert answer["message"].endswith("it waited for start_when: input part is true")


def touch(run: WiredService, at_z: float, stiffness: float = 20_000.0) -> None:
    """A wall below the arm: the further the TCP is below it, the harder it pushes up."""
    state = run.rig.memory.state

    def push() -> None:
        depth = at_z - float(state.data["tcp"][2])
        run.arm.push[:] = 0.0
        if depth > 0.0:
            run.arm.push[2] = stiffness * depth

    run.cycles[run.name].watch = push


def test_a_motion_ends_at_contact_and_goes_back(run: WiredService) -> None:
    run.post("/robot/move/pose", START).raise_for_status()
    touch(run, 0.5)
    until = {"force": {"direction": {"x": 0.0, "y": 0.0, "z": 1.0}, "threshold": 15.0}}
    answer = run.post("/robot/move/pose", {**DOWN, "until": until}).json()
    assert answer["success"], answer
    assert answer["stopped_by"] == "the force at the TCP along (0, 0, 1) of the base is above 15 N"
    contact = answer["contact"]
    assert contact["position"][2] == pytest.approx(0.5, abs=4e-3)
    assert contact["value"] > 15.0
    assert contact["force"][2] == pytest.approx(contact["value"])
    assert 0.0 <= contact["overshoot_m"] < 2e-2
    assert answer["message"].startswith("Motion ended by its condition: the force")
    run.cycles[run.name].watch = lambda: None
    run.arm.push[:] = 0.0
    run.post("/robot/move/pose", START).raise_for_status()
    touch(run, 0.5)
    answer = run.post(
        "/robot/move/pose", {**DOWN, "until": {**until, "retract": 0.03, "stop": "fast"}}
    ).json()
    run.cycles[run.name].watch = lambda: None
    assert answer["success"], answer
    pose = run.get("/robot/pose").json()["position"]
    assert pose["z"] == pytest.approx(answer["contact"]["position"][2] + 0.03, abs=2e-3)
    assert answer["contact"]["retracted_m"] == pytest.approx(0.03, abs=1e-4)


def test_a_goal_without_contact_is_an_error_or_a_success(run: WiredService, robot: Client) -> None:
    run.post("/robot/move/pose", START).raise_for_status()
    with pytest.raises(ConditionNotMet, match="the arm is at its goal, but the condition was not met"):
        robot.move_pose(**DOWN, until={"force": {}})
    run.post("/robot/move/pose", START).raise_for_status()
    answer = robot.move_pose(**DOWN, until={"force": {}, "if_not_met": "success"})
    assert answer["success"]
    assert answer["stopped_by"] is None
    assert answer["contact"] is None


def test_forces_count_from_an_explicit_zero(run: WiredService) -> None:
    run.arm.push = np.array([0.0, 0.0, -30.0, 0.0, 0.0, 0.0])
    run.sleep(0.3)
    zero = run.post("/robot/force/zero").json()
    assert zero["force"][2] == pytest.approx(-30.0, abs=0.5)
    until = {"force": {"threshold": 15.0}, "relative_to": "zero", "if_not_met": "success"}
    answer = run.post("/robot/move/named", {**NAMED, "until": until}).json()
    assert answer["stopped_by"] is None, answer
    run.arm.push = np.zeros(6)
    run.sleep(0.3)
    answer = run.post("/robot/move/named", {"name": "home", "speed": 0.5, "until": until}).json()
    assert answer["stopped_by"] is not None


def test_an_arm_that_is_there_already_does_its_actions(run: WiredService) -> None:
    answer = run.post(
        "/robot/move/named", {"name": "home", "actions": [setting(**{"distance_m": 0.0, "from": "end"})]}
    ).json()
    assert answer["success"]
    assert [each["fired"] for each in answer["actions"]] == [True]
    assert len(run.arm.set) == 1


def test_an_edge_starts_a_motion(run: WiredService) -> None:
    run.arm.inputs["part"] = 1.0
    body = {**NAMED, "start_when": {"input": "part", "edge": "falling"}}
    moving = run.begin(run.asking("POST", "/robot/move/named", json=body))
    run.sleep(0.5)
    run.arm.inputs["part"] = 0.0
    assert run.end(moving).json()["success"]


def test_the_zero_is_measured_at_rest_alone(run: WiredService) -> None:
    moving = run.begin(run.asking("POST", "/robot/move/named", json={**NAMED, "speed": 0.1}))
    run.sleep(0.5)
    answer = run.post("/robot/force/zero")
    assert answer.status_code == 409
    assert "the zero can be measured only at rest" in answer.json()["detail"]
    run.post("/stop")
    run.end(moving)
