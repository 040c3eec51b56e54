"""Named positions. Oracle: the shipped SRDF as plain XML."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from independent_models import SRDF

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import load_robot
from cobot.robot.srdf import disabled_pairs, load_named_positions

JOINTS = tuple(f"joint{number}" for number in range(1, 8))
GROUP = "iiwa_arm"


def changed(folder: Path, old: str, new: str, count: int = 1) -> Path:
    """The shipped file with the first `old` replaced."""
    text = SRDF.read_text(encoding="utf-8")
    assert old in text
    file = folder / "arm.srdf"
    file.write_text(text.replace(old, new, count), encoding="utf-8")
    return file


def test_the_positions_are_those_of_the_file_in_its_order() -> None:
    positions = load_named_positions(SRDF, JOINTS, GROUP)
    states = ET.parse(SRDF).getroot().findall("group_state")
    assert list(positions) == [state.get("name") for state in states] == ["home", "work", "transport"]
    for state in states:
        position = positions[str(state.get("name"))]
        expected = {joint.get("name"): float(joint.get("value", "nan")) for joint in state.iter("joint")}
        assert dict(zip(JOINTS, position.joints, strict=True)) == expected
        assert position.description == state.get("description")
        assert position.group == GROUP


def test_angles_come_in_the_order_of_the_limits_and_not_of_the_file() -> None:
    backwards = tuple(reversed(JOINTS))
    ordered = load_named_positions(SRDF, JOINTS, GROUP)["work"].joints
    assert load_named_positions(SRDF, backwards, GROUP)["work"].joints == ordered[::-1]


def test_states_of_other_groups_are_left_out(tmp_path: Path) -> None:
    group = '<group name="gripper"/>'
    state = '<group_state name="open" group="gripper"><joint name="finger" value="1"/></group_state>'
    file = changed(tmp_path, "</robot>", f"{group}{state}</robot>")
    assert list(load_named_positions(file, JOINTS, GROUP)) == ["home", "work", "transport"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '<joint name="joint4" value="-1.57"/>',
            '<joint name="elbow" value="-1.57"/>',
            "position 'home': joint 'elbow' is unknown; valid names: joint1, joint2,",
        ),
        ('<joint name="joint4" value="-1.57"/>', "", "position 'home': joint4 missing"),
        (
            '<joint name="joint4" value="-1.57"/>',
            '<joint name="joint1" value="-1.57"/>',
            "position 'home': joint 'joint1' occurs twice",
        ),
        ('"-1.57"', '"bent"', "position 'home': joint4 is not a number: 'bent'"),
        ('"-1.57"', '""', "position 'home': joint4 is not a number: ''"),
        ('"-1.57"', '"nan"', "position 'home': joint4 is not finite"),
        ('"-1.57"', '"-inf"', "position 'home': joint4 is not finite"),
        ('name="work"', 'name="home"', "the position 'home' occurs twice"),
        ('name="work"', 'name=""', "a group_state has no name"),
        ('name="work"', 'name="a&#10;b"', r"a group_state has the name 'a\nb'; give it a printable one"),
        ('name="work"', f'name="{"n" * 100_000}"', "n'...; give it a printable one"),
        ('<robot name="iiwa14">', "<robot", "not a readable SRDF"),
        (
            '<robot name="iiwa14">',
            '<!DOCTYPE robot [<!ENTITY a "b">]><robot>',
            "must not have a DOCTYPE",
        ),
        ('<group name="iiwa_arm">', '<group name="other">', "has no group 'iiwa_arm'; valid names: other"),
    ],
)
def test_a_wrong_file_is_refused_with_place_and_reason(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    file = changed(tmp_path, old, new)
    with pytest.raises(ConfigError, match=rf"arm\.srdf: .*{re.escape(message)}"):
        load_named_positions(file, JOINTS, GROUP)


def test_a_group_without_positions_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "empty.srdf"
    file.write_text('<robot><group name="iiwa_arm"/></robot>', encoding="utf-8")
    with pytest.raises(ConfigError, match="has no group_state of group 'iiwa_arm'"):
        load_named_positions(file, JOINTS, GROUP)


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.srdf: no such file"):
        load_named_positions(tmp_path / "nowhere.srdf", JOINTS, GROUP)


def test_pairs_whose_collisions_are_disabled_are_not_looked_at(tmp_path: Path) -> None:
    file = tmp_path / "arm.srdf"
    file.write_text(
        '<robot name="a"><disable_collisions link1="link2" link2="link4" reason="Never"/></robot>'
    )
    assert disabled_pairs(file) == {frozenset(("link2", "link4"))}
    robot = load_robot(load_settings(None))
    names = {frozenset(robot.collision.names(index)) for index in range(len(robot.collision.pairs))}
    checker = CollisionChecker(robot.model, 0.0, disabled_pairs(file))
    left = {frozenset(checker.names(index)) for index in range(len(checker.pairs))}
    assert names - left == {frozenset(("link2", "link4"))}
    file.write_text('<robot name="a"><disable_collisions link1="link2"/></robot>')
    with pytest.raises(ConfigError, match="needs link1 and link2"):
        disabled_pairs(file)
