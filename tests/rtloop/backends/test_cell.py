"""The simulation with a cell. Oracles: MuJoCo's contact forces, weights, and geometry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from independent_models import Pinocchio
from physical_cell import CellArm, with_cell, write_cell

from cobot.cell.surroundings import hand_as_tool, part_in_scene
from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.description import load_robot
from cobot.robot.load import carrying
from cobot.robot.scene import Scene
from cobot.robot.tool import BARE, Tool
from cobot.types import PlannerName
from rtloop.backends import BackendError, HasCell, HasIo, make_backend
from rtloop.backends.cell import CellBackend

GRAVITY = 9.81
FLAT = {"shape": "box", "size_m": [0.6, 0.6, 0.2], "position_m": [0.6, 0.0, 0.1]}


def cube(x: float, y: float, z: float, **other: object) -> dict[str, object]:
    return {
        "shape": "box",
        "size_m": [0.05, 0.05, 0.05],
        "mass_kg": 0.2,
        "position_m": [x, y, z],
        **other,
    }


@pytest.fixture
def arm(settings: Settings) -> CellArm:
    return CellArm(settings, load_robot(settings))


def made(settings: Settings, folder: Path, content: dict[str, object]) -> CellArm:
    return CellArm(settings, load_robot(settings), write_cell(folder, content))


def test_a_part_is_grasped_by_friction_lifted_carried_past_the_light_barrier_and_dropped(
    arm: CellArm,
) -> None:
    arm.pick("cube")
    assert arm.finger_forces("cube") == pytest.approx([40.0, 40.0], rel=0.05)
    assert arm.read("hand.measured_force") == pytest.approx(40.0, rel=0.05)
    assert arm.read("hand.measured_width") == pytest.approx(0.05, abs=3e-4)
    assert arm.part("cube").position[2] == pytest.approx(0.225 + 0.12, abs=1e-3)
    before = arm.part_in_tcp("cube").position
    arm.hold(2000)
    assert np.linalg.norm(arm.part_in_tcp("cube").position - before) < 2e-6, "it creeps"
    assert arm.read("gate.count") == 0
    arm.go_to(0.55, 0.3, 0.345, PlannerName.LIN)
    assert arm.read("gate.count") == 1
    arm.go_to(0.55, 0.3, 0.24, PlannerName.LIN)
    arm.move_hand(0.08)
    arm.hold(500)
    assert arm.finger_forces("cube") == [0.0, 0.0]
    assert arm.part("cube").position == pytest.approx([0.55, 0.3, 0.21 + 0.025], abs=3e-3)


def test_a_held_part_does_not_creep_while_the_arm_turns_it(arm: CellArm) -> None:
    """Oracle: a rigid grasp. Turning about the first joint at full speed is the hardest: the part is far from
    the axis; and the centripetal acceleration points along the fingers.
    """
    arm.pick("can")
    before = arm.part_in_tcp("can")
    here = arm.joints.copy()
    for turned in (0.9, -0.9, 0.9, -0.9, 0.0):
        arm.go(np.array([here[0] + turned, *here[1:]]))
    after = arm.part_in_tcp("can")
    assert np.linalg.norm(after.position - before.position) < 0.05e-3


def test_the_arm_feels_the_weight_of_what_it_holds(arm: CellArm) -> None:
    arm.hold(500)
    assert np.abs(arm.measured.wrench[:3]).max() < 0.05, "the hand alone is the tool"
    arm.pick("cube")
    arm.hold(500)
    assert arm.measured.wrench[:3] == pytest.approx([0.0, 0.0, -0.2 * GRAVITY], abs=0.05)


def test_the_arm_feels_a_contact(settings: Settings, tmp_path: Path) -> None:
    """Oracle: the force of the contact switch, which sums up MuJoCo's normal forces."""
    block = {"shape": "box", "size_m": [0.2, 0.2, 0.2], "position_m": [0.5, 0.0, 0.1]}
    arm = made(
        settings,
        tmp_path,
        {
            "hand": {},
            "fixtures": {"block": block},
            "switches": {
                "soft": {"type": "contact", "body": "block", "force_n": 5.0},
                "hard": {"type": "contact", "body": "block", "force_n": 500.0},
            },
        },
    )
    arm.go_to(0.5, 0.0, 0.25)
    assert arm.read("soft") == 0.0
    arm.robot.collision.surround(arm.robot.collision.scene)
    arm.go_to(0.5, 0.0, 0.2085, PlannerName.LIN)
    arm.hold(500)
    data = arm.backend._plant_data
    normal = sum(data.efc_force[contact.efc_address] for contact in data.contact)
    assert normal > 5.0
    assert arm.measured.wrench[2] == pytest.approx(normal, rel=0.03)
    assert (arm.read("soft"), arm.read("hard")) == (1.0, 0.0)


