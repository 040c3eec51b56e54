"""What `cobot new-robot --srdf` takes over. Oracle: SRDF files written by hand for arms of known links."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest
from urdf_arms import ARMS, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.cli import main
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import RobotDescription, load_robot

NAMES = tuple(f"a{index}" for index in range(6))
FINGER = (
    '<link name="thumb"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" '
    'ixz="0" iyz="0"/></inertial></link><joint name="pinch" type="prismatic"><parent link="tool0"/>'
    '<child link="thumb"/><axis xyz="0 1 0"/>'
    '<limit lower="0" upper="0.04" velocity="0.2" effort="20"/></joint>'
)
CHAIN = '<group name="manipulator"><chain base_link="base_link" tip_link="link5"/></group>'


def state(name: str, group: str, *values: float) -> str:
    joints = "".join(f'<joint name="a{index}" value="{value}"/>' for index, value in enumerate(values))
    return f'<group_state name="{name}" group="{group}">{joints}</group_state>'


READY = state("Ready", "manipulator", 0.1, 0.4, -0.3, 0.7, 0.4, 0.5)


def made(tmp_path: Path, srdf: str, **options: object) -> tuple[RobotDescription, list[str]]:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"], FINGER))
    (tmp_path / "arm.srdf").write_text(f'<robot name="arm">{srdf}</robot>')
    new = NewRobot(tmp_path / "arm.urdf", srdf=tmp_path / "arm.srdf", **options)  # type: ignore[arg-type]
    new.write(tmp_path / "made")
    return load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml")), new.guessed


JOINTS = "".join(f'<joint name="{name}"/>' for name in NAMES)
HALVES = (
    '<group name="manipulator"><group name="half"/><joint name="a4"/><link name="link5"/></group>'
    '<group name="half"><joint name="a0"/><joint name="a1"/><link name="link2"/><link name="link3"/></group>'
)


@pytest.mark.parametrize("group", [CHAIN, f'<group name="manipulator">{JOINTS}</group>', HALVES])
def test_a_group_of_a_chain_joints_links_or_groups_gives_the_joints(tmp_path: Path, group: str) -> None:
    robot, _ = made(tmp_path, group + READY, group="manipulator")
    assert robot.limits.names == NAMES
    settings = load_settings(tmp_path / "made" / "cobot-setting.yaml")
    assert (settings.robot.group, settings.robot.start_position) == ("manipulator", "Ready")
    assert robot.positions["Ready"].joints == (0.1, 0.4, -0.3, 0.7, 0.4, 0.5)
    assert list(robot.positions) == ["Ready"]


def test_the_chain_gives_base_and_tcp(tmp_path: Path) -> None:
    made(tmp_path, CHAIN)
    settings = load_settings(tmp_path / "made" / "cobot-setting.yaml")
    assert (settings.robot.base_frame, settings.robot.tcp) == ("base_link", "link5")


def test_the_end_effector_gives_the_tcp_and_the_option_has_priority(tmp_path: Path) -> None:
    text = f'<group name="arm">{JOINTS}</group><group name="hand"><joint name="pinch"/></group>'
    text += '<end_effector name="hand" group="hand" parent_group="arm" parent_link="link5"/>'
    made(tmp_path, text)
    assert load_settings(tmp_path / "made" / "cobot-setting.yaml").robot.tcp == "link5"
    (tmp_path / "made").rename(tmp_path / "first")
    made(tmp_path, text, tcp="tool0")
    assert load_settings(tmp_path / "made" / "cobot-setting.yaml").robot.tcp == "tool0"


def test_of_several_groups_the_one_with_the_arms_joints_is_taken(tmp_path: Path) -> None:
    text = CHAIN + '<group name="hand"><joint name="pinch"/></group>'
    text += '<group name="all"><group name="manipulator"/><group name="hand"/></group>'
    robot, _ = made(tmp_path, text)
    assert robot.limits.names == NAMES
    assert load_settings(tmp_path / "made" / "cobot-setting.yaml").robot.group == "manipulator"


def test_groups_that_are_not_the_arm_are_to_be_chosen_from(tmp_path: Path) -> None:
    text = '<group name="one"><joint name="a0"/></group><group name="two"><joint name="a1"/></group>'
    with pytest.raises(ConfigError, match=r"arm\.srdf: choose one .* --group NAME: one \(a0\); two \(a1\)"):
        made(tmp_path, text)
    robot, _ = made(tmp_path, text, group="two", tcp="link1")
    assert robot.limits.names == ("a1",)


@pytest.mark.parametrize(
    ("text", "options", "reason"),
    [
        (CHAIN, {"group": "hand"}, "group 'hand' is not in the file; valid names: manipulator"),
        (
            '<group name="arm"><joint name="a9"/></group>',
            {"group": "arm"},
            r"group 'arm' has no joint that moves; valid names: arm \(no joint\)",
        ),
        (
            '<group name="arm"><chain base_link="link4" tip_link="link1"/></group>',
            {},
            r"arm\.srdf:1: the link 'link1' is not on a chain from 'link4'",
        ),
        (CHAIN + READY.replace("0.4", "nan", 1), {}, r"arm\.srdf:1: state 'Ready': the value of a1 is 'nan'"),
    ],
)
def test_what_cannot_be_taken_over_is_rejected(
    tmp_path: Path, text: str, options: dict[str, str], reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        made(tmp_path, text, **options)
    assert not (tmp_path / "made").exists()


def test_a_group_without_an_srdf_and_a_file_that_is_none_are_rejected(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]))
    with pytest.raises(ConfigError, match="also give the SRDF, with --srdf FILE"):
        NewRobot(tmp_path / "arm.urdf", group="arm").write(tmp_path / "made")
    with pytest.raises(ConfigError, match=r"none\.srdf: does not exist"):
        NewRobot(tmp_path / "arm.urdf", srdf=tmp_path / "none.srdf").write(tmp_path / "made")


def test_names_that_the_robot_does_not_have_are_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]))
    text = CHAIN.replace("</group>", '<joint name="rail"/></group>')
    text += READY.replace("</group_state>", '<joint name="rail" value="0"/></group_state>')
    text += '<disable_collisions link1="link0" link2="hood"/>'
    (tmp_path / "arm.srdf").write_text(f"<robot>{text}</robot>")
    options = ["--srdf", str(tmp_path / "arm.srdf"), "--output", str(tmp_path / "made")]
    assert main(["new-robot", str(tmp_path / "arm.urdf"), *options]) == 0
    said = capsys.readouterr().out
    assert "arm.srdf: joints that the robot does not have, left out: rail" in said
    assert "arm.srdf: links that the robot does not have, left out: hood" in said


@pytest.mark.parametrize(
    ("element", "what"),
    [
        ('<passive_joint name="ghost"/>', "joints"),
        ('<virtual_joint name="world" type="fixed" parent_frame="map" child_link="ghost"/>', "links"),
        ('<disable_default_collisions link="ghost"/>', "links"),
        ('<enable_collisions link1="link0" link2="ghost"/>', "links"),
        (
            '<end_effector name="hand" group="ghost" parent_group="manipulator" parent_link="link5"/>',
            "groups",
        ),
        ('<end_effector name="hand" group="hand" parent_group="ghost" parent_link="link5"/>', "groups"),
        (state("Packed", "ghost", 0.0), "groups"),
        ('<group name="other"><chain base_link="base_link" tip_link="ghost"/></group>', "links"),
    ],
)
def test_each_element_that_names_something_unknown_is_reported_once(
    tmp_path: Path, element: str, what: str
) -> None:
    _, said = made(tmp_path, CHAIN + '<group name="hand"><joint name="pinch"/></group>' + element)
    told = [each for each in said if "the robot does not have" in each]
    assert told == [f"arm.srdf: {what} that the robot does not have, left out: ghost"]


def test_a_virtual_joint_is_a_name_that_groups_and_states_may_use(tmp_path: Path) -> None:
    text = CHAIN.replace("</group>", '<joint name="world"/></group>') + '<passive_joint name="world"/>'
    text += '<virtual_joint name="world" type="planar" parent_frame="map" child_link="base_link"/>'
    robot, said = made(tmp_path, text)
    assert robot.limits.names == NAMES
    assert not [each for each in said if "does not have" in each]


def test_pairs_that_may_touch_are_those_of_the_srdf_in_checks_and_in_the_simulation(tmp_path: Path) -> None:
    text = '<disable_collisions link1="link0" link2="link2"/><disable_default_collisions link="link5"/>'
    robot, said = made(tmp_path, f'{CHAIN}{text}<enable_collisions link1="link5" link2="link0"/>')
    assert frozenset(("link0", "link2")) in robot.collision.disabled
    assert frozenset(("link5", "link1")) in robot.collision.disabled
    assert frozenset(("link5", "link0")) not in robot.collision.disabled
    mj = robot.model.mj
    pairs = {
        frozenset((mj.body(int(each) >> 16).name, mj.body(int(each) & 0xFFFF).name))
        for each in mj.exclude_signature
    }
    assert frozenset(("link0", "link2")) in pairs
    assert frozenset(("link5", "link0")) not in pairs
    assert (
        "arm.srdf: group manipulator, base_frame base_link, tcp link5; 8 pairs of links that may touch"
        in said
    )
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)


def test_an_srdf_may_have_pairs_alone(tmp_path: Path) -> None:
    """As the way out says that is printed for links that touch."""
    robot, _ = made(tmp_path, '<disable_collisions link1="link0" link2="link2" reason="Default"/>')
    assert frozenset(("link0", "link2")) in robot.collision.disabled
    assert robot.limits.names == NAMES


def test_states_that_cannot_be_are_left_out_with_the_reason(tmp_path: Path) -> None:
    beyond = state("home", "manipulator", 0.0, 3.0, 0.0, 0.0, 0.0, 0.0)
    short = state("short", "manipulator", 0.0, 0.0)
    of_others = state("open", "hand", 0.0).replace("a0", "pinch")
    robot, said = made(tmp_path, CHAIN + beyond + short + of_others + READY)
    assert list(robot.positions) == ["Ready"]
    assert any(
        each.startswith("state 'home' of the file is left out: joint angle of a1 is 3 rad") for each in said
    )
    assert "state 'short' is left out: it has no a2, a3, a4, a5" in said
    assert not [each for each in said if "open" in each]
