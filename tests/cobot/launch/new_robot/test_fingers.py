"""Fingers of a robot's file become its gripper. Oracles: MuJoCo's contacts, and the ranges of the file."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from physical_cell import CellArm, write_cell
from plant_service import ServiceOfPlant
from urdf_arms import ARMS, BOX, INERTIAL, link, urdf

from cobot.cell import OwnHand, cell_of, hand_of
from cobot.config import Settings, load_settings
from cobot.errors import ConfigError
from cobot.grippers.registry import gripper_options
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.planners import PlannerName
from cobot.robot.description import load_robot
from cobot.robot.tool import Tool
from rtloop.backends import make_backend

OPPOSITE = link("f1", "tool0", "prismatic", range_="0 0.04", joint="finger1", axis="1 0 0") + link(
    "f2", "tool0", "prismatic", range_="0 0.04", joint="finger2", axis="1 0 0",
    mimic='joint="finger1" multiplier="-1"',
)  # fmt: skip
CUBE_M = 0.04
CELL = {
    "parts": {
        "cube": {"shape": "box", "size_m": [CUBE_M] * 3, "mass_kg": 0.1, "position_m": [0.45, 0.0, 0.02]}
    }
}


@pytest.fixture(scope="module")
def fr3_file() -> Path:
    """The URDF of a Franka with its hand, in franky-sim."""
    return Path(pytest.importorskip("franky_sim").__file__).parent / "assets" / "fr3.urdf"


@pytest.fixture(scope="module")
def fr3(fr3_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "fr3"
    NewRobot(fr3_file).write(folder)
    return folder


def settings_of(folder: Path) -> Settings:
    return load_settings(folder / "cobot-setting.yaml")


def made(file: Path, text: str) -> tuple[Path, str]:
    """The folder of a robot, and what was reported about it."""
    file.write_text(text, encoding="utf-8")
    new = NewRobot(file)
    new.write(file.with_suffix(""))
    return file.with_suffix(""), "\n".join(new.guessed)


@pytest.mark.thorough
def test_the_hand_of_a_franka_is_a_gripper_with_the_ranges_of_its_file(fr3: Path) -> None:
    hand = hand_of(settings_of(fr3))
    assert isinstance(hand, OwnHand)
    assert [finger.body for finger in hand.fingers] == ["fr3_leftfinger", "fr3_rightfinger"]
    assert (hand.stroke_m, hand.max_force_n) == (pytest.approx(0.08), 100.0)


def test_it_picks_a_cube_up(fr3: Path, tmp_path: Path) -> None:
    settings = settings_of(fr3)
    arm = CellArm(settings, load_robot(settings), write_cell(tmp_path, CELL))
    assert arm.read("hand.measured_width") == pytest.approx(0.08, abs=1e-4)
    arm.go_to(0.45, 0.0, 0.15)
    arm.go_to(0.45, 0.0, 0.02, PlannerName.LIN)
    arm.move_hand(0.0)
    assert arm.read("hand.measured_width") == pytest.approx(CUBE_M, abs=1e-3)
    arm.go_to(0.45, 0.0, 0.25, PlannerName.LIN)
    assert arm.part("cube").position[2] == pytest.approx(0.25, abs=2e-3)
    arm.move_hand(0.08)
    arm.hold(500)
    assert arm.part("cube").position[2] == pytest.approx(0.02, abs=5e-3), "it is dropped"


def test_the_fingers_move_together_whatever_presses_on_one(fr3: Path, tmp_path: Path) -> None:
    settings = settings_of(fr3)
    arm = CellArm(settings, load_robot(settings), write_cell(tmp_path, {"floor_m": None}))
    for width in (0.03, 0.0, 0.08):
        arm.move_hand(width)
        data = arm.backend._plant_data
        both = [data.joint(f"hand finger {number}").qpos[0] for number in (1, 2)]
        np.testing.assert_allclose(both, 0.5 * width, atol=3e-4)


def test_the_plant_carries_a_tool_that_is_mounted_next_to_the_fingers(fr3: Path, tmp_path: Path) -> None:
    """Oracle: the arm's own model explains all torques, so nothing external is felt."""
    settings = settings_of(fr3)
    arm = CellArm(settings, load_robot(settings), write_cell(tmp_path, {"floor_m": None}))
    unloaded_kg = arm.backend.plant.mj.body_mass.sum()
    arm.carry(Tool(version=1, mass=1.5, centre=(0.0, 0.05, 0.03)))
    assert arm.backend.plant.mj.body_mass.sum() - unloaded_kg == pytest.approx(1.5)
    arm.hold(1000)
    assert np.abs(arm.measured.external_effort).max() < 0.01


