"""What `cobot check` and `cobot run` refuse of a robot's files. Oracle: files broken by hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from cobot_run import unique_name
from urdf_arms import ARMS, urdf

from benchmarks import arms
from cobot.config import load_settings
from cobot.launch.check import check
from cobot.launch.cli import main
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import load_robot


@pytest.mark.parametrize(
    ("file", "old", "new", "reason"),
    [
        ("model.xml", "<general ", '<general biastype="affine" biasprm="0 -9 0" ', "not a <motor>"),
        ("model.xml", "<general ", '<general gear="50" ', "not a <motor>"),
        ("model.xml", "<joint ", '<joint stiffness="5" ', "stiffness of joint a0: it would push the"),
        ("model.xml", "<joint ", '<joint margin="0.1" ', "margin of joint a0: it would push the"),
        (
            "model.xml",
            '<body name="link1" ',
            '<body name="link1" gravcomp="1" ',
            "gravcomp of body link1",
        ),
        ("joint_limits.yaml", "max_position: 2.9", "max_position: 3.0", "set min_position to -2.9"),
        ("joint_limits.yaml", "max_position: 0.5", "max_position: 500", "looks like millimetres"),
        ("joint_limits.yaml", "max_velocity: 1.5", "max_velocity: 1500.0", "1500 m/s, which looks like mm/s"),
        ("joint_limits.yaml", "max_velocity: 1.5", "max_velocity: 1.6", "set max_velocity to 1.5 or less"),
        ("joint_limits.yaml", "max_effort: 200.0", "max_effort: 201.0", "set max_effort to 200 or less"),
        ("robot.srdf", 'name="a2" value="0.0"', 'name="a2" value="3.0"', "of a2 is 3 rad"),
        ("robot.srdf", 'name="a0" value="0.0"', 'name="a0" value="3.0"', "of a0 is 3 m, allowed: -0.5 to"),
    ],
)
@pytest.mark.usefixtures("signals_and_log")
def test_check_and_run_name_the_way_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], file: str, old: str, new: str, reason: str
) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["gantry"]))
    made = tmp_path / "made"
    NewRobot(tmp_path / "arm.urdf").write(made)
    text = (made / file).read_text()
    assert old in text
    (made / file).write_text(text.replace(old, new, 1))
    assert reason in _found(made)
    assert reason in _said_by_run(made, capsys)


@pytest.mark.usefixtures("signals_and_log")
def test_check_and_run_refuse_actuators_in_another_order(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]))
    made = tmp_path / "made"
    NewRobot(tmp_path / "arm.urdf").write(made)
    text = (made / "model.xml").read_text()
    text = (
        text.replace('joint="a0"', "HERE").replace('joint="a1"', 'joint="a0"').replace("HERE", 'joint="a1"')
    )
    (made / "model.xml").write_text(text)
    assert "in this order" in _found(made)
    assert "in this order" in _said_by_run(made, capsys)


@pytest.mark.usefixtures("signals_and_log")
def test_check_and_run_refuse_a_named_position_in_which_the_arm_touches_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.urdf").write_text(arms.urdf("ur"))
    made = tmp_path / "made"
    NewRobot(tmp_path / "arm.urdf").write(made)
    robot = load_robot(load_settings(made / "cobot-setting.yaml"))
    text = (made / "robot.srdf").read_text()
    folded = np.random.default_rng(5).uniform(robot.limits.min_position, robot.limits.max_position, (200, 6))
    touching = next(joints for joints in folded if robot.collision.contacts(joints))
    state = "".join(f'<joint name="a{i}" value="{value}"/>' for i, value in enumerate(touching.tolist(), 1))
    state = f'<group_state name="folded" group="arm">{state}</group_state></robot>'
    (made / "robot.srdf").write_text(text.replace("</robot>", state))
    assert re.search(r"link\d touches link\d", _found(made))
    said = _said_by_run(made, capsys)
    assert re.search(r"robot\.srdf: position 'folded' is in collision: .*link\d", said), said


@pytest.mark.parametrize(("velocity", "refused"), [(1.5, False), (1.6, True)])
def test_a_urdf_that_is_the_model_itself_says_how_fast_its_joints_may_be(
    tmp_path: Path, velocity: float, refused: bool
) -> None:
    file, made = tmp_path / "arm.urdf", tmp_path / "made"
    file.write_text(urdf(ARMS["ur"]))
    NewRobot(file).write(made)
    (made / "arm.urdf").write_text(file.read_text())
    settings = yaml.safe_load((made / "cobot-setting.yaml").read_text())
    settings["robot"] |= {"model": "arm.urdf"}
    (made / "cobot-setting.yaml").write_text(yaml.safe_dump(settings))
    limits = (
        (made / "joint_limits.yaml").read_text().replace("max_velocity: 1.5", f"max_velocity: {velocity}")
    )
    (made / "joint_limits.yaml").write_text(limits)
    said = "max_velocity of a0 is 1.6 rad/s, but arm.urdf allows 1.5 rad/s: set max_velocity to 1.5 or less"
    assert (said in _found(made)) == refused


def _said_by_run(made: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """Why `cobot run` does not start."""
    capsys.readouterr()
    settings = yaml.safe_load((made / "cobot-setting.yaml").read_text())
    settings |= {"logs": str(made / "logs"), "robot": settings["robot"] | {"name": unique_name()}}
    (made / "cobot-setting.yaml").write_text(yaml.safe_dump(settings))
    assert main(["run", "--config", str(made), "--port", "0"]) == 1
    return capsys.readouterr().err.splitlines()[-1]


def _found(made: Path) -> str:
    settings = load_settings(made / "cobot-setting.yaml")
    with (made / "out").open("w") as out:
        items = check(settings, made / "cobot-setting.yaml", out)
    return " ".join(item.found for item in items if not item.good)


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("arm.urdf.xacro", "it is xacro: convert it with `cobot new-robot arm.urdf.xacro`"),
        ("arm.urdf", "convert it and its meshes with `cobot new-robot arm.urdf --package FOLDER`"),
    ],
)
@pytest.mark.usefixtures("signals_and_log")
def test_a_model_as_ros_has_it_is_refused_with_the_command_that_makes_one_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, advice: str
) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]))
    made = tmp_path / "made"
    NewRobot(tmp_path / "arm.urdf").write(made)
    mesh = '<mesh filename="package://parts/a.stl"/>'
    (made / name).write_text(urdf(ARMS["ur"]).replace('<sphere radius="0.03"/>', mesh, 1))
    settings = yaml.safe_load((made / "cobot-setting.yaml").read_text())
    settings["robot"]["model"] = name
    (made / "cobot-setting.yaml").write_text(yaml.safe_dump(settings))
    assert advice in _found(made)
    assert advice in _said_by_run(made, capsys)
