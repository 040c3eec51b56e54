"""Whether the drives hold the arm. Oracle: levers and weights of an arm of two links, calculated by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from swinging_arm import ELBOW, GRAVITY, LENGTH, LEVEL, SHOULDER, UPRIGHT, swinging_arm

from cobot.config import Settings, load_settings
from cobot.errors import LimitError, PlanningError
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.holding import PAYLOAD_SHARE, check_holds, check_start, examine, payload
from cobot.robot.tool import Tool, ToolFile
from cobot.types import PlannerName, Scaling


def made(tmp_path: Path, *efforts: float) -> tuple[Settings, RobotDescription]:
    (tmp_path / "arm.urdf").write_text(swinging_arm((50.0, *efforts)))  # type: ignore[arg-type]
    NewRobot(tmp_path / "arm.urdf").write(tmp_path / "made")
    settings = load_settings(tmp_path / "made" / "cobot-setting.yaml")
    settings = settings.model_copy(update={"kept": tmp_path / "kept"})
    return settings, load_robot(settings)


def test_the_hardest_posture_of_each_joint_is_found(tmp_path: Path) -> None:
    _, robot = made(tmp_path, 50.0, 50.0)
    holding = examine(robot.model, robot.collision, robot.limits)
    needed = {hold.joint: hold.needed for hold in holding.hardest}
    assert needed == pytest.approx({"turn": 0.0, "shoulder": SHOULDER, "elbow": ELBOW}, rel=2e-3, abs=1e-9)
    assert holding.hardest[0].joint == "shoulder"
    assert not holding.failing
    assert holding.share == 1.0


def test_a_joint_that_cannot_hold_the_arm_is_found_with_the_share_of_postures(tmp_path: Path) -> None:
    """A weight on a lever that turns evenly is held by the share s of its greatest torque in 2/π arcsin s of
    the half turns; of ranges of ±2.5 rad that is compared with random postures' torques themselves.
    """
    _, robot = made(tmp_path, 20.0, 50.0)
    holding = examine(robot.model, robot.collision, robot.limits)
    assert [hold.joint for hold in holding.failing] == ["shoulder"]
    _, upper, lower = np.random.default_rng(7).uniform(-2.5, 2.5, (3, 20_000))
    torques = GRAVITY * (
        4.0 * 0.25 * np.sin(upper) + 2.0 * (0.5 * np.sin(upper) + 0.25 * np.sin(upper + lower))
    )
    assert holding.share == pytest.approx(float((np.abs(torques) <= 20.0).mean()), abs=0.05)


def test_the_payload_is_what_the_drives_hold_stretched_out(tmp_path: Path) -> None:
    _, robot = made(tmp_path, 50.0, 50.0)
    mass, hold = payload(robot.model, robot.collision, robot.limits)
    assert mass == pytest.approx((PAYLOAD_SHARE * 50.0 - SHOULDER) / (GRAVITY * 2.0 * LENGTH), rel=0.01)
    assert hold.joint == "shoulder"
    assert robot.model.carried.mass == 0.0


def test_without_strength_for_itself_an_arm_carries_nothing(tmp_path: Path) -> None:
    _, robot = made(tmp_path, 20.0, 50.0)
    assert payload(robot.model, robot.collision, robot.limits)[0] == 0.0


def test_a_position_that_cannot_be_held_names_the_joint_and_both_torques(tmp_path: Path) -> None:
    _, robot = made(tmp_path, 20.0, 50.0)
    check_holds(robot.model, robot.limits, np.array(UPRIGHT), "the position")
    with pytest.raises(
        LimitError, match=r"the position cannot be held: shoulder needs 24\.5[23] N·m .* is 20 N·m; choose"
    ) as said:
        check_holds(robot.model, robot.limits, np.array(LEVEL), "the position")
    (finding,) = said.value.findings
    assert (finding.quantity, finding.limit, finding.of) == ("effort", 20.0, ("shoulder",))


@pytest.mark.parametrize("planner", [PlannerName.PTP, PlannerName.OMPL])
def test_a_goal_that_cannot_be_held_is_rejected_by_the_planner(tmp_path: Path, planner: PlannerName) -> None:
    _, robot = made(tmp_path, 20.0, 50.0)
    request = MotionRequest(
        np.array(UPRIGHT), np.array(LEVEL), planner, Scaling(speed=1.0), None, timeout_s=5.0
    )
    with pytest.raises(
        (LimitError, PlanningError), match=r"shoulder needs .* to hold the arm at .*limit is 20"
    ):
        plan(robot, request)


def test_a_start_that_the_tool_makes_too_heavy_is_rejected(tmp_path: Path) -> None:
    """Level, the tool of 0.5 kg at 1.5 m adds 7.36 N·m to 24.52 N·m."""
    settings, robot = made(tmp_path, 30.0, 50.0)
    section = settings.robot.model_copy(update={"max_payload_kg": 1.0})
    settings = settings.model_copy(update={"robot": section})
    upright, level = (f'"shoulder" value="{joints[1]}"' for joints in (UPRIGHT, LEVEL))
    settings.robot.srdf.write_text(settings.robot.srdf.read_text().replace(upright, level))
    robot = load_robot(settings)
    check_start(robot, settings)
    ToolFile(settings.tool_file).write(Tool(mass=0.5, centre=(0.0, 0.0, 0.5), version=1))
    wanted = r"robot\.srdf: position 'home' cannot be held with 0\.5 kg: shoulder needs 31\.8[78] N·m"
    with pytest.raises(LimitError, match=wanted):
        check_start(robot, settings)
    assert robot.model.carried.mass == 0.0
