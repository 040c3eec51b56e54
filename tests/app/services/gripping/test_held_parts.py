"""The parts of a cell between the fingers. Oracle: the bodies that MuJoCo steps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from cell_run import EXAMPLE
from plant_service import THE_CELL, ServiceOfPlant

from app.services.gripping.held import HeldService
from app.services.motion.scene import SceneService
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.cell import load_cell
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject

DOWN = {"b": math.pi}
CUBE = {"x": 0.5, "y": -0.3, "z": 0.225}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfPlant]:
    with ServiceOfPlant(tmp_path_factory.mktemp("held"), of_robot=THE_CELL).serving() as made:
        assert isinstance(made, ServiceOfPlant)
        yield made


def go(run: ServiceOfPlant, **place: Any) -> None:
    answer = run.post("/robot/move/pose", {**CUBE, **DOWN, "planner": "lin", "speed": 0.5, **place}).json()
    assert answer["success"], answer


def command(run: ServiceOfPlant, name: str, **body: Any) -> dict[str, Any]:
    answer: dict[str, Any] = run.post(f"/robot/gripper/{name}", body).json()
    assert answer["success"], answer
    return answer


def scene(run: ServiceOfPlant) -> dict[str, dict[str, Any]]:
    return {each["name"]: each for each in run.get("/scene").json()["objects"]}


def test_the_hand_of_the_cell_is_the_gripper_without_a_setting(run: ServiceOfPlant) -> None:
    assert command(run, "move", width=0.08)["width"] == pytest.approx(0.08, abs=1e-3)


def test_the_tcp_is_between_the_fingers_before_a_tool_is_set(run: ServiceOfPlant) -> None:
    tool = run.get("/robot/tool").json()
    assert (tool["name"], tool["mass"]) == ("hand", 0.8)
    assert tool["position"] == pytest.approx([0.0, 0.0, 0.115])


def test_a_grasped_part_is_in_the_scene_until_it_is_released(run: ServiceOfPlant) -> None:
    assert set(scene(run)) == {"table", "tray"}
    run.go_home()
    go(run, z=0.36, planner="ptp")
    go(run)
    assert command(run, "grasp", width=0.05, force=40.0)["held"] == "cube"
    run.until(lambda: scene(run).get("cube", {}).get("attached"))
    held = scene(run)["cube"]
    assert (held["mass"], held["size"]) == (0.2, [0.05, 0.05, 0.05])
    go(run, z=0.4)
    run.sleep(0.5)
    tcp = run.rig.robot.model.forward(np.array(run.joints()))
    in_scene = tcp.apply(np.array(held["position"]))
    assert run.positions()["cube"] == pytest.approx(in_scene, abs=2e-3)
    assert run.positions()["cube"][2] > 0.38
    go(run, z=0.228)  # a held part may touch the fixtures: it is placed on them
    released = command(run, "release")
    assert released["held"] is None
    run.until(lambda: "cube" not in scene(run))
    go(run, z=0.4)
    run.sleep(0.2)
    assert run.positions()["cube"] == pytest.approx([0.5, -0.3, 0.225], abs=2e-3)


def test_the_state_of_the_arm_has_that_of_the_gripper(run: ServiceOfPlant) -> None:
    """Oracle: what GET /robot/gripper reports."""
    run.go_home()
    go(run, z=0.36, planner="ptp")
    go(run)
    command(run, "grasp", width=0.05, force=40.0)
    for held in ("held_inside", "none"):
        run.sleep(0.3)
        reported, state = run.get("/robot/gripper").json()["state"], run.get("/robot/state").json()
        assert (reported["object"], state["gripper_object"]) == (held, held.upper())
        for name in ("width", "commanded_width", "force"):
            assert state[f"gripper_{name}"] == pytest.approx(reported[name], abs=1e-3, rel=0.05), name
        assert state["gripper_moving"] == 0
        assert 0 <= state["monotonic_ns"] - state["gripper_monotonic_ns"] < 2e8
        if held != "none":
            command(run, "release")
    running = run.begin(run.asking("POST", "/robot/gripper/move", json={"width": 0.0, "speed": 0.02}))
    run.until(lambda: run.get("/robot/state").json()["gripper_moving"])
    run.end(running)
    command(run, "release")


def test_a_reset_of_the_cell_takes_a_held_part_out_of_the_scene(run: ServiceOfPlant) -> None:
    go(run, z=0.36)
    go(run)
    command(run, "grasp", width=0.05, force=40.0)
    run.until(lambda: scene(run).get("cube", {}).get("attached"))
    go(run, z=0.4)
    run.post("/cell/reset").raise_for_status()
    run.until(lambda: "cube" not in scene(run))
    assert run.get("/robot/gripper").json()["held"] is None


@pytest.mark.parametrize("path", ["move/pose?wait=false", "move/pose?queue=true", "force/press?wait=false"])
def test_what_is_released_on_the_way_is_out_of_the_scene_before_the_arm_moves_on(
    run: ServiceOfPlant, path: str
) -> None:
    go(run, z=0.36)
    go(run)
    command(run, "grasp", width=0.05, force=40.0)
    up = run.begin(run.asking("POST", "/robot/move/pose", json={**CUBE, **DOWN, "z": 0.4, "planner": "lin"}))
    run.until(lambda: run.get("/robot/state").json()["mode"] == "TRAJECTORY")
    command(run, "release")
    assert scene(run)["cube"]["attached"]  # what the arm carries changes only while it rests
    assert run.end(up).json()["success"]
    body: dict[str, Any] = {**CUBE, **DOWN, "z": 0.36, "planner": "lin", "speed": 0.1}
    if "press" in path:
        body = {"force": 5.0, "direction": {"x": 0.0, "y": 0.0, "z": 1.0}, "frame": "base"}
    answer = run.post(f"/robot/{path}", body)
    assert answer.is_success, answer.text
    run.until(lambda: run.get("/robot/state").json()["mode"] != "HOLD")
    assert "cube" not in scene(run)
    run.post("/stop").raise_for_status()
    run.until(lambda: run.get("/robot/state").json()["mode"] == "HOLD")
    run.post("/cell/reset").raise_for_status()


def test_a_fixture_that_the_fingers_press_against_is_not_held(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    pose = (*robot.model.forward(home).position.tolist(), 1.0, 0.0, 0.0, 0.0)
    near = {name: SceneObject("box", (0.5, 0.5, 0.02), pose) for name in ("table", "plate")}
    cell = load_cell(EXAMPLE / "cell.yaml")
    assert "table" in cell.fixtures
    for objects, held in ((near, "plate"), ({"table": near["table"]}, None)):
        service = HeldService(
            robot,
            cast(RobotLink, SimpleNamespace(state=lambda: SimpleNamespace(position=home), cell=dict)),
            cast(Ownership, SimpleNamespace()),
            cast(SceneService, SimpleNamespace(scene=Scene(1, objects))),
            cell,
        )
        assert service._between() == held
