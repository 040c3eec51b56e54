"""Math: poses in the form of `app.aubo.poses`, and quaternions [w, x, y, z]."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from app.aubo.poses import as_list, numbers_of, pose_of
from app.aubo.registry import service
from cobot.errors import InputError, LimitError
from cobot.robot import quaternion
from cobot.strict import shown
from cobot.types import Array, Pose

if TYPE_CHECKING:
    from app.robot_services import Services

LENGTHS = (1e-9, 1e9)
"""Minimum and maximum length of a quaternion before normalization. Longer and shorter quaternions are
rejected.
"""
MAX_ALPHA = 1000.0


@service("Math")
def pose_add(robot: Services, p1: list[float], p2: list[float]) -> list[float]:
    """The sum of the positions, and the product of the rotations, p1 times p2. To change frames, see
    poseTrans.

    Args:
        p1: [x, y, z, rx, ry, rz], m and rad.
        p2: the second pose, in the same form.

    Returns:
        the pose [x, y, z, rx, ry, rz], m and rad.
    """
    first, second = pose_of(p1, "p1"), pose_of(p2, "p2")
    turn = _turned(first) @ _turned(second)
    return numbers_of(Pose(first.position + second.position, turn.quaternion))


@service("Math")
def pose_sub(robot: Services, p1: list[float], p2: list[float]) -> list[float]:
    """The position of p1 minus the position of p2, and the rotation of p1 times the inverse rotation of p2.

    Args:
        p1: [x, y, z, rx, ry, rz], m and rad.
        p2: the second pose, in the same form.

    Returns:
        [x, y, z, rx, ry, rz], m and rad. poseAdd of this pose and p2 is p1.
    """
    first, second = pose_of(p1, "p1"), pose_of(p2, "p2")
    turn = _turned(first) @ _turned(second).inverse()
    return numbers_of(Pose(first.position - second.position, turn.quaternion))


@service("Math")
def pose_trans(robot: Services, pose_from: list[float], pose_from_to: list[float]) -> list[float]:
    """Transform a pose from the frame pose_from into the frame in which pose_from is given: the product of
    their matrices.

    Args:
        pose_from: [x, y, z, rx, ry, rz], m and rad.
        pose_from_to: a pose in the frame pose_from, in the same form.

    Returns:
        the pose [x, y, z, rx, ry, rz], m and rad.
    """
    return numbers_of(pose_of(pose_from, "pose_from") @ pose_of(pose_from_to, "pose_from_to"))


@service("Math")
def pose_inverse(robot: Services, pose: list[float]) -> list[float]:
    """The inverse of a pose: the pose of its reference frame in the frame of the pose.

    Args:
        pose: [x, y, z, rx, ry, rz], m and rad.

    Returns:
        the pose [x, y, z, rx, ry, rz], m and rad.
    """
    return numbers_of(pose_of(pose).inverse())


@service("Math")
def pose_distance(robot: Services, p1: list[float], p2: list[float]) -> float:
    """The distance between the positions of two poses. Their orientations are ignored.

    Args:
        p1: [x, y, z, rx, ry, rz], m and rad.
        p2: the second pose, in the same form.

    Returns:
        the distance, m.
    """
    return float(np.linalg.norm(pose_of(p2, "p2").position - pose_of(p1, "p1").position))


@service("Math")
def pose_angle_distance(robot: Services, p1: list[float], p2: list[float]) -> float:
    """The angle of the rotation between the orientations of two poses.

    Args:
        p1: [x, y, z, rx, ry, rz], m and rad.
        p2: the second pose, in the same form.

    Returns:
        the angle, rad, from 0 to π.
    """
    first, second = pose_of(p1, "p1"), pose_of(p2, "p2")
    return math.hypot(*quaternion.between(first.quaternion.tolist(), second.quaternion.tolist()))


@service("Math")
def interpolate_pose(robot: Services, p1: list[float], p2: list[float], alpha: float) -> list[float]:
    """A pose between two others: the position is interpolated linearly, and the orientation along the
    shortest rotation.

    Args:
        p1: [x, y, z, rx, ry, rz], m and rad.
        p2: the second pose, in the same form.
        alpha: 0 is p1, 1 is p2; other values extrapolate, from -1000 to 1000.

    Returns:
        the pose [x, y, z, rx, ry, rz], m and rad.
    """
    if abs(alpha) > MAX_ALPHA:
        raise LimitError(f"alpha must be from {-MAX_ALPHA:g} to {MAX_ALPHA:g}, got {alpha:g}")
    first, second = pose_of(p1, "p1"), pose_of(p2, "p2")
    turn = np.array(quaternion.between(first.quaternion.tolist(), second.quaternion.tolist()))
    turned = quaternion.product(quaternion.exp((alpha * turn).tolist()), first.quaternion.tolist())
    return numbers_of(Pose(first.position + alpha * (second.position - first.position), np.array(turned)))


@service("Math")
def rpy_to_quaternion(robot: Services, rpy: list[float]) -> list[float]:
    """Roll, pitch and yaw about the fixed axes x, y, z as a quaternion.

    Args:
        rpy: [rx, ry, rz], rad.

    Returns:
        [w, x, y, z], of length 1, w not negative.
    """
    turn = _turn(rpy)
    return as_list(turn if turn[0] >= 0.0 else -turn)


@service("Math")
def quaternion_to_rpy(robot: Services, quat: list[float]) -> list[float]:
    """A quaternion, of length 1 or not, as roll, pitch and yaw about the fixed axes x, y, z.

    Args:
        quat: [w, x, y, z].

    Returns:
        [rx, ry, rz], rad, ry from −π/2 to π/2. If ry is one of these bounds, rx is 0.
    """
    least, most = LENGTHS
    if len(quat) != 4 or not least <= math.hypot(*quat) <= most:
        raise InputError(
            f"quat must be [w, x, y, z] with a length of {least:g} to {most:g}, got {shown(quat)}"
        )
    return numbers_of(Pose(np.zeros(3), np.array(quat)))[3:]


@service("Math")
def rpy_to_rotation_vector(robot: Services, rpy: list[float]) -> list[float]:
    """Roll, pitch and yaw about the fixed axes x, y, z as a rotation vector: axis times angle.

    Args:
        rpy: [rx, ry, rz], rad.

    Returns:
        the rotation vector, rad, with a length of at most π.
    """
    return list(quaternion.log(_turn(rpy).tolist()))


@service("Math")
def rotation_vector_to_rpy(robot: Services, rotv: list[float]) -> list[float]:
    """A rotation vector (axis times angle) as roll, pitch and yaw about the fixed axes x, y, z.

    Args:
        rotv: the rotation vector, rad.

    Returns:
        [rx, ry, rz], rad, ry from −π/2 to π/2.
    """
    turn = quaternion.exp(_three(rotv, "rotv"))
    return numbers_of(Pose(np.zeros(3), np.array(turn)))[3:]


def _turned(pose: Pose) -> Pose:
    """Return the pose with its orientation but with the position 0."""
    nowhere: Array = np.zeros(3)
    return Pose(nowhere, pose.quaternion)


def _turn(rpy: list[float]) -> Array:
    return pose_of([0.0, 0.0, 0.0, *_three(rpy, "rpy")]).quaternion


def _three(values: list[float], name: str) -> list[float]:
    if len(values) != 3:
        raise InputError(f"{name} must have 3 numbers, got {len(values)}")
    return values
