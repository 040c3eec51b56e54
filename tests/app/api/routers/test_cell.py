"""The simulated cell over REST. Oracle: the plant that MuJoCo steps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from physical_cell import EXAMPLE
from plant_service import THE_CELL, ServiceOfPlant
from streaming_client import Frames
from virtual_service import VirtualService


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfPlant]:
    with ServiceOfPlant(tmp_path_factory.mktemp("cell"), of_robot=THE_CELL).serving() as made:
        assert isinstance(made, ServiceOfPlant)
        yield made


START = {"cube": [0.5, -0.3, 0.225], "bar": [0.6, -0.15, 0.22], "can": [0.65, -0.32, 0.24]}


def test_the_parts_are_where_the_plant_has_them_and_a_reset_puts_them_back(run: ServiceOfPlant) -> None:
    shown = run.get("/cell").json()
    assert [each["name"] for each in shown["switches"]] == ["gate", "gate.count"]
    assert run.positions() == {name: pytest.approx(place, abs=1e-4) for name, place in START.items()}
    data = run.plant._plant_data
    data.joint(run.plant.plant.mj.body_jntadr[run.plant.plant.parts[0]]).qpos[:3] = [0.6, 0.12, 0.34]
    run.sleep(0.05)
    shown = run.get("/cell").json()
    assert run.positions()["cube"][:2] == pytest.approx([0.6, 0.12], abs=1e-3)
    assert [each["value"] for each in shown["switches"]] == [True, 1]
    answer = run.ask("POST", "/cell/reset")
    assert answer.status_code == 200, answer.json()
    assert run.positions() == {name: pytest.approx(place, abs=1e-4) for name, place in START.items()}
    run.sleep(0.05)
    assert [each["value"] for each in run.get("/cell").json()["switches"]] == [False, 0]


def test_the_example_of_the_cell_is_a_program_that_runs_and_stays_as_it_is(run: ServiceOfPlant) -> None:
    """Oracle: the file of the example, which is not changed by a save or a deletion."""
    file = EXAMPLE / "pick_and_place.json"
    (listed,) = run.get("/programs").json()
    assert (listed["label"], listed["kind"], listed["example"]) == ("Pick and place", "sequence", True)
    path = f"/programs/{listed['id']}"
    text = file.read_text(encoding="utf-8")
    assert run.get(path).json()["text"] == text
    assert [each["version"] for each in run.get(f"{path}/versions").json()] == [1]
    assert run.get(f"{path}?version=2").status_code == 404
    body = {"label": "Mine", "text": "{}"}
    for method, content in (("PUT", {"json": body}), ("DELETE", {})):
        answer = run.ask(method, path, **content)
        assert answer.status_code == 409
        assert "is an example of the cell and cannot be changed" in answer.json()["detail"]
    assert run.get(path).json()["text"] == text
    assert run.ask("PUT", "/programs/mine", json=body | {"text": text}).status_code == 200
    assert [(each["id"], each["example"]) for each in run.get("/programs").json()] == [
        ("mine", False),
        (listed["id"], True),
    ]
    assert run.ask("DELETE", "/programs/mine").status_code == 200


def test_the_cell_is_not_reset_while_the_arm_moves(run: ServiceOfPlant) -> None:
    motion = run.begin(run.asking("POST", "/robot/move/named", json={"name": "work", "speed": 0.5}))
    run.sleep(0.3)
    answer = run.ask("POST", "/cell/reset")
    assert answer.status_code == 409
    assert "the cell cannot be reset now: the arm is in mode TRAJECTORY" in answer.text
    assert run.end(motion).status_code == 200


def test_the_arm_with_its_cell_is_pulled_and_begins_again(run: ServiceOfPlant) -> None:
    run.go_home()
    home, data = run.joints(), run.plant._plant_data
    dof = len(home)
    session = run.post("/robot/freedrive", {"timeout_s": 60.0}).json()["session"]
    with Frames(run.connect("/robot/stream")) as client:
        for _ in range(20):
            client.send("pull", link="link7", point=[0.0, 0.0, 0.0], target=[0.4, 1.0, 0.7])
            assert client.answer()["type"] == "pull"
            run.sleep(0.05)
        assert session == run.get("/robot/freedrive").json()["session"]
        assert np.abs(data.qfrc_applied[:dof]).max() > 1.0
        client.send("pull")
        run.sleep(0.05)
    np.testing.assert_array_equal(data.qfrc_applied[:dof], 0.0)
    assert np.abs(np.subtract(run.joints(), home)).max() > 0.02
    run.ask("DELETE", "/robot/freedrive").raise_for_status()
    run.sleep(0.5)
    data.joint(run.plant.plant.mj.body_jntadr[run.plant.plant.parts[0]]).qpos[:3] = [0.6, 0.12, 0.34]
    answer = run.ask("POST", "/robot/simulation/reset")
    assert answer.status_code == 200, answer.text
    run.sleep(0.1)
    np.testing.assert_allclose(run.joints(), home, atol=2e-3)
    assert run.positions() == {name: pytest.approx(place, abs=1e-3) for name, place in START.items()}


def test_the_outputs_of_the_hand_are_set_over_rest(run: ServiceOfPlant) -> None:
    answer = run.ask("PUT", "/robot/io/hand.width", json={"value": 0.03})
    assert answer.status_code == 200, answer.json()
    run.sleep(1.0)
    points = {each["name"]: each["value"] for each in run.get("/robot/io").json()["points"]}
    assert points["hand.measured_width"] == pytest.approx(0.03, abs=5e-4)
    assert points["hand.moving"] is False
    answer = run.ask("PUT", "/robot/io/hand.width", json={"value": 0.5})
    assert answer.status_code == 502
    assert "hand.width is 0.5, allowed: 0 to 0.08" in answer.text


def test_the_fixtures_are_objects_of_the_scene_that_only_the_cell_file_changes(run: ServiceOfPlant) -> None:
    objects = {each["name"] for each in run.get("/scene").json()["objects"]}
    assert {"table", "tray"} <= objects
    answer = run.ask("POST", "/scene", json={"objects": {"table": None}})
    assert answer.status_code == 409
    assert "'table' is a fixture of the cell: change it in the cell file" in answer.text
    answer = run.ask("POST", "/scene", json={"clear": True})
    assert answer.status_code == 200, answer.text
    assert {each["name"] for each in run.get("/scene").json()["objects"]} == {"table", "tray"}


def test_planners_avoid_the_fixtures_from_the_first_motion_on(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Oracle: the flange is 25 mm below the top of the table."""
    with ServiceOfPlant(tmp_path_factory.mktemp("new"), of_robot=THE_CELL).serving() as new:
        new.post("/robot/tool", {"clear": True}).raise_for_status()
        answer = new.post("/robot/plan/pose", {"x": 0.6, "y": 0.0, "z": 0.175, "b": 3.14159265})
        assert answer.status_code == 422, answer.text
        assert "link7 and table" in answer.json()["detail"]


