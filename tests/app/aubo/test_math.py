"""Math.

Oracle: scipy's Rotation and homogeneous matrices of numpy.
"""

from __future__ import annotations

import asyncio
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from app.aubo import math as _registers  # noqa: F401
from app.aubo.registry import call
from cobot.codes import Code
from cobot.types import Array

RANDOM = np.random.default_rng(20)
POSES = np.hstack([RANDOM.uniform(-2, 2, (40, 3)), RANDOM.uniform(-3.1, 3.1, (40, 3))]).tolist()
PAIRS = list(zip(POSES[:20], POSES[20:], strict=True))


def result(method: str, **arguments: Any) -> Any:
    robot: Any = None
    answer = asyncio.run(call(robot, "Math", method, arguments))
    assert answer.code == 0, answer
    return answer.result


def refusal(method: str, **arguments: Any) -> str:
    robot: Any = None
    answer = asyncio.run(call(robot, "Math", method, arguments))
    assert answer.code == Code.INPUT
    return answer.message


def rotation(pose: list[float]) -> Rotation:
    """Fixed axes x, then y, then z: lower case in scipy."""
    return Rotation.from_euler("xyz", pose[3:])


def matrix(pose: list[float]) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation(pose).as_matrix(), pose[:3]
    return out


def same(pose: list[float], expected: Array) -> None:
    np.testing.assert_allclose(matrix(pose), expected, atol=1e-12)


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_a_pose_in_a_frame_is_the_product_of_the_matrices(first: list[float], second: list[float]) -> None:
    same(result("poseTrans", pose_from=first, pose_from_to=second), matrix(first) @ matrix(second))


@pytest.mark.parametrize("pose", POSES[:10])
def test_the_inverse_is_that_of_the_matrix(pose: list[float]) -> None:
    same(result("poseInverse", pose=pose), np.linalg.inv(matrix(pose)))


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_poses_are_added_and_subtracted_part_by_part(first: list[float], second: list[float]) -> None:
    added = result("poseAdd", p1=first, p2=second)
    np.testing.assert_allclose(added[:3], np.add(first[:3], second[:3]))
    turn = rotation(first) * rotation(second)
    np.testing.assert_allclose(rotation(added).as_matrix(), turn.as_matrix(), atol=1e-12)
    same(result("poseSub", p1=added, p2=second), matrix(first))


@pytest.mark.parametrize(("first", "second"), PAIRS[:5])
def test_distances_are_those_of_position_and_of_orientation(first: list[float], second: list[float]) -> None:
    apart = np.linalg.norm(np.subtract(first[:3], second[:3]))
    assert result("poseDistance", p1=first, p2=second) == pytest.approx(apart)
    angle = (rotation(first).inv() * rotation(second)).magnitude()
    assert result("poseAngleDistance", p1=first, p2=second) == pytest.approx(angle)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
@pytest.mark.parametrize(("first", "second"), PAIRS[:5])
def test_between_two_poses_it_is_straight_and_slerp(
    first: list[float], second: list[float], alpha: float
) -> None:
    pose = result("interpolatePose", p1=first, p2=second, alpha=alpha)
    np.testing.assert_allclose(pose[:3], (1 - alpha) * np.array(first[:3]) + alpha * np.array(second[:3]))
    turn = Slerp([0, 1], Rotation.concatenate([rotation(first), rotation(second)]))(alpha)
    np.testing.assert_allclose(rotation(pose).as_matrix(), turn.as_matrix(), atol=1e-12)


def test_alpha_beyond_one_goes_on() -> None:
    pose = result("interpolatePose", p1=[0.0] * 6, p2=[1.0, 0, 0, 0.4, 0, 0], alpha=1.5)
    np.testing.assert_allclose(pose, [1.5, 0, 0, 0.6, 0, 0], atol=1e-12)


@pytest.mark.parametrize("pose", POSES[:10])
def test_roll_pitch_yaw_to_a_quaternion_and_back(pose: list[float]) -> None:
    quaternion = result("rpyToQuaternion", rpy=pose[3:])
    expected = rotation(pose).as_quat(canonical=True, scalar_first=True)
    np.testing.assert_allclose(quaternion, expected, atol=1e-12)
    back = result("quaternionToRpy", quat=[-2.0 * value for value in quaternion])  # of any length and sign
    np.testing.assert_allclose(back, rotation(pose).as_euler("xyz"), atol=1e-12)


@pytest.mark.parametrize("pose", POSES[:10])
def test_roll_pitch_yaw_to_a_rotation_vector_and_back(pose: list[float]) -> None:
    vector = result("rpyToRotationVector", rpy=pose[3:])
    np.testing.assert_allclose(vector, rotation(pose).as_rotvec(), atol=1e-12)
    back = result("rotationVectorToRpy", rotv=vector)
    np.testing.assert_allclose(back, rotation(pose).as_euler("xyz"), atol=1e-12)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_where_roll_and_yaw_are_not_unique_the_orientation_still_is(pitch: float) -> None:
    pose = [0.0, 0.0, 0.0, 0.4, pitch, -0.3]
    rpy = result("quaternionToRpy", quat=result("rpyToQuaternion", rpy=pose[3:]))
    assert rpy[0] == pytest.approx(0.0)
    np.testing.assert_allclose(
        Rotation.from_euler("xyz", rpy).as_matrix(), rotation(pose).as_matrix(), atol=1e-7
    )


def test_wrong_numbers_of_numbers_are_refused() -> None:
    assert "p2 must be [x, y, z, rx, ry, rz], got 2" in refusal("poseAdd", p1=POSES[0], p2=[1.0, 2.0])
    assert "rpy must have 3 numbers, got 4" in refusal("rpyToQuaternion", rpy=[0.0] * 4)
    assert "[w, x, y, z] with a length of 1e-09 to 1e+09" in refusal("quaternionToRpy", quat=[0.0] * 4)
    assert "[w, x, y, z] with a length of 1e-09 to 1e+09" in refusal("quaternionToRpy", quat=[1e200] * 4)
    assert "quat must be" in refusal("quaternionToRpy", quat=[1.0])


def test_alpha_has_bounds() -> None:
    answer = asyncio.run(
        call(cast(Any, None), "Math", "interpolatePose", {"p1": [0] * 6, "p2": [1] * 6, "alpha": 1e300})
    )
    assert (answer.code, answer.message) == (Code.LIMIT, "alpha must be from -1000 to 1000, got 1e+300")
