"""The simulated cell over REST. Oracle: the plant that MuJoCo steps."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from physical_cell import EXAMPLE
from rig import Rig
from virtual_service import VirtualService

from cobot.config import Settings
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription
from rtloop import main as rtloop
from rtloop.backends import make_backend
from rtloop.backends.cell import CellBackend


class ServiceOfPlant(VirtualService):
    """With the cell of examples/pick_and_place."""

    plant: CellBackend

    def _rig(self, settings: Settings, robot: RobotDescription, capacity: int, several: bool) -> Rig:
        made = make_backend(settings, robot.limits)
        assert isinstance(made, CellBackend)
        self.plant = made
        memory = RobotMemory.create(self.name, robot.limits.dof, settings.rt.period_s, capacity, self.url)
        rig = Rig(settings, robot, memory=memory, backend=made)
        memory.statistics.data["backend"] = b"mujoco"
        memory.statistics.publish()
        rtloop.describe(memory, robot, made)
        return rig


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfPlant]:
    with ServiceOfPlant(tmp_path_factory.mktemp("cell"), of_robot=f"cell: {EXAMPLE}").serving() as made:
        assert isinstance(made, ServiceOfPlant)
        yield made


def positions(run: ServiceOfPlant) -> dict[str, list[float]]:
    return {each["name"]: each["position"] for each in run.get("/cell").json()["parts"]}


START = {"cube": [0.5, -0.3, 0.225], "bar": [0.6, -0.15, 0.22], "can": [0.65, -0.32, 0.24]}


def test_the_parts_are_where_the_plant_has_them_and_a_reset_puts_them_back(run: ServiceOfPlant) -> None:
    shown = run.get("/cell").json()
    assert [each["name"] for each in shown["switches"]] == ["gate", "gate.count"]
    assert positions(run) == {name: pytest.approx(place, abs=1e-4) for name, place in START.items()}
    data = run.plant._plant_data
    data.joint(run.plant.plant.mj.body_jntadr[run.plant.plant.parts[0]]).qpos[:3] = [0.6, 0.12, 0.34]
    run.sleep(0.05)
    shown = run.get("/cell").json()
    assert positions(run)["cube"][:2] == pytest.approx([0.6, 0.12], abs=1e-3)
    assert [each["value"] for each in shown["switches"]] == [True, 1]
    answer = run.ask("POST", "/cell/reset")
    assert answer.status_code == 200, answer.json()
    assert positions(run) == {name: pytest.approx(place, abs=1e-4) for name, place in START.items()}
    run.sleep(0.05)
    assert [each["value"] for each in run.get("/cell").json()["switches"]] == [False, 0]


def test_the_cell_is_not_reset_while_the_arm_moves(run: ServiceOfPlant) -> None:
    motion = run.begin(run.asking("POST", "/robot/move/named", json={"name": "work", "speed": 0.5}))
    run.sleep(0.3)
    answer = run.ask("POST", "/cell/reset")
    assert answer.status_code == 409
    assert "the cell cannot be reset now: the arm is in mode TRAJECTORY" in answer.text
    assert run.end(motion).status_code == 200


def test_the_outputs_of_the_hand_are_set_over_rest(run: ServiceOfPlant) -> None:
    answer = run.ask("PUT", "/robot/io/hand.width", json={"value": 0.03})
    assert answer.status_code == 200, answer.json()
    run.sleep(1.0)
    points = {each["name"]: each["value"] for each in run.get("/robot/io").json()["points"]}
    assert points["hand.measured_width"] == pytest.approx(0.03, abs=5e-4)
    assert points["hand.moving"] is False
    answer = run.ask("PUT", "/robot/io/hand.width", json={"value": 0.5})
    assert answer.status_code == 502
    assert "hand.width is 0.5, allowed is 0 to 0.08" in answer.text


def test_the_fixtures_are_objects_of_the_scene_that_only_the_cell_file_changes(run: ServiceOfPlant) -> None:
    objects = {each["name"] for each in run.get("/scene").json()["objects"]}
    assert {"table", "tray"} <= objects
    answer = run.ask("POST", "/scene", json={"objects": {"table": None}})
    assert answer.status_code == 409
    assert "'table' is a fixture of the cell: change it in the cell file" in answer.text
    answer = run.ask("POST", "/scene", json={"clear": True})
    assert answer.status_code == 200, answer.text
    assert {each["name"] for each in run.get("/scene").json()["objects"]} == {"table", "tray"}


def test_a_robot_without_a_cell_answers_404_and_says_what_to_do(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    with VirtualService(tmp_path_factory.mktemp("bare")).serving() as bare:
        for method, path in (("GET", "/cell"), ("POST", "/cell/reset")):
            answer = bare.ask(method, path)
            assert answer.status_code == 404
            assert "start it with cobot run --cell FILE, or set robot.cell" in answer.text
