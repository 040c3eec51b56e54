"""Comparison of the controller's base frame with the base frame of the arm's model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cobot.orientations import product
from cobot.robot.model import RobotModel
from cobot.types import Array, Pose
from rtloop.backends.agreement import check_agreement
from rtloop.results import ACCEPTED, Accepted, Rejected

HALF_TURN = (0.0, 0.0, 0.0, 1.0)
"""Quaternion (w, x, y, z) of the rotation between the controller's base frame and `base_link` in the
manufacturer's robot descriptions.
"""


class BaseFrame:
    """The controller's base frame, which may be rotated by half a turn about z relative to the model's. The
    first check determines whether it is.
    """

    def __init__(self) -> None:
        self._is_turned: bool | None = None  # None: unknown

    def check(self, model: RobotModel, data: Mapping[str, Any]) -> Accepted | Rejected:
        """Check that the controller reports the same flange pose as the model.

        Args:
            data: the values of an RTDE package.
        """
        pose = data.get("actual_TCP_pose")
        if pose is None or not np.isfinite(pose).all():
            return ACCEPTED
        joints = np.array(data["actual_q"])
        flange = Pose(np.array(pose[:3]), _from_rotation_vector(pose[3:]))
        result: Accepted | Rejected = ACCEPTED
        for is_turned in (False, True):
            found = _half_turned(flange) if is_turned else flange
            result = check_agreement(model, joints, found)
            if result is ACCEPTED:
                self._is_turned = is_turned
                return result
        return result

    def wrench_in_model(self, wrench: tuple[float, ...]) -> Array:
        """Convert a wrench from the controller to the axes of the model's base."""
        found = np.array(wrench)
        if self._is_turned:
            found[[0, 1, 3, 4]] *= -1.0
        return found


def _from_rotation_vector(turn: tuple[float, ...]) -> Array:
    """Convert a rotation vector, rad, to a quaternion (w, x, y, z)."""
    vector = np.array(turn)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    return np.array([math.cos(angle / 2.0), *(math.sin(angle / 2.0) / angle * vector)])


def _half_turned(pose: Pose) -> Pose:
    """Convert a pose to a base frame that is rotated by half a turn about z."""
    x, y, z = pose.position
    return Pose(np.array([-x, -y, z]), np.array(product(HALF_TURN, pose.quaternion.tolist())))
