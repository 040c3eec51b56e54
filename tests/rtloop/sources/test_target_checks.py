"""What a streamed command has to pass.

Oracles: scipy's Rotation and Slerp, numpy's norms and finite differences, closed forms of the thresholds. The
comments name the suites of libpyflexiv's test_rt_safety.cpp that the tests below them cover.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.types import Array
from rtloop.results import ACCEPTED, Rejected
from rtloop.sources.target_checks import angular_distance, check_joint_step, check_pose_step, is_finite

PERIOD_S = 1e-3
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
HERE = np.array([0.5, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0])


def turned(angle: float, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Array:
    return Rotation.from_rotvec(angle * np.array(axis)).as_quat(scalar_first=True)


def pose(offset: tuple[float, float, float] = (0.0, 0.0, 0.0), angle: float = 0.0) -> Array:
    return np.array([*(HERE[:3] + offset), *turned(angle)])


# QuatAngularDist


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 0.01, 1.0, 3.0, np.pi])
def test_the_distance_of_two_orientations_is_the_angle_between_them(angle: float) -> None:
    assert angular_distance(IDENTITY, turned(angle)) == pytest.approx(angle, abs=1e-12)


def test_the_same_orientation_is_at_no_distance() -> None:
    assert angular_distance(turned(0.7), turned(0.7)) < 1e-12


def test_a_quaternion_and_its_negative_are_at_no_distance() -> None:
    assert angular_distance(turned(0.7), -turned(0.7)) < 1e-12


def test_more_than_half_a_turn_is_less_the_other_way() -> None:
    assert angular_distance(IDENTITY, turned(1.5 * np.pi)) == pytest.approx(0.5 * np.pi)


def test_distances_are_those_of_scipy_whatever_the_signs(rng: np.random.Generator) -> None:
    for first, second in rng.normal(size=(200, 2, 4)):
        one, other = (Rotation.from_quat(each, scalar_first=True) for each in (first, second))
        assert angular_distance(first, second) == pytest.approx((one.inv() * other).magnitude(), abs=1e-9)


# CheckFinite


@pytest.mark.parametrize("size", [0, 1, 6, 7])
def test_numbers_are_finite(size: int) -> None:
    assert is_finite(np.full(size, 1e300))


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 3, 6])
def test_one_value_that_is_no_number_is_enough(poison: float, place: int) -> None:
    values = np.zeros(7)
    values[place] = poison
    assert not is_finite(values)
    assert check_joint_step(values, np.zeros(7)) != ACCEPTED
    assert check_pose_step(values, HERE) != ACCEPTED


# CheckJointJump


@pytest.mark.parametrize(("interval_s", "threshold"), [(0.01, 0.1), (0.033, 0.33), (0.1, 1.0)])
def test_the_threshold_of_a_joint_follows_the_rate_of_commands(interval_s: float, threshold: float) -> None:
    last, target = np.full(7, 0.3), np.full(7, 0.3)
    target[4] += 0.999 * threshold
    assert check_joint_step(target, last, interval_s) == ACCEPTED
    target[4] += 0.002 * threshold
    assert check_joint_step(target, last, interval_s).reason.startswith("joint5 would jump by ")
    assert check_joint_step(2 * last - target, last, interval_s).reason.startswith("joint5 would jump by ")


def test_the_interval_of_a_threshold_is_neither_tiny_nor_huge() -> None:
    near, far = np.full(7, 0.0099), np.full(7, 0.99)
    assert check_joint_step(near, np.zeros(7), 0.0) == ACCEPTED
    assert check_joint_step(far, np.zeros(7), 3600.0) == ACCEPTED
    assert check_joint_step(1.02 * near, np.zeros(7), 0.0) != ACCEPTED
    assert check_joint_step(1.02 * far, np.zeros(7), 3600.0) != ACCEPTED


def test_another_number_of_joints_is_said_and_no_crash() -> None:
    assert check_joint_step(np.zeros(6), np.zeros(7)) == Rejected("6 joints instead of 7")


def test_a_robot_slower_than_the_threshold_makes_it_tighter_but_forgives_jitter() -> None:
    limits = np.full(7, 2.0)
    assert check_joint_step(np.full(7, 0.0399), np.zeros(7), 0.01, limits) == ACCEPTED
    assert check_joint_step(np.full(7, 0.0401), np.zeros(7), 0.01, limits).reason.endswith(
        "allowed: 0.0400 rad"
    )


# CheckCartesianJump


@pytest.mark.parametrize(("interval_s", "way", "angle"), [(0.01, 0.1, 0.5), (0.033, 0.33, 1.65)])
def test_the_thresholds_of_a_pose_follow_the_rate_of_commands(
    interval_s: float, way: float, angle: float
) -> None:
    near = pose((0.0, 0.6 * 0.999 * way, 0.8 * 0.999 * way), 0.999 * angle)
    assert check_pose_step(near, HERE, interval_s) == ACCEPTED
    assert (
        "would jump by"
        in check_pose_step(pose((0.0, 0.6 * 1.001 * way, 0.8 * 1.001 * way)), HERE, interval_s).reason
    )
    assert "would turn by" in check_pose_step(pose(angle=1.001 * angle), HERE, interval_s).reason


def test_the_other_sign_of_a_quaternion_is_no_jump() -> None:
    flipped = HERE.copy()
    flipped[3:] *= -1.0
    assert check_pose_step(flipped, HERE) == ACCEPTED


def test_a_pose_of_another_size_is_said_and_no_crash() -> None:
    assert check_pose_step(np.zeros(6), HERE) == Rejected("6 numbers instead of 7")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)
