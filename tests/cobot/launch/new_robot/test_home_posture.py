"""The posture in which a new robot starts. Oracle: what people have as the upright or bent posture of arms of
these kinds, and the keyframes written into the files.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from swinging_arm import swinging_arm
from urdf_arms import ARMS, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.new_robot import home_posture
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.collision import CollisionChecker, Contact
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array

HALF = np.pi / 2.0
ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="stand"><geom size="0.02"/>
<body name="one" pos="0 0 .2"><joint name="j" range="-1.5 1.5"/><geom size=".03" pos=".1 0 0"/>
<body name="two" pos=".3 0 0"><joint name="k" axis="0 1 0" range="-1.5 1.5"/><geom size=".03"/>
<site name="tcp" pos=".2 0 0"/></body></body></body></worldbody>{}</mujoco>"""


def made(file: Path, text: str) -> tuple[RobotDescription, list[str]]:
    file.write_text(text)
    new = NewRobot(file)
    new.write(file.parent / "made")
    return load_robot(load_settings(file.parent / "made" / "cobot-setting.yaml")), new.guessed


@pytest.mark.parametrize("kind", sorted(ARMS))
def test_an_arm_that_stands_upright_at_0_starts_there(tmp_path: Path, kind: str) -> None:
    robot, _ = made(tmp_path / "arm.urdf", urdf(ARMS[kind]))
    assert robot.positions["home"].joints == (0.0,) * robot.limits.dof


def test_an_arm_that_lies_level_at_0_starts_upright_with_one_joint_turned(tmp_path: Path) -> None:
    """The shoulder's frame is turned by a right angle, as in the files of many makers."""
    text = swinging_arm().replace('<origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>',
                                  f'<origin xyz="0 0 0.2" rpy="0 {HALF} 0"/><axis xyz="0 1 0"/>')  # fmt: skip
    assert f'rpy="0 {HALF} 0"' in text
    robot, said = made(tmp_path / "arm.urdf", text)
    assert robot.positions["home"].joints == pytest.approx((0.0, -HALF, 0.0))
    np.testing.assert_allclose(robot.model.forward(np.array([0.0, -HALF, 0.0])).position[:2], 0.0, atol=1e-9)
    (sentence,) = [each for each in said if each.startswith("home: ")]
    assert "joints at multiples of 45°" in sentence


def test_a_joint_whose_range_excludes_0_is_at_a_simple_angle_within(tmp_path: Path) -> None:
    before, name, rest = swinging_arm().partition('<joint name="elbow"')
    text = before + name + rest.replace('lower="-2.5" upper="2.5"', 'lower="-3.0" upper="-0.07"', 1)
    robot, _ = made(tmp_path / "arm.urdf", text)
    *others, elbow = robot.positions["home"].joints
    assert elbow == pytest.approx(-np.pi / 4.0)
    assert set(np.round(np.array(others) / (np.pi / 4.0), 9) % 1.0) == {0.0}


def test_an_arm_that_touches_itself_at_0_turns_few_joints_by_simple_angles(tmp_path: Path) -> None:
    """A long forearm that at 0 lies within the upper arm."""
    text = urdf(ARMS["spherical"]).replace('<origin xyz="0 0 0.3"', '<origin xyz="0 0 -0.5"')
    robot, _ = made(tmp_path / "arm.urdf", text)
    home = np.array(robot.positions["home"].joints)
    assert not robot.collision.contacts(home)
    steps = home / (np.pi / 4.0)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert 1 <= np.count_nonzero(np.abs(home) > 1e-9) <= 3


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ('<keyframe><key name="home" qpos="0.5 -0.7"/><key name="b" qpos="1 1"/></keyframe>', (0.5, -0.7)),
        ('<keyframe><key name="b" qpos="0.2 0.3"/></keyframe>', (0.2, 0.3)),
        ('<keyframe><key name="a" qpos="1 1"/><key name="b" qpos="0.2 0.3"/></keyframe>', None),
        ('<keyframe><key name="home" qpos="0.5 -1.7"/></keyframe>', None),
    ],
)
def test_the_keyframe_of_the_file_is_home_if_the_arm_can_be_there(
    tmp_path: Path, keys: str, wanted: tuple[float, float] | None
) -> None:
    robot, said = made(tmp_path / "arm.xml", ARM.format(keys))
    home = robot.positions["home"].joints
    if wanted is not None:
        assert home == pytest.approx(wanted)
        assert any(each.startswith("home: ") and each.endswith("as in the file") for each in said)
    else:
        assert set(np.round(np.array(home) / (np.pi / 4.0), 9) % 1.0) == {0.0}
    assert ("-1.7" in keys) == any(
        "state 'home' of the file is left out: joint angle" in each for each in said
    )