def test_a_grasp_of_nothing_closes_to_zero(arm: CellArm) -> None:
    cycles = arm.move_hand(0.0, speed=0.1)
    assert arm.read("hand.measured_width") == pytest.approx(0.0, abs=3e-4)
    assert cycles == pytest.approx(800 + 50, abs=40), "0.08 m at 0.1 m/s, and the time to rest"


def test_a_new_width_is_followed_within_a_cycle(arm: CellArm) -> None:
    arm.backend.set_output("hand.width", 0.0)
    assert arm.read("hand.moving") == 1.0
    arm.hold(100)
    narrow = arm.read("hand.measured_width")
    arm.backend.set_output("hand.width", 0.08)
    arm.hold(60)
    assert arm.read("hand.measured_width") > narrow


def test_a_slippery_part_slips_out_of_the_hand(settings: Settings, tmp_path: Path) -> None:
    arm = made(
        settings,
        tmp_path,
        {
            "hand": {},
            "fixtures": {"table": FLAT},
            "parts": {"soap": cube(0.5, 0.0, 0.225, friction=0.01)},
        },
    )
    arm.pick("soap")
    assert arm.part("soap").position[2] == pytest.approx(0.225, abs=2e-3)
    assert arm.read("hand.measured_width") == pytest.approx(0.0, abs=1e-3)


def test_a_part_falls_and_rests_on_what_is_below(settings: Settings, tmp_path: Path) -> None:
    arm = made(
        settings,
        tmp_path,
        {"fixtures": {"table": FLAT}, "parts": {"high": cube(0.6, 0.0, 0.5), "aside": cube(0.6, 0.6, 0.3)}},
    )
    arm.hold(100)
    assert arm.part("high").position[2] == pytest.approx(0.5 - 0.5 * GRAVITY * 0.1**2, abs=1e-3)
    arm.hold(1500)
    assert arm.part("high").position[2] == pytest.approx(0.225, abs=1e-3)
    assert arm.part("aside").position[2] == pytest.approx(0.025, abs=1e-3)


def test_a_belt_carries_a_part_past_switches(settings: Settings, tmp_path: Path) -> None:
    arm = made(
        settings,
        tmp_path,
        {
            "belts": {"belt": {"size_m": [1.0, 0.2, 0.1], "position_m": [0.6, 0.5, 0.05], "speed_m_s": 0.2}},
            "parts": {"box": cube(0.3, 0.5, 0.125)},
            "switches": {
                "gate": {
                    "type": "light_barrier",
                    "from_m": [0.6, 0.3, 0.12],
                    "to_m": [0.6, 0.7, 0.12],
                    "count": True,
                },
                "gap": {
                    "type": "distance",
                    "from_m": [1.2, 0.5, 0.12],
                    "direction": [-1, 0, 0],
                    "range_m": 2.0,
                },
            },
        },
    )
    arm.hold(1000)
    x = arm.part("box").position[0]
    assert x == pytest.approx(0.3 + 0.2 * 1.0, abs=0.01)
    assert arm.read("gap") == pytest.approx(1.2 - x - 0.025, abs=1e-3)
    assert (arm.read("gate"), arm.read("gate.count")) == (0.0, 0.0)
    arm.hold(500)
    assert (arm.read("gate"), arm.read("gate.count")) == (1.0, 1.0)
    arm.backend.set_output("belt.speed", 0.0)
    arm.hold(200)
    rest = arm.part("box").position[0]
    arm.hold(300)
    assert arm.part("box").position[0] == pytest.approx(rest, abs=1e-4)
    arm.backend.set_output("belt.speed", -0.4)
    arm.hold(700)
    assert (arm.read("gate"), arm.read("gate.count")) == (0.0, 1.0)
    assert arm.part("box").position[0] < rest - 0.2


def test_a_reset_puts_all_back_and_leaves_the_arm(arm: CellArm) -> None:
    start = {name: arm.part(name).numbers for name in arm.cell.parts}
    arm.backend.set_output("lamp", 1.0)
    arm.pick("cube")
    arm.go_to(0.55, 0.3, 0.35)
    joints = arm.measured.position.copy()
    arm.backend.reset_cell()
    arm.hold(300)
    assert {name: arm.part(name).numbers for name in arm.cell.parts} == {
        name: pytest.approx(pose, abs=1e-4) for name, pose in start.items()
    }
    assert arm.measured.position == pytest.approx(joints, abs=2e-3)
    assert (arm.read("lamp"), arm.read("gate.count")) == (0.0, 0.0)
    assert arm.read("hand.measured_width") == pytest.approx(0.08, abs=1e-3)


def test_without_a_hand_the_plant_carries_the_tool(settings: Settings, tmp_path: Path) -> None:
    """Oracle: the arm's own model explains all torques, so nothing external is felt."""
    arm = made(settings, tmp_path, {"parts": {"box": cube(0.6, 0.0, 0.025)}})
    tool = replace(BARE, version=1, mass=3.0, centre=(0.0, 0.05, 0.1))
    arm.carry(tool)
    arm.hold(1000)
    assert np.abs(arm.measured.external_effort).max() < 0.01


