"""Telescopes of new robots: slides that follow one another become one joint.

Oracles: pinocchio's kinematics and dynamics of the given URDF, with each stage where its <mimic> puts it; for
MJCF MuJoCo's kinematics of the given file; and the numbers in the files.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from urdf_arms import ARMS, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import RobotDescription, load_robot

STAGE = (
    '<link name="{name}"><inertial><origin xyz="0 0.1 0.2"/><mass value="3"/><inertia ixx="0.1" iyy="0.1" '
    'izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><box size="0.2 0.2 0.4"/></geometry>'
    '</collision></link><joint name="{name}_joint" type="{kind}"><parent link="{parent}"/>'
    '<child link="{name}"/><origin xyz="0 0 0.05" rpy="{rpy}"/><axis xyz="{axis}"/>'
    '<limit lower="{low}" upper="{high}" velocity="{velocity}" effort="{effort}"/>{mimic}</joint>'
)
FIRST = {"name": "lower", "kind": "prismatic", "parent": "world", "rpy": "0.2 0 0", "axis": "0 0 1",
         "low": 0.1, "high": 0.5, "velocity": 0.2, "effort": 3000, "mimic": ""}  # fmt: skip
SECOND = FIRST | {"name": "upper", "parent": "lower", "rpy": "0 0 0.7", "low": 0.0, "high": 0.8,
                  "velocity": 0.3,
                  "mimic": '<mimic joint="lower_joint" multiplier="2" offset="0.02"/>'}  # fmt: skip
THIRD = FIRST | {"name": "top", "parent": "upper", "rpy": "3.141592653589793 0 0", "low": -1.0,
                 "high": 1.0, "velocity": 1.0,
                 "mimic": '<mimic joint="upper_joint" multiplier="-0.5"/>'}  # fmt: skip
"""Upside down, so it also goes up. In all the last stage travels 1 + 2 + 1 times as far as the first."""
TRAVEL = 4.0
NAMES = ("lower_joint", *(f"a{index}" for index in range(6)))


def lift(*stages: dict[str, object]) -> str:
    """An arm on a telescope."""
    arm = urdf(ARMS["ur"]).removeprefix('<robot name="arm">').removesuffix("</robot>")
    top = stages[-1]["name"]
    base = f'<joint name="mount" type="fixed"><parent link="{top}"/><child link="base_link"/></joint>'
    columns = "".join(STAGE.format(**stage) for stage in stages)
    return f'<robot name="lift"><link name="world"/>{columns}{arm}{base}</robot>'


def made_of(file: Path, text: str, **options: object) -> tuple[RobotDescription, str]:
    """The robot, and what was said of it."""
    file.write_text(text, encoding="utf-8")
    new = NewRobot(file, **options)  # type: ignore[arg-type]
    new.write(file.with_suffix(""))
    return load_robot(load_settings(file.with_suffix("") / "cobot-setting.yaml")), "\n".join(new.guessed)


@pytest.mark.parametrize("options", [{}, {"actuators": NAMES}], ids=["found", "named"])
def test_stages_that_follow_the_first_are_one_joint_with_all_their_travel(
    options: dict[str, object], tmp_path: Path
) -> None:
    text = lift(FIRST, SECOND, THIRD)
    robot, said = made_of(tmp_path / "lift.urdf", text, **options)
    assert robot.limits.names == NAMES
    assert "telescope found: lower_joint also moves upper_joint, top_joint" in said
    assert "joints that stay" not in said
    model = pinocchio.buildModelFromXML(text)
    data, base = model.createData(), model.getFrameId(robot.base_frame)
    drawn = np.random.default_rng(1).uniform(-1.0, 1.0, (8, 6))
    for first, joints in zip(np.linspace(0.1, 0.39, 8), drawn, strict=True):
        second = 2.0 * first + 0.02
        place = np.array([first, second, -0.5 * second, *joints])
        pinocchio.framesForwardKinematics(model, data, place)
        there = data.oMf[base].actInv(data.oMf[model.getFrameId("tool0")])
        merged = np.array([TRAVEL * first, *joints])
        np.testing.assert_allclose(robot.model.forward(merged).position, there.translation, atol=1e-9)
        torques = pinocchio.rnea(model, data, place, np.zeros(9), np.zeros(9))
        np.testing.assert_allclose(robot.model.gravity_torques(merged)[1:], torques[3:], atol=1e-7)
        carried = (torques[0] + 2.0 * torques[1] - torques[2]) / TRAVEL
        assert robot.model.gravity_torques(merged)[0] >= carried > 0.0


def test_its_limits_are_those_that_all_stages_have(tmp_path: Path) -> None:
    limits = made_of(tmp_path / "lift.urdf", lift(FIRST, SECOND, THIRD))[0].limits
    assert limits.min_position[0] == pytest.approx(TRAVEL * 0.1)
    assert limits.max_position[0] == pytest.approx(TRAVEL * 0.39)  # upper is at 0.8 there
    assert limits.max_velocity[0] == pytest.approx(TRAVEL * 0.15)  # upper moves 0.3 m/s then
    assert limits.max_effort[0] == pytest.approx(3000 / TRAVEL)


def test_a_state_of_an_srdf_gives_the_position_of_the_first_stage(tmp_path: Path) -> None:
    values = "".join(f'<joint name="{name}" value="0.2"/>' for name in NAMES)
    (tmp_path / "lift.srdf").write_text(
        '<robot name="lift"><group name="all"><chain base_link="world" tip_link="tool0"/></group>'
        f'<group_state name="home" group="all">{values}</group_state></robot>'
    )
    robot, _ = made_of(tmp_path / "lift.urdf", lift(FIRST, SECOND), srdf=tmp_path / "lift.srdf")
    np.testing.assert_allclose(robot.positions["home"].joints, [0.6, *(6 * [0.2])])


def test_a_telescope_of_mjcf_with_one_actuator_on_a_tendon_is_one_joint(tmp_path: Path) -> None:
    slides = [
        f'<body name="s{index}" pos="0 0.01 0"><joint name="j{index}" type="slide" axis="0 1 0" '
        'range="0 0.13" damping="0.2" frictionloss="0.2"/><geom type="box" size="0.02 0.1 0.02" mass="0.3"/>'
        for index in range(4)
    ]
    followers = "".join(f'<joint joint1="j{i + 1}" joint2="j{i}"/>' for i in range(3))
    pulled = "".join(f'<joint joint="j{i}" coef="1"/>' for i in range(4))
    text = (
        '<mujoco><worldbody><body name="mast"><joint name="mast" type="slide" axis="0 0 1" range="0 1"/>'
        f'<geom type="box" size="0.1 0.05 0.1" mass="1" pos="0 -0.3 0"/>{"".join(slides)}<site name="tcp"/>'
        f"{'</body>' * 5}</worldbody><equality>{followers}</equality>"
        f'<tendon><fixed name="all">{pulled}</fixed></tendon><actuator>'
        '<motor joint="mast" ctrlrange="-90 90"/><position tendon="all"/></actuator>'
        '<keyframe><key name="home" qpos="0.5 0.1 0.1 0.1 0.1"/></keyframe></mujoco>'
    )
    robot, _ = made_of(tmp_path / "mast.xml", text)
    assert robot.limits.names == ("mast", "j0")
    assert robot.limits.max_position[1] == pytest.approx(0.52)
    np.testing.assert_allclose(robot.positions["home"].joints, [0.5, 0.4])
    given = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(given)
    data.qpos[:] = [0.5, 0.1, 0.1, 0.1, 0.1]
    mujoco.mj_kinematics(given, data)
    pose = robot.model.forward(np.array(robot.positions["home"].joints))
    assert robot.base_frame == "world"
    np.testing.assert_allclose(pose.position, data.site("tcp").xpos, atol=1e-9)
    assert robot.model.mj.dof_frictionloss[1] == pytest.approx(0.2)
    assert robot.model.mj.dof_damping[1] == pytest.approx(0.05)


NO_TELESCOPES = {
    "a stage that goes back": SECOND | {"mimic": '<mimic joint="lower_joint" multiplier="-1"/>'},
    "another axis": SECOND | {"axis": "0 1 0"},
    "a joint that turns": SECOND | {"kind": "revolute"},
}


@pytest.mark.parametrize("kind", sorted(NO_TELESCOPES))
def test_other_joints_that_follow_are_refused_with_their_line_and_the_way_out(
    kind: str, tmp_path: Path
) -> None:
    file = tmp_path / "lift.urdf"
    text = lift(FIRST, NO_TELESCOPES[kind]).replace("<mimic", "\n<mimic")
    said = r"lift.urdf:2: .*'upper_joint' follows 'lower_joint' \(mimic\).*: --without upper_joint$"
    with pytest.raises(ConfigError, match=said):
        made_of(file, text)
    robot, told = made_of(file, text, without=["upper_joint"])
    assert robot.limits.names == NAMES
    assert "joints that stay where they are: upper_joint at 0" in told
