"""Inverse kinematics. Oracle: pinocchio's forward kinematics of the joints that come back."""

from __future__ import annotations

import re

import numpy as np
import pytest
from independent_models import second_robot
from scipy.spatial.transform import Rotation

from cobot.errors import UnreachableError
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse, solve_near
from cobot.types import Array, Pose

SEED = 20261121
POSES = 400
DOWN = np.array([0.0, 0.0, 1.0, 0.0])


def seeded() -> np.random.Generator:
    return np.random.default_rng(SEED)


def drawn(robot: RobotDescription, random: np.random.Generator, count: int) -> Array:
    limits = robot.limits
    return random.uniform(limits.min_position, limits.max_position, (count, limits.dof))


def pose_of(joints: Array) -> Pose:
    """By pinocchio."""
    position, turn = second_robot().forward(joints)
    return Pose(position, Rotation.from_matrix(turn).as_quat(scalar_first=True))


def distance(joints: Array, pose: Pose) -> tuple[float, float]:
    """How far, in m and rad, pinocchio finds the TCP from a pose."""
    position, turn = second_robot().forward(joints)
    wanted = Rotation.from_quat(pose.quaternion, scalar_first=True)
    off = (wanted.inv() * Rotation.from_matrix(turn)).magnitude()
    return float(np.linalg.norm(position - pose.position)), float(off)


def require_within_limits(robot: RobotDescription, joints: Array) -> None:
    assert (joints >= robot.limits.min_position).all()
    assert (joints <= robot.limits.max_position).all()


def test_every_reachable_pose_is_solved_from_home_within_the_limits(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    for joints in drawn(robot, seeded(), POSES):
        pose = pose_of(joints)
        found = inverse(robot.model, pose, home)
        off_m, off_rad = distance(found, pose)
        assert off_m < 1e-9, joints
        assert off_rad < 1e-9, joints
        require_within_limits(robot, found)


def test_a_seed_that_already_is_the_solution_comes_back(robot: RobotDescription) -> None:
    for joints in drawn(robot, seeded(), 50):
        assert inverse(robot.model, pose_of(joints), joints) == pytest.approx(joints, abs=1e-6)


def test_the_solution_stays_in_the_seeds_neighbourhood_when_the_pose_does(robot: RobotDescription) -> None:
    # Elbow well bent and away from the limits: 1 cm and 1 degree need joint steps of some hundredths.
    random = seeded()
    home = np.array(robot.positions["home"].joints)
    for _ in range(100):
        joints = home + random.uniform(-0.3, 0.3, robot.limits.dof)
        near = pose_of(joints)
        turn = Rotation.from_rotvec(random.uniform(-0.01, 0.01, 3))
        orientation = (turn * Rotation.from_quat(near.quaternion, scalar_first=True)).as_quat(
            scalar_first=True
        )
        pose = Pose(near.position + random.uniform(-0.006, 0.006, 3), orientation)
        found = inverse(robot.model, pose, joints)
        assert max(distance(found, pose)) < 1e-6
        assert np.abs(found - joints).max() < 0.15, joints


def test_a_seed_beyond_the_limits_still_gives_joints_within_them(robot: RobotDescription) -> None:
    for joints in drawn(robot, seeded(), 20):
        found = inverse(robot.model, pose_of(joints), 3.0 * joints)
        require_within_limits(robot, found)
        assert max(distance(found, pose_of(joints))) < 1e-6


def test_the_same_question_gets_the_same_answer(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    for joints in drawn(robot, seeded(), 20):
        pose = pose_of(joints)
        assert inverse(robot.model, pose, home).tolist() == inverse(robot.model, pose, home).tolist()


def test_a_quaternion_and_its_negative_are_the_same_orientation(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    pose = pose_of(home + 0.1)
    opposite = Pose(pose.position, -pose.quaternion)
    assert inverse(robot.model, opposite, home) == pytest.approx(inverse(robot.model, pose, home), abs=1e-9)


def test_half_a_turn_of_the_tool_is_solved(robot: RobotDescription) -> None:
    # The rotation vector of the error is not unique here, and must not become 0.
    joints = np.array(robot.positions["home"].joints)
    pose = pose_of(joints)
    for axis in np.eye(3):
        half = Rotation.from_rotvec(np.pi * axis) * Rotation.from_quat(pose.quaternion, scalar_first=True)
        wanted = Pose(pose.position, half.as_quat(scalar_first=True))
        assert max(distance(inverse(robot.model, wanted, joints), wanted)) < 1e-6


@pytest.mark.parametrize("position", [(2.0, 0.0, 0.5), (0.0, 0.0, 3.0), (0.0, 1.5, 0.0), (0.0, 0.0, 0.36)])
def test_a_pose_out_of_reach_is_an_error_that_says_where_and_how_near(
    robot: RobotDescription, position: tuple[float, float, float]
) -> None:
    home = np.array(robot.positions["home"].joints)
    with pytest.raises(UnreachableError) as caught:
        inverse(robot.model, Pose(np.array(position), DOWN), home)
    x, y, z = position
    assert f"the TCP cannot reach x {x:g}, y {y:g}, z {z:g} m" in str(caught.value)
    assert re.search(r"as near as [\d.]+ mm and [\d.]+ degrees$", str(caught.value))


def test_the_distance_that_is_missing_is_at_least_what_geometry_says(robot: RobotDescription) -> None:
    # From the shoulder at z 0.36 m the flange comes 0.42 + 0.4 + 0.126 m far at the most.
    home = np.array(robot.positions["home"].joints)
    with pytest.raises(UnreachableError) as caught:
        inverse(robot.model, Pose(np.array([1.2, 0.0, 0.36]), DOWN), home)
    near = re.search(r"as near as ([\d.]+) mm", str(caught.value))
    assert near is not None
    assert float(near.group(1)) >= 1e3 * (1.2 - 0.946) - 0.1


def test_one_descent_reports_how_far_from_the_goal_it_ended(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    pose = Pose(np.array([1.2, 0.0, 0.36]), DOWN)
    descent = solve_near(robot.model, pose, home)
    assert not descent.solved
    require_within_limits(robot, descent.joints)
    assert (descent.distance_m, descent.angle_rad) == pytest.approx(distance(descent.joints, pose), abs=1e-9)


def test_one_descent_that_solved_is_within_a_tenth_of_a_micrometre(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    pose = pose_of(home + 0.05)
    descent = solve_near(robot.model, pose, home)
    assert descent.solved
    assert max(distance(descent.joints, pose)) < 1.1e-7
