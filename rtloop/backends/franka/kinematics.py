"""The flange pose of a Franka, calculated from the published kinematics, or taken from the robot's state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cobot.robot import quaternion
from cobot.types import Array, Pose

LINKS = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
)
"""Denavit and Hartenberg's a, d and alpha in Craig's convention; source: Franka Control Interface."""
FLANGE_M = 0.107


def flange(joints: Sequence[float]) -> Array:
    """Calculate the flange pose in the base frame from the published kinematics. Shape: (4, 4)."""
    found = np.eye(4)
    for (a, d, alpha), angle in zip(LINKS, joints, strict=True):
        ca, sa, c, s = np.cos(alpha), np.sin(alpha), np.cos(angle), np.sin(angle)
        rows = [c, -s, 0.0, a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca]
        found = found @ np.array([*rows, [0.0, 0.0, 0.0, 1.0]])
    found[:3, 3] += FLANGE_M * found[:3, 2]
    return found


def told_flange(state: Any) -> Pose:
    """Return the flange pose in the base frame from a libfranka state. The end effector that is set in Desk
    is removed from the pose.
    """
    effector, in_flange = (np.array(each).reshape(4, 4, order="F") for each in (state.O_T_EE, state.F_T_EE))
    found = effector @ np.linalg.inv(in_flange)
    return Pose(found[:3, 3], np.array(quaternion.from_matrix(found[:3, :3].ravel().tolist())))