def test_the_hand_is_the_tool_until_another_one_is_set(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Oracle: the lengths in the cell file; 0.07 + 0.055 - 0.01 m from the flange to the TCP."""
    folder = tmp_path_factory.mktemp("tool")
    with ServiceOfPlant(folder, of_robot=THE_CELL).serving() as first:
        tool = first.get("/robot/tool").json()
        assert (tool["name"], tool["mass"], tool["position"]) == (
            "hand",
            0.8,
            pytest.approx([0.0, 0.0, 0.115]),
        )
        gripper = first.get("/robot/gripper").json()
        assert (gripper["type"], gripper["connected"]) == ("simulated", True)
        assert gripper["capabilities"]["force_n"][1] == 100.0
        assert not any("had another tool" in line for line in first.lines)
        first.post("/robot/tool", {"clear": True}).raise_for_status()
    with ServiceOfPlant(folder, of_robot=THE_CELL, name=first.name).serving() as second:
        assert second.get("/robot/tool").json()["mass"] == 0.0


def test_a_robot_without_a_cell_answers_404_and_says_what_to_do(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    with VirtualService(tmp_path_factory.mktemp("bare")).serving() as bare:
        for method, path in (("GET", "/cell"), ("POST", "/cell/reset")):
            answer = bare.ask(method, path)
            assert answer.status_code == 404
            assert "start it with cobot run --cell FILE, or set robot.cell" in answer.text


def test_motions_keep_the_hand_away_from_the_fixtures(run: ServiceOfPlant) -> None:
    """Oracle: the table's top is at 0.2 m; the fingers' shapes end 0.025 m above the TCP."""
    drawn = {each["name"]: each["part"] for each in run.get("/robot/geometry").json()["bodies"]}
    assert {name for name, part in drawn.items() if part == "tool"} == {
        "hand",
        "hand.finger1",
        "hand.finger2",
    }
    down = {"x": 0.5, "y": -0.1, "a": 0.0, "b": 3.14159, "c": 0.0}
    run.go_home()
    assert "plan_id" in run.post("/robot/plan/pose", down | {"z": 0.2}).json()
    refused = run.post("/robot/plan/pose", down | {"z": 0.17}).json()
    assert refused["code"] == "collision", refused
    assert "hand.finger" in refused["detail"]
    assert "table" in refused["detail"]
