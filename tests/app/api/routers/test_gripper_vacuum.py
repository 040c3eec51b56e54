"""A suction cup at the outputs of a simulated cell, over REST. Oracle: a light barrier that a part interrupts
stands for the vacuum sensor; MuJoCo says whether it does.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from plant_service import ServiceOfPlant

CELL = """\
hand: null
parts:
  cube: {shape: box, size_m: [0.04, 0.04, 0.04], mass_kg: 0.1, position_m: [0.9, 0.9, 0.02]}
switches:
  vacuum: {type: light_barrier, from_m: [0.9, 0.7, 0.02], to_m: [0.9, 1.1, 0.02]}
outputs:
  ejector: {kind: boolean}
  blow: {kind: analog}
"""
GRIPPER = "{type: vacuum, output: ejector, blow_output: blow, blow_value: 4.0, sensor: vacuum, on_loss: stop}"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfPlant]:
    folder: Path = tmp_path_factory.mktemp("vacuum")
    (folder / "cell.yaml").write_text(CELL, encoding="utf-8")
    with ServiceOfPlant(
        folder, of_robot=f"cell: {folder / 'cell.yaml'}, gripper: {GRIPPER}"
    ).serving() as made:
        assert isinstance(made, ServiceOfPlant)
        # By default a driver measures with the computer's clock, which the virtual clock overtakes.
        made.app.state.services.gripper._worker.gripper._clock = made.clock
        yield made


def points(run: ServiceOfPlant) -> dict[str, Any]:
    return {each["name"]: each["value"] for each in run.get("/robot/io").json()["points"]}


def put(run: ServiceOfPlant, y: float) -> None:
    data = run.plant._plant_data
    data.joint(run.plant.plant.mj.body_jntadr[run.plant.plant.parts[0]]).qpos[:3] = [0.9, y, 0.02]
    run.sleep(0.2)


def ask(run: ServiceOfPlant, command: str, body: dict[str, Any] | None = None) -> Any:
    return run.ask("POST", f"/robot/gripper/{command}", json=body or {})


def test_a_part_is_held_lost_and_missed_by_the_sensor(run: ServiceOfPlant) -> None:
    report = run.get("/robot/gripper").json()
    assert (report["type"], report["capabilities"]["width_m"]) == ("vacuum", None)
    held = ask(run, "grasp").json()
    assert (held["success"], held["object"], held["width"]) == (True, "held_inside", None)
    assert points(run)["ejector"] is True
    put(run, 0.3)
    assert run.get("/robot/gripper").json()["state"]["object"] == "lost"
    missed = ask(run, "grasp").json()
    assert (missed["success"], missed["object"]) == (False, "none")
    assert "closed on nothing: no object is held" in missed["message"]
    put(run, 0.9)


def test_a_release_blows_off_and_vacuum_that_stays_is_an_error(run: ServiceOfPlant) -> None:
    assert ask(run, "grasp").json()["success"]
    released = run.begin(run.asking("POST", "/robot/gripper/release", json={}))
    run.until(lambda: points(run)["blow"] == 4.0)
    assert points(run)["ejector"] is False
    answer = run.end(released).json()  # the part still interrupts the barrier
    assert "there is still vacuum 0.9 s after the release: vacuum" in str(answer)
    assert points(run)["blow"] == 0.0
    put(run, 0.3)
    assert run.get("/robot/gripper").json()["state"]["fault"] == ""
    put(run, 0.9)


@pytest.mark.parametrize(
    ("command", "body", "words"),
    [
        (
            "move",
            {"width": 0.02},
            "width is 0.02 m, but the gripper vacuum has no width: use grasp and release",
        ),
        ("grasp", {"width": 0.02}, "has no width: omit it"),
        ("grasp", {"force": 5.0}, "has no force control"),
        ("grasp", {"width": "NaN"}, "width"),
    ],
)
def test_what_a_cup_does_not_have_is_rejected_and_nothing_is_switched(
    run: ServiceOfPlant, command: str, body: dict[str, Any], words: str
) -> None:
    before = points(run)
    answer = ask(run, command, body)
    assert answer.status_code in (422, 501), answer.text
    assert words in answer.text
    assert points(run) == before