def test_home_can_be_held_where_most_postures_cannot(tmp_path: Path) -> None:
    robot, _ = made(tmp_path / "arm.urdf", swinging_arm((50.0, 5.0, 5.0)))
    home = np.array(robot.positions["home"].joints)
    assert (np.abs(robot.model.gravity_torques(home)) <= 0.9 * robot.limits.max_effort).all()


def test_the_same_file_gives_the_same_home(tmp_path: Path) -> None:
    homes = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        robot, _ = made(tmp_path / name / "arm.urdf", urdf(ARMS["spherical"]))
        homes.append(robot.positions["home"].joints)
    assert all(first == second for first, second in pairwise(homes))


def test_of_an_arm_without_a_simple_free_posture_the_pair_is_named_that_touches_most(tmp_path: Path) -> None:
    """A cover that overlaps the base except for angles of the first joint between 0.1 and 0.7 rad."""
    robot, _ = made(tmp_path / "arm.urdf", urdf(ARMS["ur"]))

    class Touching(CollisionChecker):
        def __init__(self) -> None: ...

        def is_free(self, joints: Array) -> bool:
            return 0.1 < float(joints[0]) < 0.7

        def contacts(self, joints: Array) -> list[Contact]:
            if self.is_free(joints):
                return []
            rare = [Contact("hand", "cover", -0.1)] if joints[0] > 2.0 else []
            return [*rare, Contact("base_link", "cover", -0.2), Contact("link0", "cover", -0.1)]

    said: list[str] = []
    found = home_posture.positions(Path("arm.urdf"), robot.model, Touching(), "base_link", {}, said)
    assert 0.1 < found["home"][0] < 0.7
    told = said[0].partition("; of 500 positions, these touch: ")[2].partition("; if these links may")[0]
    named = {each.rpartition(" in ")[0] for each in told.split(", ")}
    assert named == {"base_link and cover", "link0 and cover"}
    assert "disable the pairs in an SRDF (--srdf)" in said[0]


def test_of_an_arm_that_is_never_free_the_pair_is_named_that_touches_most(tmp_path: Path) -> None:
    """Which pair touches depends on the position, so none of them is one that always does."""
    robot, _ = made(tmp_path / "arm.urdf", urdf(ARMS["ur"]))
    low, high = robot.limits.min_position[0], robot.limits.max_position[0]
    most = low + 0.8 * (high - low)

    class Touching(CollisionChecker):
        def __init__(self) -> None: ...

        def is_free(self, joints: Array) -> bool:
            return False

        def contacts(self, joints: Array) -> list[Contact]:
            return [Contact("hand", "stand" if joints[0] < most else "elbow", -0.01)]

    with pytest.raises(ConfigError, match=r"hand and stand in (3[89]|4[012]).") as refusal:
        home_posture.positions(Path("arm.urdf"), robot.model, Touching(), "base_link", {}, [])
    assert str(refusal.value).startswith("arm.urdf: the arm touches itself in each of 500 positions, ")
    assert str(refusal.value).endswith(
        "disable the pairs in an SRDF (--srdf); otherwise correct their shapes"
    )
