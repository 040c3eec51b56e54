"""The tool as a client sees it: kept, in force for plans, cycle and simulation; impossible ones are refused.

Oracle: pinocchio, in which the tool is a body of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pinocchio
import pytest
from flange_tools import INERTIA, LOAD, TCP, loaded
from independent_models import second_robot
from virtual_service import VirtualService

from app.api.schemas.tool import EXAMPLE_POINTS
from cobot.robot.tool import BARE, Tool, ToolFile

BODY = {
    "name": "load",
    "mass": 10.0,
    "centre": list(LOAD.centre),
    "inertia": list(INERTIA),
    "tcp": {"x": TCP[0], "y": TCP[1], "z": TCP[2], "quaternion": [*TCP[4:], TCP[3]]},
}
ROD = {"shape": "box", "size": [0.02, 0.02, 0.4], "x": 0.0, "y": 0.0, "z": 0.2}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    with VirtualService(tmp_path_factory.mktemp("tool")).serving() as made:
        yield made


@pytest.fixture(autouse=True)
def bare(robot: VirtualService) -> None:
    assert robot.post("/scene", {"clear": True}).status_code == 200
    assert have(robot, clear=True).status_code == 200
    robot.go_home()


def have(robot: VirtualService, **changes: Any) -> httpx.Response:
    return robot.post("/robot/tool", changes)


def efforts(robot: VirtualService) -> Any:
    robot.sleep(0.3)
    return np.array(robot.get("/robot/joint_states").json()["effort"])


def place_of(robot: VirtualService) -> list[float]:
    """Of the TCP, m."""
    position = robot.get("/robot/pose").json()["position"]
    return [position[axis] for axis in "xyz"]


def file_of(robot: VirtualService) -> ToolFile:
    return ToolFile(robot.config.parent / "logs" / f"{robot.name}.tool.json")


def away(robot: VirtualService) -> dict[str, Any]:
    home = robot.joints()
    return {"joints": [home[0] + 0.8, home[1] + 0.5, *home[2:]], "speed": 1.0}


def test_the_holding_torques_change_by_what_pinocchio_gives(robot: VirtualService) -> None:
    before, joints = efforts(robot), np.array(robot.joints())
    version = robot.get("/robot/tool").json()["version"]
    answer = have(robot, **BODY)
    assert answer.status_code == 200, answer.text
    assert answer.json() | {"gravity": None} == {
        "version": version + 1,
        "name": "load",
        "mass": 10.0,
        "centre": list(LOAD.centre),
        "inertia": pytest.approx(list(INERTIA)),
        "position": pytest.approx(list(TCP[:3])),
        "quaternion": pytest.approx([*TCP[4:], TCP[3]]),
        "shapes": [],
        "gravity": None,
        "contacts": [],
    }
    assert robot.get("/robot/tool").json() == answer.json()
    expected = loaded(LOAD).gravity(joints) - second_robot().gravity(joints)
    assert efforts(robot) - before == pytest.approx(expected, abs=0.05)
    assert np.abs(expected).max() > 10.0
    assert robot.joints() == pytest.approx(joints, abs=1e-5)
    assert file_of(robot).read() == robot.app.state.services.tool.tool


def test_plans_are_slower_with_the_load_and_state_its_torques(robot: VirtualService) -> None:
    # The hand is nearly level, so that the wrist has to hold it.
    start = np.array(robot.joints()) - np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.2, 0.0])
    goal = start + np.array([0.1, 0.0, 0.0, 0.0, 0.0, -0.3, 0.0])
    body = {"start": start.tolist(), "joints": goal.tolist(), "speed": 1.0, "samples": 1000}
    light = robot.post("/robot/plan/joints", body).json()
    assert have(robot, mass=9.0, centre=[0.0, 0.0, 0.3]).status_code == 200
    heavy = robot.post("/robot/plan/joints", body).json()
    assert heavy["duration_s"] > 1.2 * light["duration_s"]
    joints = np.array([point["joints"] for point in heavy["path"]])
    step_s = heavy["duration_s"] / 999
    velocity = np.gradient(joints, step_s, axis=0)
    other = loaded(Tool(mass=9.0, centre=(0.0, 0.0, 0.3)))
    rows = zip(joints, velocity, np.gradient(velocity, step_s, axis=0), strict=True)
    needed = np.abs([pinocchio.rnea(other.model, other.data, *row) for row in rows]).max(axis=0)
    assert heavy["utilisation"]["torque"]["peak"] == pytest.approx(needed, rel=0.03, abs=0.3)
    assert 38.0 < needed[5] < 40.4  # of 40 N·m
    refused = robot.post("/robot/execute", {"plan_id": light["plan_id"]})
    assert refused.status_code == 409
    assert "the tool had version" in refused.json()["detail"]


def test_poses_and_lines_are_those_of_the_tool(robot: VirtualService) -> None:
    assert have(robot, **BODY).status_code == 200
    robot.sleep(0.1)
    joints = np.array(robot.joints())
    place, _ = loaded(LOAD).forward(joints)
    assert place_of(robot) == pytest.approx(place, abs=1e-4)
    goal = {"x": 0.0, "y": 0.1, "z": 0.0, "frame_id": "tool", "planner": "lin", "speed": 0.5}
    answer = robot.post("/robot/move/pose", goal).json()
    assert answer["success"], answer
    other = loaded(LOAD)
    turn = other.forward(joints)[1]
    assert other.forward(np.array(robot.joints()))[0] == pytest.approx(place + turn @ [0, 0.1, 0], abs=1e-3)


def test_shapes_are_in_the_way_and_stand_in_contacts(robot: VirtualService) -> None:
    pose = place_of(robot)
    ball = {"shape": "sphere", "radius": 0.05, "x": pose[0], "y": pose[1], "z": pose[2] - 0.3}
    assert robot.post("/scene", {"objects": {"ball": ball}}).json()["contacts"] == []
    answer = have(robot, shapes={"rod": ROD}).json()
    assert len(answer["contacts"]) == 1
    assert {"rod", "ball"} <= set(answer["contacts"][0].split())
    refused = robot.post("/robot/move/joints", away(robot)).json()
    assert refused["code"] == "collision"
    allowed = have(robot, shapes={"rod": ROD | {"touch": ["ball"]}}).json()
    assert allowed["contacts"] == []
    assert robot.post("/robot/move/joints", away(robot)).json()["success"]
    named = robot.post("/scene", {"objects": {"rod": ball}})
    assert "is a shape of the tool" in named.json()["detail"]


def test_the_tcp_stays_while_something_hangs_on_it(robot: VirtualService) -> None:
    pose = place_of(robot)
    ball = {"shape": "sphere", "radius": 0.02, "x": pose[0], "y": pose[1], "z": pose[2] - 0.05}
    assert robot.post("/scene", {"objects": {"ball": ball}, "attach": {"ball": []}}).status_code == 200
    refused = have(robot, tcp={"z": 0.1})
    assert refused.status_code == 409
    assert "ball would move with it" in refused.json()["detail"]
    assert have(robot, mass=1.0).status_code == 200


def test_nothing_changes_while_the_arm_moves(robot: VirtualService) -> None:
    before = robot.get("/robot/tool").json()
    begun = robot.begin(robot.asking("POST", "/robot/move/joints", json=away(robot)))
    robot.sleep(0.3)
    refused = have(robot, **BODY)
    assert refused.status_code == 409
    assert "the robot is in use by" in refused.json()["detail"]
    assert have(robot, mass=0.0).json() == before  # that is no change
    assert robot.end(begun).json()["success"]
    assert robot.get("/robot/tool").json() == before


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"mass": 14.5}, "mass: must be from 0 to 14 kg (robot.max_payload_kg), got 14.5 kg"),
        ({"mass": -1.0}, "mass: must be from 0 to 14 kg"),
        ({"mass": 1.0, "inertia": [0.0] * 6}, "must be positive definite"),
        ({"mass": 1.0, "inertia": [0.1, 0.0, 0.0, 0.1, 0.0, 0.3]}, "is physically impossible"),
        ({"mass": 1.0, "centre": [0.0, 0.0, 2.5]}, "centre: must be at most 2 m from the flange, got 2.5 m"),
        ({"centre": [0.0, 0.0, 0.1]}, "mass: is missing"),
        ({"tcp": {"quaternion": [0.0] * 4}}, "tcp: the quaternion's length must be 1"),
        ({"tcp": {"a": 1.0, "quaternion": [0.0, 0.0, 0.0, 1.0]}}, "give either quaternion or a, b and c"),
        ({"shapes": {"link7": ROD}}, "is a body, site or frame of the robot"),
        ({"shapes": {"rod": ROD | {"frame_id": "tool"}}}, "omit it"),
        ({"gravity": [0.0, 0.0, -1.62]}, "must be the model file's 9.81 m/s²"),
        ({"weight": 1.0}, "unknown key 'weight'"),
        ({}, "nothing to change"),
    ],
)
def test_what_there_cannot_be_is_refused_and_nothing_changes(
    robot: VirtualService, change: dict[str, Any], what: str
) -> None:
    before, kept = robot.get("/robot/tool").json(), file_of(robot).read()
    refused = have(robot, **change)
    assert refused.status_code == 422, refused.text
    assert what in refused.json()["detail"]
    assert robot.get("/robot/tool").json() == before
    assert file_of(robot).read() == kept


def test_nan_is_refused(robot: VirtualService) -> None:
    text = b'{"mass": NaN}'
    answer = robot.end(
        robot.begin(
            robot.asking("POST", "/robot/tool", content=text, headers={"Content-Type": "application/json"})
        )
    )
    assert answer.status_code == 422


def test_a_load_that_the_drives_cannot_hold_where_the_arm_is_is_refused(robot: VirtualService) -> None:
    heavy = {"mass": 14.0, "centre": [2.0, 0.0, 0.0]}
    refused = have(robot, **heavy)
    assert refused.status_code == 422
    assert "N·m to hold 14 kg in the current position, but its limit is" in refused.json()["detail"]
    assert robot.app.state.services.robot.model.tool.mass == 0.0


def test_a_tilted_base_changes_what_gravity_asks_for(robot: VirtualService) -> None:
    joints = np.array(robot.joints())
    down = [9.81 * np.sin(0.3), 0.0, -9.81 * np.cos(0.3)]
    assert have(robot, gravity=down).json()["gravity"] == pytest.approx(down)
    tilted = Tool(gravity=(down[0], down[1], down[2]))
    assert efforts(robot) == pytest.approx(loaded(tilted).gravity(joints), abs=0.5)
    assert have(robot, gravity=None).json()["gravity"] == pytest.approx([0.0, 0.0, -9.81])


def test_what_cannot_be_kept_does_not_change(robot: VirtualService, monkeypatch: pytest.MonkeyPatch) -> None:
    before = robot.get("/robot/tool").json()
    monkeypatch.setattr("cobot.robot.kept.os.replace", _full)
    assert have(robot, **BODY).status_code == 503
    monkeypatch.undo()
    assert robot.get("/robot/tool").json() == before
    robot.sleep(1.0)
    assert robot.rigs[robot.name].robot.model.tool.mass == 0.0


def _full(*paths: Path) -> None:
    raise OSError(28, "no space left on device")


def test_what_rtloop_refuses_does_not_change(robot: VirtualService, monkeypatch: pytest.MonkeyPatch) -> None:
    before, kept = robot.get("/robot/tool").json(), file_of(robot).read()
    simulation = robot.rigs[robot.name].robot.model
    monkeypatch.setattr("rtloop.tool_and_scene.check_tool", _never)
    refused = have(robot, **BODY)
    monkeypatch.undo()
    assert refused.status_code == 409
    assert "the drives say no" in str(refused.json())
    assert robot.get("/robot/tool").json() == before
    assert file_of(robot).read() == kept
    assert simulation.tool.mass == 0.0


def test_a_defect_on_the_way_to_rtloop_leaves_no_trace(
    robot: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, kept = robot.get("/robot/tool").json(), file_of(robot).read()

    async def fail(*arguments: Any) -> None:
        assert file_of(robot).read() != kept
        raise RuntimeError("a defect")

    monkeypatch.setattr(robot.app.state.services.scene, "send_load", fail)
    with pytest.raises(RuntimeError, match="a defect"):
        have(robot, **BODY)
    monkeypatch.undo()
    assert robot.get("/robot/tool").json() == before
    assert file_of(robot).read() == kept


def _never(*arguments: Any) -> None:
    raise ValueError("the drives say no")


def test_after_a_restart_it_is_still_so(tmp_path: Path) -> None:
    service = VirtualService(tmp_path)
    file_of(service).write(LOAD)
    with service.serving():
        joints = np.array(service.joints())
        assert service.get("/robot/tool").json()["version"] == LOAD.version
        service.sleep(1.0)  # this rtloop has begun without the file: the service sees to it
        assert efforts(service) == pytest.approx(loaded(LOAD).gravity(joints), abs=0.5)
        assert any("rtloop had another tool" in line for line in service.lines)
        assert have(service, mass=5.0).json()["version"] == LOAD.version + 1
        moved = service.post("/robot/move/joints", away(service)).json()
        assert moved["success"], moved
    kept = file_of(service).read()
    assert (kept.mass, kept.inertia, kept.tcp) == (5.0, None, LOAD.tcp)
    assert replace(BARE, version=1).mass == 0.0


def test_the_tcp_is_found_from_points_and_nothing_changes(robot: VirtualService) -> None:
    """Oracle: the tip for which the example of the schema was made."""
    before = robot.get("/robot/tool").json()
    have(robot, tcp={"z": 0.3, "b": 0.7})
    found = robot.client(robot.url).calibrate_tool(EXAMPLE_POINTS)
    np.testing.assert_allclose(found["position"], [0.0, 0.0, 0.15], atol=5e-4)
    assert found["error_m"] < 2e-4
    assert len(found["errors_m"]) == 4
    have(robot, clear=True)
    assert robot.get("/robot/tool").json() == before | {"version": before["version"] + 2}
    for points, said in (
        ([EXAMPLE_POINTS[0]] * 4, "nearly the same orientation"),
        (EXAMPLE_POINTS[:3], "points: must have at least 4 items"),
        ([*EXAMPLE_POINTS[:3], [0.0] * 6], "points[3] must have 7 angles, got 6"),
    ):
        answer = robot.post("/robot/tool/calibrate", {"points": points})
        assert (answer.status_code, said in answer.json()["detail"]) == (422, True), answer.text