POSTURES = ([0.3, 0.5, -0.2, -1.4, 0.3, 1.2, 0.1], [-0.6, 0.9, 0.4, -0.9, -0.7, 1.0, 0.8])


def test_a_heavier_tool_of_its_own_counts_once_next_to_the_hand_and_a_held_part(arm: CellArm) -> None:
    """Oracle: pinocchio, with the three masses at the flange. The drives hold what MuJoCo's bodies weigh."""
    assert arm.cell.hand is not None
    hand, cube = hand_as_tool(arm.cell.hand), arm.cell.parts["cube"]
    adapter = Tool(mass=1.5, centre=(0.02, -0.03, 0.04))
    centre = (hand.mass * np.array(hand.centre) + 1.5 * np.array(adapter.centre)) / (hand.mass + 1.5)
    x, y, z = centre.tolist()
    tool = replace(hand, version=2, mass=hand.mass + 1.5, centre=(x, y, z))
    before_kg = arm.backend.plant.mj.body_mass.sum()
    arm.carry(tool)
    assert arm.backend.plant.mj.body_mass.sum() == pytest.approx(before_kg + 1.5)
    arm.pick("cube")
    pose = arm.part_in_tcp("cube")
    scene = Scene(objects={"cube": replace(part_in_scene(cube, pose.numbers), attached=True)})
    held = carrying(tool, scene, arm.robot.model.tcp_in_flange(tool))
    arm.robot.model.carry(held)
    arm.backend.set_tool(held)
    other = Pinocchio()
    for joints in POSTURES:
        arm.go(np.array(joints))
        arm.hold(800)
        pinocchio.forwardKinematics(other.model, other.data, arm.measured.position)
        wrist, wanted = other.data.oMi[-1], other.gravity(arm.measured.position)
        flange = arm.robot.model.forward(arm.measured.position) @ arm.robot.model.flange_in_tcp()
        for mass, place in (
            (hand.mass, flange.apply(np.array(hand.centre))),
            (1.5, flange.apply(np.array(adapter.centre))),
            (cube.mass_kg, arm.part("cube").position),
        ):
            jacobian = pinocchio.computeJointJacobian(
                other.model, other.data, arm.measured.position, other.model.njoints - 1
            )
            linear, angular = wrist.rotation @ jacobian[:3], wrist.rotation @ jacobian[3:]
            of_point = linear + np.cross(angular.T, place - wrist.translation).T
            wanted += of_point.T @ np.array([0.0, 0.0, mass * GRAVITY])
        np.testing.assert_allclose(arm.measured.effort, wanted, atol=0.03)
        assert np.abs(arm.measured.external_effort).max() < 0.03


def test_a_lighter_tool_leaves_the_hand_as_heavy_as_it_is(arm: CellArm) -> None:
    before_kg = arm.backend.plant.mj.body_mass.sum()
    arm.carry(BARE)
    assert arm.backend.plant.mj.body_mass.sum() == pytest.approx(before_kg)
    arm.hold(800)
    assert arm.cell.hand is not None
    assert np.abs(arm.measured.external_effort).max() > 0.1, "it feels the hand"


@pytest.mark.parametrize(
    ("name", "value", "refusal"),
    [
        ("hand.width", 0.081, "hand.width is 0.081, allowed: 0 to 0.08"),
        ("hand.width", float("nan"), "hand.width is nan, allowed"),
        ("hand.speed", 0.0, "hand.speed is 0, allowed: 0.001 to 0.2"),
        ("hand.force", 101.0, "hand.force is 101, allowed: 0 to 100"),
        ("hand.moving", 1.0, "hand.moving is an input"),
        ("gate", 1.0, "gate is an input"),
        ("nothing", 1.0, "the cell has no input or output 'nothing'"),
    ],
)
def test_a_bad_output_changes_nothing(arm: CellArm, name: str, value: float, refusal: str) -> None:
    before = arm.backend.io()
    with pytest.raises(BackendError, match=refusal):
        arm.backend.set_output(name, value)
    assert arm.backend.io() == before


def test_the_backend_has_the_protocols_of_its_cell(arm: CellArm) -> None:
    assert isinstance(arm.backend, CellBackend)
    assert isinstance(arm.backend, HasIo)
    assert isinstance(arm.backend, HasCell)
    assert arm.backend.part_names == ("cube", "bar", "can")


def test_a_real_arm_has_no_simulated_cell(settings: Settings, tmp_path: Path) -> None:
    robot = load_robot(settings)
    given = with_cell(settings, write_cell(tmp_path, {}))
    fri = given.robot.model_copy(update={"backend": given.robot.backend.model_copy(update={"type": "fri"})})
    with pytest.raises(ConfigError, match=r"robot\.cell: .*'fri' drives a real arm; set robot\.cell to null"):
        make_backend(given.model_copy(update={"robot": fri}), robot.limits)
