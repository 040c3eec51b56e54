"""RobotAlgorithm, and what RobotConfig can change of it; without processes.

Oracle: pinocchio; scipy's Rotation.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from independent_models import second_robot
from scipy.spatial.transform import Rotation
from vendor_calls import Caller, ToolHere, run

from app.services.motion.tool_and_limits import RobotSettings
from cobot.codes import Code
from cobot.robot.description import RobotDescription
from cobot.robot.tool import BARE
from cobot.types import Array

RANDOM = np.random.default_rng(44)
TOOL = [0.03, -0.02, 0.15, 0.2, -0.4, 1.0]
NO_TOOL = [0.0] * 6


class Workers:
    """Planning in this very process."""

    def __init__(self, robot: RobotDescription) -> None:
        self._robot = robot

    async def compute(self, work: Callable[[RobotDescription], Any], timeout_s: float) -> Any:
        return work(self._robot)


@pytest.fixture
def services(robot: RobotDescription) -> Iterator[Any]:
    yield SimpleNamespace(
        robot=robot,
        settings=RobotSettings(robot),
        planning=Workers(robot),
        streams=SimpleNamespace(period_s=0.001),
        tool=ToolHere(robot),
    )
    robot.model.carry(BARE)


def joints(robot: RobotDescription, share: float = 0.6) -> Array:
    return share * RANDOM.uniform(robot.limits.min_position, robot.limits.max_position)


def matrix(pose: list[float]) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("xyz", pose[3:]).as_matrix(), pose[:3]
    return out


def tcp(q: Any) -> Array:
    out = np.eye(4)
    out[:3, 3], out[:3, :3] = second_robot().forward(np.array(q))
    return out


@pytest.mark.parametrize("tool", [NO_TOOL, TOOL])
def test_forward_kinematics_is_that_of_another_library(
    services: Any, robot: RobotDescription, tool: list[float]
) -> None:
    async def check() -> None:
        ask = Caller(services, "RobotAlgorithm")
        await Caller(services, "RobotConfig")("setTcpOffset", offset=tool)
        for _ in range(10):
            q = joints(robot, 1.0)
            pose, code = json.loads(await ask("forwardKinematics", q=q.tolist()))
            assert code == 0
            np.testing.assert_allclose(matrix(pose), tcp(q) @ matrix(tool), atol=1e-9)
            flange, _ = json.loads(await ask("forwardToolKinematics", q=q.tolist()))
            np.testing.assert_allclose(matrix(flange), tcp(q), atol=1e-9)  # this arm's TCP is its flange

    run(check())


@pytest.mark.parametrize("tool", [NO_TOOL, TOOL])
def test_inverse_kinematics_brings_the_tip_there_and_stays_near(
    services: Any, robot: RobotDescription, tool: list[float]
) -> None:
    async def check() -> None:
        ask = Caller(services, "RobotAlgorithm")
        await Caller(services, "RobotConfig")("setTcpOffset", offset=tool)
        for _ in range(10):
            q = joints(robot)
            pose, _ = json.loads(await ask("forwardKinematics", q=q.tolist()))
            near = q + RANDOM.uniform(-0.02, 0.02, 7)
            result = await ask("inverseKinematics", qnear=near.tolist(), pose=pose)
            found, code = json.loads(result)  # a string: clients take lists of numbers for something else
            assert code == 0
            np.testing.assert_allclose(tcp(found) @ matrix(tool), matrix(pose), atol=1e-7)
            assert np.abs(np.array(found) - near).max() < 0.2
            flange, _ = json.loads(await ask("forwardToolKinematics", q=q.tolist()))
            found, _ = json.loads(await ask("inverseToolKinematics", qnear=near.tolist(), pose=flange))
            np.testing.assert_allclose(tcp(found), matrix(flange), atol=1e-7)

    run(check())


def test_all_solutions_are_solutions_within_the_limits_and_apart(
    services: Any, robot: RobotDescription
) -> None:
    async def check() -> None:
        ask = Caller(services, "RobotAlgorithm")
        home = list(robot.positions["home"].joints)
        pose, _ = json.loads(await ask("forwardKinematics", q=home))
        solutions, code = json.loads(await ask("inverseKinematicsAll", pose=pose))
        assert code == 0
        assert len(solutions) >= 2
        for index, q in enumerate(solutions):
            np.testing.assert_allclose(tcp(q), matrix(pose), atol=1e-7)
            assert (np.array(q) >= robot.limits.min_position).all()
            assert (np.array(q) <= robot.limits.max_position).all()
            for other in solutions[:index]:
                assert np.abs(np.subtract(q, other)).max() > 1e-3

    run(check())


def test_what_cannot_be_reached_or_read_is_an_error(services: Any) -> None:
    async def check() -> None:
        ask = Caller(services, "RobotAlgorithm")
        far, q = [3.0, 0.0, 0.5, 0.0, 0.0, 0.0], [0.1] * 7
        text = await ask.fails("inverseKinematics", Code.UNREACHABLE, qnear=q, pose=far)
        assert "the TCP cannot reach x 3" in text
        await ask.fails("inverseKinematicsAll", Code.UNREACHABLE, pose=far)
        assert "qnear must have 7" in await ask.fails("inverseKinematics", Code.INPUT, qnear=q[:6], pose=far)
        assert "got 5" in await ask.fails("inverseKinematics", Code.INPUT, qnear=q, pose=far[:5])
        assert "q must have 7" in await ask.fails("forwardKinematics", Code.INPUT, q=[])

    run(check())


def test_dynamics_are_those_of_another_library(services: Any, robot: RobotDescription) -> None:
    import pinocchio

    async def check() -> None:
        ask, other = Caller(services, "RobotAlgorithm"), second_robot()
        for _ in range(10):
            q, qd, qdd = joints(robot, 1.0), RANDOM.uniform(-2, 2, 7), RANDOM.uniform(-5, 5, 7)
            needed = pinocchio.rnea(other.model, other.data, q, qd, qdd)  # the drives' inertia included
            torques = await ask("inverseDynamics", q=q.tolist(), qd=qd.tolist(), qdd=qdd.tolist())
            np.testing.assert_allclose(torques, needed, rtol=1e-6, atol=1e-6)
            back = await ask("forwardDynamics", q=q.tolist(), qd=qd.tolist(), torques=torques)
            np.testing.assert_allclose(back, qdd, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(
                back, pinocchio.aba(other.model, other.data, q, qd, np.array(torques)), rtol=1e-6, atol=1e-6
            )

    run(check())


def test_a_tip_is_found_from_touches_of_one_point(services: Any, robot: RobotDescription) -> None:
    async def check() -> None:
        ask = Caller(services, "RobotAlgorithm")
        tip, point = np.array([0.02, -0.05, 0.18]), np.array([0.4, 0.1, 0.3])
        poses = []
        for _ in range(6):
            turn = Rotation.from_rotvec(RANDOM.uniform(-0.6, 0.6, 3))
            noise = RANDOM.uniform(-1e-5, 1e-5, 3)
            poses.append([*(point - turn.apply(tip) + noise), *turn.as_euler("xyz")])
        found, apart = json.loads(await ask("calibrateTcpPosition", poses=json.dumps(poses)))
        np.testing.assert_allclose(found, tip, atol=1e-4)
        assert 1e-7 < apart < 1e-4
        fails = ask.fails
        assert "3 poses" in await fails("calibrateTcpPosition", Code.INPUT, poses=json.dumps(poses[:2]))
        alike = json.dumps([poses[0]] * 4)
        assert "rotated too little" in await fails("calibrateTcpPosition", Code.INPUT, poses=alike)
        axis = json.dumps([[0.0, 0.0, 0.0, angle, 0.0, 0.0] for angle in (0.0, 0.5, 1.0)])
        assert "about only one axis" in await fails("calibrateTcpPosition", Code.INPUT, poses=axis)
        words = json.dumps([["x"] * 6] * 3)
        assert "poses[0] must be a list of numbers" in await fails(
            "calibrateTcpPosition", Code.INPUT, poses=words
        )

    run(check())
