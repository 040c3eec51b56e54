"""Where the TCP leads on a path, without when: poses over a share of the path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cobot.robot import quaternion
from cobot.types import Array, Pose

PLACES = 24


@dataclass(frozen=True, slots=True)
class TcpPath:
    """A path of the TCP over u in [0, 1].

    Attributes:
        name: of the planner, for messages.
        poses: of shares u, shape (n,), the poses in the base frame, shape (n, 7): x, y, z (m), w, x, y, z.
        length_m, angle_rad: how far the TCP travels and turns.
        places: at so many even shares the joints are looked for first.
    """

    name: str
    poses: Callable[[Array], Array]
    length_m: float
    angle_rad: float
    places: int = PLACES

    def pose_at(self, share: float) -> Pose:
        """The pose at one share."""
        row = self.poses(np.array([share]))[0]
        return Pose(row[:3], row[3:])


def turn_between(start: Pose, goal: Pose) -> Array:
    """The rotation vector, shape (3,), rad, that takes one orientation to the other the short way."""
    return np.array(quaternion.between(start.quaternion.tolist(), goal.quaternion.tolist()))


def turned(start: Array, turn: Array, shares: Array) -> Array:
    """The quaternions, shape (n, 4), after shares of a turn (a rotation vector) from `start`: slerp."""
    angle = math.sqrt(turn @ turn)
    if angle < quaternion.SMALL_RAD:
        return start[None].repeat(len(shares), axis=0)
    # Both terms of the quaternion product are linear in the cosine and the sine of the half angle.
    across = np.array(quaternion.product((0.0, *(turn / angle).tolist()), start.tolist()))
    half = 0.5 * angle * shares
    return np.asarray(np.cos(half)[:, None] * start + np.sin(half)[:, None] * across)


def angles_between(rows: Array, others: Array) -> Array:
    """Rad, shape (n,), between orientations, quaternions of shape (n, 4)."""
    apart, around = rows - others, rows + others
    square = np.minimum(np.einsum("ij,ij->i", apart, apart), np.einsum("ij,ij->i", around, around))
    return np.asarray(4.0 * np.arcsin(np.minimum(0.5 * np.sqrt(square), 1.0)))