def test_planned_motions_have_the_fingers_where_the_file_has_them_open(fr3: Path, fr3_file: Path) -> None:
    """Oracle: the file as MuJoCo reads it, with its finger joints at the same width."""
    settings = settings_of(fr3)
    original = mujoco.MjSpec.from_file(str(fr3_file)).compile()
    theirs = mujoco.MjData(original)
    for number in (1, 2):
        theirs.joint(f"fr3_finger_joint{number}").qpos[0] = 0.04
    mujoco.mj_kinematics(original, theirs)
    robot = load_robot(settings)
    ours = mujoco.MjData(robot.model.mj)
    mujoco.mj_kinematics(robot.model.mj, ours)
    for finger in ("fr3_leftfinger", "fr3_rightfinger"):
        np.testing.assert_allclose(ours.body(finger).xpos, theirs.body(finger).xpos, atol=1e-9)


@pytest.fixture(scope="module")
def running(fr3: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfPlant]:
    folder = tmp_path_factory.mktemp("service")
    content = yaml.safe_load((fr3 / "cobot-setting.yaml").read_text())
    keys = content["robot"] | {name: str(fr3 / content["robot"][name]) for name in ("model", "srdf")}
    keys["cell"] = str(write_cell(folder, CELL))
    del keys["name"]
    of_robot = ", ".join(
        f"{name}: {yaml.safe_dump(value, default_flow_style=True, width=10_000).splitlines()[0]}"
        for name, value in keys.items()
    )
    more = f"web: {{joint_limits: {fr3 / 'joint_limits.yaml'}}}\nplanning: {{default_frame: fr3_link0}}\n"
    service = ServiceOfPlant(folder, of_robot=of_robot, more=more)
    with service.serving():
        yield service


def test_the_service_grasps_with_it_and_attaches_the_part(running: ServiceOfPlant) -> None:
    client = running.client("http://robot.test")
    unloaded_kg = running.plant.plant.mj.body_mass.sum()
    report = client.gripper.state()
    assert (report["type"], report["capabilities"]["width_m"]) == ("simulated", [0.0, pytest.approx(0.08)])
    down = {"a": 0.0, "b": 3.14159, "c": 0.0}
    client.move_pose(x=0.45, y=0.0, z=0.15, **down)
    client.move_pose(x=0.45, y=0.0, z=0.02, **down, planner="lin", speed=0.3)
    answer = client.gripper.grasp(CUBE_M, force=40.0)
    assert (answer["object"], answer["held"]) == ("held_inside", "cube")
    client.move_pose(x=0.45, y=0.0, z=0.25, **down, planner="lin", speed=0.3)
    (cube,) = running.get("/cell").json()["parts"]
    assert cube["position"][2] == pytest.approx(0.25, abs=3e-3)
    # The tool has its weight in the plant, the part is a body there; the arm's model has both.
    client.set_tool(mass=0.7, centre=[0.0, 0.0, 0.05])
    running.run(asyncio.sleep(0.5))
    state = running.get("/robot/state").json()
    assert np.abs(state["external_effort"]).max() < 0.02
    plant = running.plant.plant.mj
    assert plant.body_mass.sum() == pytest.approx(unloaded_kg + 0.7)
    assert client.gripper.release()["object"] == "none"


def test_a_follower_that_turns_its_axis_is_the_other_finger(tmp_path: Path) -> None:
    folder, said = made(tmp_path / "arm.urdf", urdf(ARMS["ur"], OPPOSITE))
    hand = hand_of(settings_of(folder))
    assert isinstance(hand, OwnHand)
    assert [finger.axis for finger in hand.fingers] == [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]
    assert (hand.stroke_m, hand.max_force_n, hand.max_speed_m_s) == (0.08, 20.0, 1.0)
    assert "planning assumes open fingers: finger1 at 0.04 m, finger2 at -0.04 m" in said


