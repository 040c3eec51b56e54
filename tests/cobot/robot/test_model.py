"""Kinematics and dynamics of the shipped arm.

Oracle: pinocchio, which reads a URDF with the numbers of the shipped MJCF; KUKA's data sheet.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from independent_models import LIMITS, MJCF, mjcf_root, numbers, second_robot, urdf

from cobot.errors import ConfigError, UnavailableError
from cobot.robot.description import RobotDescription
from cobot.robot.limits import load_joint_limits
from cobot.robot.model import RobotModel
from cobot.types import Array

SEED = 20261121
TOLERANCE = 1e-9
STRETCHED = np.zeros(7)


def configurations(robot: RobotDescription, count: int = 200) -> Array:
    random = np.random.default_rng(SEED)
    limits = robot.limits
    drawn = random.uniform(limits.min_position, limits.max_position, (count, limits.dof))
    return np.vstack([STRETCHED, limits.min_position, limits.max_position, drawn])


def test_forward_kinematics_are_those_of_pinocchio(robot: RobotDescription) -> None:
    for joints in configurations(robot):
        position, turn = second_robot().forward(joints)
        pose = robot.model.forward(joints)
        assert pose.position == pytest.approx(position, abs=TOLERANCE), joints
        assert pose.rotation == pytest.approx(turn, abs=TOLERANCE), joints


def test_the_jacobian_is_that_of_pinocchio(robot: RobotDescription) -> None:
    for joints in configurations(robot):
        expected = second_robot().jacobian(joints)
        assert robot.model.jacobian(joints) == pytest.approx(expected, abs=TOLERANCE), joints


def test_gravity_torques_are_those_of_pinocchio(robot: RobotDescription) -> None:
    for joints in configurations(robot):
        expected = second_robot().gravity(joints)
        assert np.abs(expected).max() > 1e-3 or np.array_equal(joints, STRETCHED)
        assert robot.model.gravity_torques(joints) == pytest.approx(expected, abs=TOLERANCE), joints


def test_the_mass_matrix_is_that_of_pinocchio_with_the_drives_inertia(robot: RobotDescription) -> None:
    for joints in configurations(robot):
        expected = second_robot().mass_matrix(joints)
        assert robot.model.mass_matrix(joints) == pytest.approx(expected, abs=TOLERANCE), joints


def test_position_rotation_and_jacobian_for_solvers_are_the_same_numbers(robot: RobotDescription) -> None:
    for joints in configurations(robot, 20):
        position, turn, jacobian = robot.model.forward_and_jacobian(joints)
        expected_position, expected_turn = second_robot().forward(joints)
        assert position == pytest.approx(expected_position, abs=TOLERANCE)
        assert turn == pytest.approx(expected_turn, abs=TOLERANCE)
        assert jacobian == pytest.approx(second_robot().jacobian(joints), abs=TOLERANCE)


def test_a_jacobian_that_was_handed_out_is_not_changed_by_the_next_call(robot: RobotDescription) -> None:
    first, second = configurations(robot, 2)[-2:]
    jacobian = robot.model.jacobian(first)
    robot.model.jacobian(second)
    assert jacobian == pytest.approx(second_robot().jacobian(first), abs=TOLERANCE)


def test_what_one_quantity_computed_before_does_not_change_another(robot: RobotDescription) -> None:
    first, second = configurations(robot, 2)[-2:]
    robot.model.mass_matrix(first)
    robot.model.forward(first)
    assert robot.model.gravity_torques(second) == pytest.approx(second_robot().gravity(second), abs=TOLERANCE)
    robot.model.gravity_torques(first)
    robot.model.forward(second)
    assert robot.model.mass_matrix(second) == pytest.approx(second_robot().mass_matrix(second), abs=TOLERANCE)


def test_stretched_upwards_the_flange_is_at_the_sum_of_the_data_sheets_axis_distances(
    robot: RobotDescription,
) -> None:
    pose = robot.model.forward(STRETCHED)
    assert pose.position == pytest.approx([0.0, 0.0, 0.360 + 0.420 + 0.400 + 0.126], abs=TOLERANCE)


def test_at_home_the_tool_points_down_in_front_of_the_base(robot: RobotDescription) -> None:
    pose = robot.model.forward(np.array(robot.positions["home"].joints))
    # The elbow stands at 0.36 + 0.42 m; 0.4 m out to the wrist, 0.126 m down to the flange.
    assert pose.position == pytest.approx([0.400, 0.0, 0.780 - 0.126], abs=1e-3)
    assert pose.rotation[:, 2] == pytest.approx([0.0, 0.0, -1.0], abs=2e-3)


def test_the_simulations_stops_stand_just_beyond_the_position_limits() -> None:
    limits = load_joint_limits(LIMITS)
    ranges = {joint.get("name"): numbers(joint, "range", "") for joint in mjcf_root().iter("joint")}
    for name, low, high in zip(limits.names, limits.min_position, limits.max_position, strict=True):
        assert ranges[name] == pytest.approx([low - 0.02, high + 0.02]), name


def test_the_drives_torques_are_the_effort_limits() -> None:
    limits = load_joint_limits(LIMITS)
    motors = {motor.get("joint"): numbers(motor, "ctrlrange", "") for motor in mjcf_root().iter("motor")}
    motors.pop(None)
    assert {name: [-limit, limit] for name, limit in zip(limits.names, limits.max_effort, strict=True)} == (
        motors
    )


def test_joint_limits_are_the_numbers_of_the_file_in_its_order(robot: RobotDescription) -> None:
    entries = yaml.safe_load(LIMITS.read_text(encoding="utf-8"))["joint_limits"]
    assert robot.limits.names == tuple(entries)
    for key in ("min_position", "max_position", "max_velocity", "max_acceleration", "max_jerk", "max_effort"):
        assert getattr(robot.limits, key).tolist() == [entry[key] for entry in entries.values()], key


def test_the_drives_can_hold_the_arm_anywhere(robot: RobotDescription) -> None:
    for joints in configurations(robot):
        assert (np.abs(second_robot().gravity(joints)) < 0.5 * robot.limits.max_effort).all()


def test_a_urdf_gives_the_same_robot(robot: RobotDescription, tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(urdf(), encoding="utf-8")
    model = RobotModel.load(file, robot.limits)
    for joints in configurations(robot, 20):
        position, turn = second_robot().forward(joints)
        pose = model.forward(joints)
        assert pose.position == pytest.approx(position, abs=TOLERANCE)
        assert pose.rotation == pytest.approx(turn, abs=TOLERANCE)
        assert model.gravity_torques(joints) == pytest.approx(second_robot().gravity(joints), abs=TOLERANCE)


def test_a_urdf_whose_masses_are_not_known_is_refused_with_the_way_out(
    robot: RobotDescription, tmp_path: Path
) -> None:
    """MuJoCo would give each such link 1000 kg/m³ of its shapes. The base does not move, so it needs none."""
    file = tmp_path / "arm.urdf"
    root = ET.fromstring(urdf())
    links = {str(each.get("name")): each for each in root.iter("link")}
    for name in ("base_link", "link2", "link5"):
        if (inertial := links[name].find("inertial")) is not None:
            links[name].remove(inertial)
        shape = ET.SubElement(ET.SubElement(links[name], "collision"), "geometry")
        ET.SubElement(shape, "sphere", radius="0.05")
    file.write_bytes(ET.tostring(root))
    with pytest.raises(ConfigError, match=r"no <inertial> in link2, link5: .* `cobot new-robot arm\.urdf`"):
        RobotModel.load(file, robot.limits)


@pytest.mark.parametrize("name", ["a\u202eb", "x" * 100_000, "a&#10;b", " a"])
@pytest.mark.parametrize("kind", ["body", "site"])
def test_a_name_that_cannot_be_printed_is_refused_in_few_words(
    robot: RobotDescription, tmp_path: Path, name: str, kind: str
) -> None:
    text = ET.tostring(mjcf_root(), "unicode")
    added = f'<{kind} name="{name}"/></worldbody>'
    file = tmp_path / "odd.xml"
    file.write_text(text.replace("</worldbody>", added), encoding="utf-8")
    with pytest.raises(ConfigError, match=f"a {kind} has the name .*; give it a printable name") as caught:
        RobotModel.load(file, robot.limits)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1_000


def test_poses_are_in_the_base_frame_wherever_the_base_stands(
    robot: RobotDescription, tmp_path: Path
) -> None:
    root = mjcf_root()
    base = root.find("worldbody/body")
    assert base is not None
    base.set("pos", "1.5 -0.5 0.25")
    base.set("quat", "0.5 0.1 -0.7 0.3")
    file = tmp_path / "elsewhere.xml"
    file.write_bytes(ET.tostring(root))
    model = RobotModel.load(file, robot.limits)
    for joints in configurations(robot, 20):
        pose = model.forward(joints)
        position, turn = second_robot().forward(joints)
        assert pose.position == pytest.approx(position, abs=TOLERANCE)
        assert pose.rotation == pytest.approx(turn, abs=TOLERANCE)
        assert model.jacobian(joints) == pytest.approx(second_robot().jacobian(joints), abs=TOLERANCE)
        solver = model.forward_and_jacobian(joints)
        assert solver[0] == pytest.approx(position, abs=TOLERANCE)
        assert solver[1] == pytest.approx(turn, abs=TOLERANCE)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"tcp": "gripper"}, "robot.tcp: the model has no site or body 'gripper'; its sites: tcp"),
        ({"base": "table"}, "robot.base_frame: the model has no 'table'"),
        ({"base": "link3"}, "robot.base_frame: 'link3' must not move with the joints"),
    ],
)
def test_a_frame_that_cannot_be_one_is_refused_by_name(
    robot: RobotDescription, names: dict[str, str], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        RobotModel.load(MJCF, robot.limits, **names)


def test_a_missing_model_is_an_error_that_names_the_file(robot: RobotDescription, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"arm\.xml: no such file"):
        RobotModel.load(tmp_path / "arm.xml", robot.limits)


@pytest.mark.parametrize("content", ["", "no xml", "<mujoco><nothing/></mujoco>", "<html/>"])
def test_a_file_that_is_no_robot_is_an_error_that_names_the_file(
    robot: RobotDescription, tmp_path: Path, content: str
) -> None:
    file = tmp_path / "broken.xml"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"broken\.xml: "):
        RobotModel.load(file, robot.limits)


def test_a_model_for_which_no_memory_is_left_is_no_wrong_model(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: str) -> None:
        raise ValueError("Error: engine error: Could not allocate memory")

    monkeypatch.setattr(mujoco.MjSpec, "from_file", full)
    with pytest.raises(UnavailableError, match=r"raise the memory limit \(ulimit -v\)"):
        RobotModel.load(MJCF, load_joint_limits(LIMITS))


def test_a_model_with_other_joints_than_the_limits_is_refused_with_both_lists(
    robot: RobotDescription, tmp_path: Path
) -> None:
    file = tmp_path / "renamed.xml"
    file.write_text(MJCF.read_text(encoding="utf-8").replace('"joint4"', '"elbow"'), encoding="utf-8")
    with pytest.raises(
        ConfigError, match=r"joint3, elbow, joint5.* the limits have .*joint3, joint4, joint5"
    ):
        RobotModel.load(file, robot.limits)
