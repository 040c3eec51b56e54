"""What `cobot new-robot`, `cobot check` and `cobot run` say of drives that are too weak. Oracle: levers and
weights of an arm of two links, calculated by hand.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from cobot_run import unique_name
from swinging_arm import LEVEL, SHOULDER, swinging_arm

from cobot.config import load_settings
from cobot.launch import check
from cobot.launch.cli import main
from cobot.launch.new_robot.efforts import FRICTION_SHARE
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import load_robot


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(check, "_backend", lambda settings, config: "not asked")


def made(tmp_path: Path, text: str) -> tuple[Path, list[str]]:
    (tmp_path / "arm.urdf").write_text(text)
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "made")
    return tmp_path / "made", new.guessed


def checked(folder: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, str]:
    """What check prints, by item."""
    capsys.readouterr()
    main(["check", "--config", str(folder)])
    lines = capsys.readouterr().out.splitlines()
    return {line[8:].partition(":")[0]: line for line in lines}


def test_a_joint_that_cannot_hold_the_arm_is_reported_by_new_robot_and_fails_in_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, said = made(tmp_path, swinging_arm((50.0, 20.0, 50.0)))
    (sentence,) = [each for each in said if "cannot hold the arm" in each]
    assert sentence.startswith("shoulder cannot hold the arm at [")
    assert sentence.endswith(
        "it needs 24.52 N·m, but the file gives 20 N·m; correct its effort or the masses"
    )
    items = checked(folder, capsys)
    assert items["efforts"].startswith("FAILED  efforts: the drives hold the arm in ")
    assert "shoulder needs 24.52 N·m to hold the arm, but its max_effort is 20 N·m" in items["efforts"]
    assert items["position home"].startswith("ok ")


def test_an_arm_that_fails_in_few_postures_only_is_not_said_to_be_held_in_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The shoulder needs 24.525 N·m stretched out level, and has nearly that."""
    folder, said = made(tmp_path, swinging_arm((50.0, 24.5, 50.0)))
    assert (
        "motions into postures that cannot be held are rejected; more than 99 % of the postures can be held"
        in said
    )
    efforts = checked(folder, capsys)["efforts"]
    assert "the drives hold the arm in more than 99 % of its postures: at joints " in efforts
    assert "100 %" not in efforts


def test_an_arm_that_is_too_heavy_by_assumed_masses_passes_with_the_density_that_is_offered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Balls of 0.52 L at 1100 kg/m³: 0.576 kg each; at 300 kg/m³ they weigh 0.157 kg."""
    text = re.sub("<inertial>.*?</inertial>", "", swinging_arm((50.0, 5.0, 50.0)))
    folder, said = made(tmp_path, text)
    assert [each for each in said if each.endswith("or another density with --density")]
    assert checked(folder, capsys)["efforts"].startswith("FAILED")
    assert (
        main(
            ["new-robot", str(tmp_path / "arm.urdf"), "--output", str(tmp_path / "light"), "--density", "300"]
        )
        == 0
    )
    assert checked(tmp_path / "light", capsys)["efforts"].startswith("ok")


def test_drives_that_hold_the_arm_are_reported_with_the_greatest_share(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, said = made(tmp_path, swinging_arm((50.0, 50.0, 50.0)))
    assert not [each for each in said if "cannot hold" in each]
    share = f"{100.0 * SHOULDER / 50.0:.0f} %"
    assert f"shoulder needs most, {share} of its max_effort" in checked(folder, capsys)["efforts"]


def test_the_payload_is_that_of_the_arm_and_in_its_settings(tmp_path: Path) -> None:
    folder, said = made(tmp_path, swinging_arm((50.0, 50.0, 50.0)))
    settings = load_settings(folder / "cobot-setting.yaml")
    assert settings.robot.max_payload_kg == pytest.approx((0.9 * 50.0 - SHOULDER) / 9.81, rel=0.06)
    assert settings.robot.max_payload_kg <= (0.9 * 50.0 - SHOULDER) / 9.81
    assert [
        each for each in said if each.startswith(f"robot.max_payload_kg {settings.robot.max_payload_kg:g}: ")
    ]


def test_a_payload_is_not_more_than_the_arm_weighs(tmp_path: Path) -> None:
    folder, _ = made(tmp_path, swinging_arm((1e5, 1e5, 1e5)))
    assert load_settings(folder / "cobot-setting.yaml").robot.max_payload_kg == 7.0


@pytest.mark.usefixtures("signals_and_log")
def test_a_named_position_that_cannot_be_held_fails_in_check_and_as_the_start_in_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = made(tmp_path, swinging_arm((50.0, 20.0, 50.0)))
    joints = zip(("turn", "shoulder", "elbow"), LEVEL, strict=True)
    state = "".join(f'<joint name="{name}" value="{value}"/>' for name, value in joints)
    srdf = (folder / "robot.srdf").read_text()
    level = f'<group_state name="level" group="arm">{state}</group_state></robot>'
    (folder / "robot.srdf").write_text(srdf.replace("</robot>", level))
    items = checked(folder, capsys)
    assert items["position level"].startswith(
        "FAILED  position level: the position cannot be held: shoulder nee"
    )
    settings = yaml.safe_load((folder / "cobot-setting.yaml").read_text())
    settings["robot"] |= {"start_position": "level", "name": unique_name()}
    settings |= {"logs": str(folder / "logs")}
    (folder / "cobot-setting.yaml").write_text(yaml.safe_dump(settings))
    assert main(["run", "--config", str(folder), "--port", "0"]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert "robot.srdf: position 'level' cannot be held: shoulder needs 24.52 N·m to hold the arm" in said


def test_friction_that_a_drive_cannot_overcome_is_reduced_and_reported(tmp_path: Path) -> None:
    folder, said = made(tmp_path, swinging_arm(dynamics='<dynamics friction="60" damping="10"/>'))
    mj = load_robot(load_settings(folder / "cobot-setting.yaml")).model.mj
    left = FRICTION_SHARE * (50.0 - SHOULDER)
    assert mj.dof_frictionloss[1] + 2.0 * mj.dof_damping[1] == pytest.approx(left, rel=1e-3)
    assert mj.dof_frictionloss[1] / mj.dof_damping[1] == pytest.approx(6.0, rel=1e-4)
    (sentence,) = [each for each in said if "friction" in each]
    assert sentence.startswith(
        "shoulder: friction reduced from 60 to 5.73 N·m, damping from 10 to 0.955 N·m per"
    )


def test_friction_that_a_drive_can_overcome_is_kept(tmp_path: Path) -> None:
    folder, said = made(tmp_path, swinging_arm(dynamics='<dynamics friction="2" damping="1"/>'))
    mj = load_robot(load_settings(folder / "cobot-setting.yaml")).model.mj
    assert (mj.dof_frictionloss[1], mj.dof_damping[1]) == (2.0, 1.0)
    assert "friction and damping of the file are simulated: shoulder" in said