def test_fingers_without_masses_get_light_ones(tmp_path: Path) -> None:
    bare = OPPOSITE.replace(INERTIAL, "").replace(BOX, "")
    folder, said = made(tmp_path / "arm.urdf", urdf(ARMS["ur"], bare))
    assert "mass 0.02 kg assumed of f1, f2" in said
    settings = settings_of(folder)
    masses = load_robot(settings).model.mj
    assert [masses.body(name).mass[0] for name in ("f1", "f2")] == [0.02, 0.02]
    make_backend(settings, load_robot(settings).limits)


@pytest.mark.parametrize(
    ("fingers", "why"),
    [
        (
            link("f", "tool0", "revolute", joint="finger_1"),
            "the ends of its fingers are 161 to 173 mm apart; closed fingers may be at most 0.5 times",
        ),
        (
            link("left", "tool0", "prismatic", range_="0 0.04", joint="finger_1")
            + link(
                "right", "tool0", "prismatic", range_="0 0.04", joint="finger_2", mimic='joint="finger_1"'
            ),
            "its fingers do not slide towards each other",
        ),
        (
            link("left", "tool0", "prismatic", range_="0 0.9", joint="finger_1")
            + link("right", "tool0", "prismatic", range_="0 0.9", joint="finger_2"),
            "finger_1 slides by 0.9 m, allowed: 0.001 to 0.5 m",
        ),
    ],
)
def test_fingers_that_cannot_be_simulated_stay_where_they_are(fingers: str, why: str, tmp_path: Path) -> None:
    folder, said = made(tmp_path / "arm.urdf", urdf(ARMS["ur"], fingers))
    assert f"gripper found; its joints stay where they are, with mass and shapes ({why}" in said
    assert settings_of(folder).robot.gripper is None


def changed(fr3: Path, tmp_path: Path, **change: object) -> Settings:
    content = yaml.safe_load((fr3 / "cobot-setting.yaml").read_text())
    content["robot"] |= {name: str(fr3 / content["robot"][name]) for name in ("model", "srdf")}
    content["web"]["joint_limits"] = str(fr3 / "joint_limits.yaml")
    content["robot"]["gripper"]["hand"] |= change
    (tmp_path / "changed.yaml").write_text(yaml.safe_dump(content))
    return load_settings(tmp_path / "changed.yaml")


def test_a_wrong_description_of_the_hand_names_what_is_wrong(fr3: Path, tmp_path: Path) -> None:
    finger = {"body": "fr3_leftfinger", "axis": [0.0, 1.0, 0.0], "travel_m": 0.04}
    robot = load_robot(settings_of(fr3))
    for change, words in (
        ({"finger": []}, r"robot\.gripper\.hand: unknown key 'finger' \(did you mean 'fingers'\?\)"),
        ({"fingers": [finger]}, r"robot\.gripper\.hand: fingers"),
        ({"fingers": [finger, finger | {"axis": [0, 2, 0]}]}, r"fingers\[1\]\.axis"),
        ({"max_force_n": 0.0}, r"max_force_n: must be greater than or equal to 1"),
    ):
        with pytest.raises(ConfigError, match=words):
            cell_of(changed(fr3, tmp_path, **change))
    for body, words in (("thumb", "the model has no body 'thumb'"), ("fr3_link3", "is a link of the arm")):
        settings = changed(fr3, tmp_path, fingers=[finger, finger | {"body": body}])
        with pytest.raises(ConfigError, match=words):
            CellArm(settings, robot, write_cell(tmp_path, {}))


def test_the_hand_of_the_model_takes_the_place_of_that_of_a_cell(fr3: Path, tmp_path: Path) -> None:
    settings = settings_of(fr3)
    with_cell = settings.robot.model_copy(update={"cell": write_cell(tmp_path, {"hand": {"stroke_m": 0.05}})})
    settings = settings.model_copy(update={"robot": with_cell})
    assert isinstance(hand_of(settings), OwnHand)
    cell = cell_of(settings)
    assert cell is not None
    assert cell.hand is None


def test_its_backend_is_the_simulation(fr3: Path) -> None:
    settings = settings_of(fr3)
    robot = load_robot(settings)
    other = settings.robot.model_copy(
        update={"backend": settings.robot.backend.model_copy(update={"type": "fri"})}
    )
    with pytest.raises(ConfigError, match=r"name the real gripper, or set robot\.gripper to null"):
        make_backend(settings.model_copy(update={"robot": other}), robot.limits)
    assert gripper_options(settings).model_dump()["hand"]["max_force_n"] == 100.0
