"""TCP paths without timing: poses over a share of the path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.types import FREE_AXES, Array, FreeAxis, Pose

PLACES = 24
MIN_RAD = 1e-12
UNIT_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class TcpPath:
    """A path of the TCP over u in [0, 1].

    Attributes:
        name: planner name, for messages.
        poses: function from shares u, shape (n,), to the poses in the base frame, shape (n, 7). Each row is a
            position x, y, z, m, and a quaternion w, x, y, z.
        length_m, angle_rad: TCP distance and rotation.
        places: number of even shares at which the joints are first solved.
        free: rotations of the TCP that the path leaves free: none, one or all three.
    """

    name: str
    poses: Callable[[Array], Array]
    length_m: float
    angle_rad: float
    places: int = PLACES
    free: tuple[FreeAxis, ...] = ()

    def pose_at(self, share: float) -> Pose:
        """The pose at one share of the path."""
        row = self.poses(np.array([share]))[0]
        return Pose(row[:3], row[3:])


def turn_between(start: Pose, goal: Pose) -> Array:
    """The rotation vector of the shorter rotation from the start orientation to the goal orientation. Shape:
    (3,), in rad.
    """
    return np.array(quaternion.between(start.quaternion.tolist(), goal.quaternion.tolist()))


def least_turn(robot: RobotDescription) -> float:
    """The smallest rotation that is planned, rad. It is smaller for an arm with fewer than six degrees of
    freedom, because its position and its orientation depend on each other.
    """
    return MIN_RAD if robot.model.inverse_kinematics.lacking else quaternion.SMALL_RAD


def turned(start: Array, turn: Array, shares: Array, least_rad: float = quaternion.SMALL_RAD) -> Array:
    """The orientations that are reached after the given shares of a rotation, as quaternions, shape (n, 4).
    The rotation begins at the orientation `start` and is given by its rotation vector (slerp).
    """
    angle = math.sqrt(turn @ turn)
    if angle < least_rad:
        return start[None].repeat(len(shares), axis=0)
    # Both terms of the quaternion product are linear in the cosine and the sine of the half angle.
    across = np.array(quaternion.product((0.0, *(turn / angle).tolist()), start.tolist()))
    half = 0.5 * angle * shares
    return np.asarray(np.cos(half)[:, None] * start + np.sin(half)[:, None] * across)


def angles_between(rows: Array, others: Array, free: tuple[FreeAxis, ...] = ()) -> Array:
    """The angles between pairs of orientations. Free rotations are ignored. Shape: (n,), in rad.

    Args:
        rows, others: the orientations, quaternions of shape (n, 4).
        free: the axes of free rotations.
    """
    if len(free) == len(FREE_AXES):
        return np.zeros(len(rows))
    if free:
        return np.array([_tilt(row, other, free[0])[1] for row, other in zip(rows, others, strict=True)])
    apart, around = rows - others, rows + others
    square = np.minimum(np.einsum("ij,ij->i", apart, apart), np.einsum("ij,ij->i", around, around))
    return np.asarray(4.0 * np.arcsin(np.minimum(0.5 * np.sqrt(square), 1.0)))


def with_shortest_turn(start: Pose, goal: Pose, free: tuple[FreeAxis, ...]) -> Pose:
    """The goal, with a free rotation that makes the TCP turn the shorter way from the start."""
    if len(free) == len(FREE_AXES):
        return Pose(goal.position, start.quaternion)
    normal, angle = _tilt(start.quaternion, goal.quaternion, free[0])
    turn = quaternion.exp((angle * normal).tolist())
    return Pose(goal.position, np.array(quaternion.product(turn, start.quaternion.tolist())))


def _tilt(start: Array, goal: Array, axis: FreeAxis) -> tuple[Array, float]:
    """The shorter rotation that aligns one axis of the TCP with its goal: its direction, shape (3,), and its
    angle, rad.
    """
    index = FREE_AXES.index(axis)
    before, after = _axis(start, index), _axis(goal, index)
    normal = np.cross(before, after)
    sine = float(np.linalg.norm(normal))
    angle = math.atan2(sine, float(before @ after))
    if sine > MIN_RAD:
        return normal / sine, angle
    return _axis(start, (index + 1) % 3), angle


def _axis(turn: Array, index: int) -> Array:
    """The axis `index` of a rotated frame, given the frame's quaternion. The result is in the base frame,
    shape (3,).
    """
    return np.array(quaternion.rotated(turn.tolist(), UNIT_AXES[index]))
