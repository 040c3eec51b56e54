"""The limits in config/fr3_joint_limits.yaml. Oracle: those that Franka Robotics publishes with the Franka
Control Interface ("Control Interface Specification and Robot Limits"), for the FR3 and for the Franka Emika
Robot."""

from __future__ import annotations

import numpy as np
import pytest
from franka_settings import franka_settings

from cobot.robot.description import RobotDescription, load_robot

FR3_MIN = [-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]
FR3_MAX = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]
FR3_VELOCITY = [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]
FR3_ACCELERATION, FR3_JERK = [10.0] * 7, [5000.0] * 7
PANDA_MIN = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
PANDA_MAX = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
PANDA_VELOCITY = [2.175] * 4 + [2.61] * 3
PANDA_ACCELERATION = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
PANDA_JERK = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]
TORQUE = [87.0] * 4 + [12.0] * 3
# The FR3's velocity limit falls towards the ends: v(q) = -offset + sqrt(factor (end - q)), likewise below.
FALLING_OFFSET = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
FALLING_FACTOR = np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0])
FALLING_MAX = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
FALLING_MIN = np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196])
MARGIN = 1e-3
"""libfranka itself keeps so far from the limits."""


def velocity_limits(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest velocity that the FR3 permits there, rad/s."""

    def falling(way: np.ndarray) -> np.ndarray:
        return np.clip(np.sqrt(FALLING_FACTOR * np.clip(way, 0.0, None)) - FALLING_OFFSET, 0.0, FR3_VELOCITY)

    return -falling(position - FALLING_MIN), falling(FALLING_MAX - position)


@pytest.fixture(scope="module")
def fr3() -> RobotDescription:
    return load_robot(franka_settings())


def test_they_are_within_the_published_ones_of_both_robots(fr3: RobotDescription) -> None:
    limits = fr3.limits
    assert (limits.min_position > np.maximum(FR3_MIN, PANDA_MIN)).all()
    assert (limits.max_position < np.minimum(FR3_MAX, PANDA_MAX)).all()
    assert (limits.max_velocity < np.minimum(FR3_VELOCITY, PANDA_VELOCITY)).all()
    assert (limits.max_acceleration < np.minimum(FR3_ACCELERATION, PANDA_ACCELERATION)).all()
    assert (limits.max_jerk < np.minimum(FR3_JERK, PANDA_JERK)).all()
    assert (limits.max_effort == TORQUE).all()


def test_an_arm_that_can_still_stop_is_slower_than_the_fr3_permits_there(fr3: RobotDescription) -> None:
    limits = fr3.limits
    for share in np.linspace(0.0, 1.0, 20_001):
        position = limits.min_position + share * (limits.max_position - limits.min_position)
        least, most = velocity_limits(position)
        up = np.sqrt(2.0 * limits.max_acceleration * (limits.max_position - position))
        down = np.sqrt(2.0 * limits.max_acceleration * (position - limits.min_position))
        assert (np.minimum(up, limits.max_velocity) + MARGIN <= most).all(), position
        assert (np.minimum(down, limits.max_velocity) + MARGIN <= -least).all(), position


def test_its_kinematics_are_those_of_the_published_parameters(fr3: RobotDescription) -> None:
    """Craig's convention: a and alpha of the link before, d and theta of the joint."""
    parameters = [
        (0.0, 0.333, 0.0),
        (0.0, 0.0, -np.pi / 2),
        (0.0, 0.316, np.pi / 2),
        (0.0825, 0.0, np.pi / 2),
        (-0.0825, 0.384, -np.pi / 2),
        (0.0, 0.0, np.pi / 2),
        (0.088, 0.0, np.pi / 2),
    ]
    random = np.random.default_rng(4)
    for _ in range(50):
        joints = random.uniform(fr3.limits.min_position, fr3.limits.max_position)
        frame = np.eye(4)
        for (a, d, alpha), theta in zip([*parameters, (0.0, 0.107, 0.0)], [*joints, 0.0], strict=True):
            ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
            frame = frame @ [
                [ct, -st, 0.0, a],
                [st * ca, ct * ca, -sa, -d * sa],
                [st * sa, ct * sa, ca, d * ca],
                [0.0, 0.0, 0.0, 1.0],
            ]
        pose = fr3.model.forward(joints)
        assert pose.position == pytest.approx(frame[:3, 3], abs=1e-9)


def test_its_named_positions_are_free_and_most_of_its_range_is(fr3: RobotDescription) -> None:
    for position in fr3.positions.values():
        assert not fr3.collision.contacts(np.array(position.joints))
    random = np.random.default_rng(8)
    free = sum(
        not fr3.collision.contacts(random.uniform(fr3.limits.min_position, fr3.limits.max_position))
        for _ in range(300)
    )
    assert free > 240  # the rest is in the floor, or bent into itself
