"""The suction cup of a simulated cell. Oracles: MuJoCo's contact forces, weights, and the pulling force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from folders import ROOT
from physical_cell import DOWN, CellArm, write_cell
from plant_service import ServiceOfPlant

from cobot.cell.plant_hands import LIPS
from cobot.config import Settings
from cobot.robot.description import load_robot
from cobot.types import Pose

EXAMPLE = ROOT / "examples" / "pick_by_vacuum"
GRAVITY = 9.81
FORCE_N, FULL_KPA, PLATE_KG = 60.0, 70.0, 1.5
CONTENT: dict[str, Any] = {
    "cup": {"force_n": FORCE_N, "vacuum_kpa": FULL_KPA},
    "parts": {
        "plate": {
            "shape": "box",
            "size_m": [0.2, 0.2, 0.02],
            "mass_kg": PLATE_KG,
            "position_m": [0.5, 0.0, 0.01],
        }
    },
}
TOP_M = 0.02


@pytest.fixture
def arm(settings: Settings, tmp_path: Path) -> CellArm:
    return CellArm(settings, load_robot(settings), write_cell(tmp_path, CONTENT))


def lower(arm: CellArm, x: float, y: float = 0.0) -> None:
    """Put the cup on the plate, pressing a little."""
    arm.go(Pose(np.array([x, y, TOP_M + 0.05]), DOWN))
    arm.go(Pose(np.array([x, y, TOP_M - 0.0003]), DOWN))


def pressed_n(arm: CellArm) -> float:
    """Sum of the normal forces between the lip and a part: MuJoCo's contact forces."""
    mj, data, force, total = arm.backend.plant.mj, arm.backend._plant_data, np.zeros(6), 0.0
    for index, contact in enumerate(data.contact):
        if {mj.geom(contact.geom1).name, mj.geom(contact.geom2).name} & set(LIPS):
            mujoco.mj_contactForce(mj, data, index, force)
            total += force[0]
    return total


def suck(arm: CellArm, on: bool, cycles: int = 500) -> None:
    arm.backend.set_output("cup.suction", float(on))
    arm.hold(cycles)


def test_it_lifts_a_plate_and_the_air_presses_it_against_the_lip(arm: CellArm) -> None:
    """Oracle: statics. The lip carries the force of the air less the weight."""
    lower(arm, 0.5)
    assert arm.read("cup.vacuum") == 0.0
    suck(arm, True)
    assert arm.read("cup.vacuum") == pytest.approx(FULL_KPA, rel=1e-3)
    arm.go(Pose(np.array([0.5, 0.0, 0.25]), DOWN))
    arm.hold(500)
    assert arm.part_in_tcp("plate").position == pytest.approx([0.0, 0.0, 0.01], abs=5e-4)
    assert pressed_n(arm) == pytest.approx(FORCE_N - PLATE_KG * GRAVITY, rel=0.02)
    assert arm.measured.wrench[2] == pytest.approx(-PLATE_KG * GRAVITY, rel=0.02), "as the arm feels it"
    before = arm.part_in_tcp("plate").position
    arm.go_to(0.5, 0.25, 0.25)
    assert np.linalg.norm(arm.part_in_tcp("plate").position - before) < 1e-3
    suck(arm, False)
    assert arm.part("plate").position[2] == pytest.approx(0.01, abs=2e-3), "it has fallen"
    assert arm.read("cup.vacuum") == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(("share", "holds"), [(0.9, True), (1.1, False)])
def test_the_plate_comes_off_at_the_stated_force(arm: CellArm, share: float, holds: bool) -> None:
    lower(arm, 0.5)
    suck(arm, True)
    arm.go(Pose(np.array([0.5, 0.0, 0.25]), DOWN))
    plate = arm.backend.plant.parts[0]
    for mass_kg in np.linspace(PLATE_KG, share * FORCE_N / GRAVITY, 500):
        arm.backend.plant.mj.body_mass[plate] = mass_kg
        arm.hold()
    arm.hold(600)
    assert bool(arm.part("plate").position[2] > 0.2) is holds
    assert (arm.read("cup.vacuum") > 0.5 * FULL_KPA) is holds


@pytest.mark.parametrize("x", [0.59, 0.75])
def test_a_cup_that_does_not_sit_on_the_part_leaks(arm: CellArm, x: float) -> None:
    """Half of the lip is beyond the edge, or all of it."""
    lower(arm, x)
    suck(arm, True)
    assert arm.read("cup.vacuum") == pytest.approx(0.1 * FULL_KPA, rel=0.01)
    arm.go(Pose(np.array([x, 0.0, 0.25]), DOWN))
    assert arm.part("plate").position[2] < 0.05


def test_a_reset_puts_the_plate_back_and_ends_the_suction(arm: CellArm) -> None:
    lower(arm, 0.5)
    suck(arm, True)
    arm.go(Pose(np.array([0.5, 0.0, 0.25]), DOWN))
    arm.backend.reset_cell()
    arm.hold(500)
    assert arm.part("plate").position == pytest.approx([0.5, 0.0, 0.01], abs=1e-3)
    assert (arm.read("cup.suction"), arm.read("cup.vacuum")) == (0.0, 0.0)


@pytest.fixture
def service(tmp_path: Path) -> ServiceOfPlant:
    return ServiceOfPlant(tmp_path, of_robot=f"cell: {EXAMPLE}")


def test_the_vacuum_driver_picks_and_places_in_the_example(service: ServiceOfPlant) -> None:
    down = {"a": 0.0, "b": 3.14159, "c": 0.0}
    with service.serving():
        client = service.client("http://robot.test")
        assert client.gripper.state()["type"] == "vacuum"
        x, y, z = service.positions()["sheet"]
        top_m = z + 0.001
        client.move_pose(x=x, y=y, z=top_m + 0.1, **down)
        missed = client.gripper.grasp(if_missed="success")
        assert (missed["object"], missed["held"]) == ("none", None)
        client.gripper.release()
        client.move_pose(x=x, y=y, z=top_m, **down, planner="lin", speed=0.2)
        answer = client.gripper.grasp()
        assert (answer["object"], answer["held"]) == ("held_inside", "sheet")
        client.move_pose(x=x, y=y, z=top_m + 0.15, **down, planner="lin", speed=0.3)
        assert service.positions()["sheet"][2] == pytest.approx(z + 0.15, abs=2e-3)
        client.move_pose(x=x, y=-y, z=top_m + 0.15, **down, planner="lin", speed=0.5)
        client.move_pose(x=x, y=-y, z=top_m + 0.002, **down, planner="lin", speed=0.2)
        assert client.gripper.release()["object"] == "none"
        assert service.positions()["sheet"][:2] == pytest.approx([x, -y], abs=3e-3)
