"""`cobot new-robot` of arms with the structure of the makers' public descriptions, without any option: UR5e,
CRX-10iA, KR 10, GP7, xArm6, Gen3, M1013. Oracle: pinocchio's kinematics and gravity of the same file.

The makers' own files are measured by `make corpus`; they are not in the tests.
"""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from makers_arms import MAKERS, maker_urdf

from cobot.config import load_settings
from cobot.launch.cli import main
from cobot.planners import MotionRequest, plan
from cobot.robot.description import load_robot
from cobot.types import PlannerName, Scaling


@pytest.mark.parametrize("name", MAKERS)
def test_a_maker_s_arm_needs_no_special_case(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm, file, made = MAKERS[name], tmp_path / f"{name}.urdf", tmp_path / name
    file.write_text(maker_urdf(arm), encoding="utf-8")
    assert main(["new-robot", str(file), "--output", str(made)]) == 0
    assert main(["check", "--config", str(made)]) == 0, capsys.readouterr().out
    settings = load_settings(made / "cobot-setting.yaml")
    robot = load_robot(settings)
    limits = robot.limits
    assert list(limits.names) == [joint.name for joint in arm.joints]
    ranges = [joint.bounds or (-2.0 * pi, 2.0 * pi) for joint in arm.joints]
    np.testing.assert_allclose(limits.min_position, [low for low, _ in ranges], atol=1e-6)
    np.testing.assert_allclose(limits.max_position, [high for _, high in ranges], atol=1e-6)
    assert (limits.max_velocity <= np.array([joint.limit[0] for joint in arm.joints]) + 1e-9).all()
    assert settings.robot.tcp == arm.tcp

    # pinocchio has two numbers, cosine and sine, for a continuous joint.
    other = pinocchio.buildModelFromUrdf(str(file))
    data = other.createData()
    base, tip = (other.getFrameId(each) for each in (settings.robot.base_frame, arm.tcp))
    random = np.random.default_rng(1)
    for joints in random.uniform(limits.min_position, limits.max_position, (20, limits.dof)):
        numbers: list[float] = []
        for value, joint in zip(joints, arm.joints, strict=True):
            numbers += [value] if joint.bounds else [np.cos(value), np.sin(value)]
        pinocchio.framesForwardKinematics(other, data, np.array(numbers))
        expected = data.oMf[base].actInv(data.oMf[tip])
        np.testing.assert_allclose(robot.model.forward(joints).position, expected.translation, atol=1e-9)
        if arm.mass_kg:
            pinocchio.computeGeneralizedGravity(other, data, np.array(numbers))
            np.testing.assert_allclose(robot.model.gravity_torques(joints), data.g, atol=1e-8)

    home = robot.positions[settings.robot.start_position].joints
    goal = np.array(home)
    goal[0] += 0.3
    request = MotionRequest(np.array(home), goal, PlannerName.PTP, Scaling(speed=1.0), None, timeout_s=5.0)
    motion = plan(robot, request)
    assert motion is not None
    np.testing.assert_allclose(motion.end, goal, atol=1e-9)
