"""Rigid transforms. Oracle: homogeneous matrices of numpy with rotations of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.errors import InputError
from cobot.types import Array, Pose

RNG = np.random.default_rng(27)


def random_pose() -> Pose:
    return Pose(RNG.normal(size=3), RNG.normal(size=4))


def homogeneous(pose: Pose) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()
    matrix[:3, 3] = pose.position
    return matrix


def test_the_product_of_poses_is_that_of_their_matrices() -> None:
    for _ in range(100):
        first, second = random_pose(), random_pose()
        expected = homogeneous(first) @ homogeneous(second)
        np.testing.assert_allclose(homogeneous(first @ second), expected, atol=1e-14)


def test_the_inverse_of_a_pose_is_that_of_its_matrix() -> None:
    for _ in range(100):
        pose = random_pose()
        np.testing.assert_allclose(homogeneous(pose.inverse()), np.linalg.inv(homogeneous(pose)), atol=1e-14)


def test_points_are_transformed_one_by_one_and_together() -> None:
    for _ in range(100):
        pose, points = random_pose(), RNG.normal(size=(5, 3))
        expected = (homogeneous(pose) @ np.column_stack([points, np.ones(5)]).T)[:3].T
        np.testing.assert_allclose(pose.apply(points), expected, atol=1e-14)
        np.testing.assert_allclose(pose.apply(points[0]), expected[0], atol=1e-14)


def test_the_rotation_matrix_is_that_of_scipy() -> None:
    for _ in range(100):
        pose = random_pose()
        np.testing.assert_allclose(pose.rotation, homogeneous(pose)[:3, :3], atol=1e-15)


def test_a_pose_survives_its_seven_numbers() -> None:
    pose = random_pose()
    again = Pose.from_numbers(pose.numbers)
    np.testing.assert_allclose(again.position, pose.position, rtol=0.0)
    np.testing.assert_allclose(again.quaternion, pose.quaternion, atol=1e-15)


def test_a_pose_from_kukas_angles_is_in_metres_and_radians_and_has_them_again() -> None:
    pose = Pose.from_abc(0.4, 0.0, 0.5, 0.3, -0.2, np.pi / 2)
    assert pose.position.tolist() == [0.4, 0.0, 0.5]
    expected = Rotation.from_euler("ZYX", [0.3, -0.2, np.pi / 2]).as_matrix()
    np.testing.assert_allclose(pose.rotation, expected, atol=1e-15)
    assert pose.abc == pytest.approx((0.3, -0.2, np.pi / 2))
    with pytest.raises(InputError, match="angles must be finite"):
        Pose.from_abc(0.4, 0.0, 0.5, np.inf, 0.0, 0.0)


def test_the_error_names_the_part_of_a_pose_that_is_wrong() -> None:
    for position, quaternion, error in (
        (np.zeros(3), np.zeros(4), "quaternion must not be zero"),
        (np.array([0, np.nan, 0]), np.array([1.0, 0, 0, 0]), "position must be finite"),
        (np.zeros(2), np.array([1.0, 0, 0, 0]), "position must have 3 numbers"),
    ):
        with pytest.raises(InputError, match=error):
            Pose(position, quaternion)


@pytest.mark.parametrize("numbers", [(0.0,) * 7, (np.nan, 0, 0, 1, 0, 0, 0), (0, 0, 0, 1, 0, 0), (0, 0)])
def test_numbers_that_are_no_pose_are_rejected(numbers: tuple[float, ...]) -> None:
    with pytest.raises(InputError):
        Pose.from_numbers(numbers)
