"""Checks that use the arm's model: whether the device reports the same pose, and whether the arm keeps the
reduced speed in T1.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from cobot.foreign import fixed
from cobot.robot import quaternion
from cobot.robot.model import RobotModel
from cobot.robot.tool import BARE, Tool
from cobot.types import Array, Numbers7, Pose
from rtloop.results import ACCEPTED, Accepted, Rejected

OFF_M, OFF_RAD = 0.005, 0.02
"""Allowed difference between the model's pose and the device's pose, m and rad. It is larger than the
calibration error of an arm, and smaller than the error that a wrong axis or link causes.
"""
REDUCED_M_S = 0.25
"""Maximum speed of the TCP in manual operation, m/s: the reduced speed of ISO 10218-1."""
REDUCED_SHARE = 0.9
"""Maximum speed of a motion as a share of the reduced speed."""
POSES = 500


def check_agreement(model: RobotModel, joints: Array, flange: Pose) -> Accepted | Rejected:
    """Check that the model and the device describe the same arm.

    Args:
        joints: joint positions measured by the device, shape (dof,), rad.
        flange: flange pose that the device reports for these joint positions, in the device's base frame.
    """
    ours = model.forward(joints) @ model.flange_in_tcp()
    off_m = float(np.linalg.norm(flange.position - ours.position))
    off_rad = float(np.linalg.norm(quaternion.between(ours.quaternion.tolist(), flange.quaternion.tolist())))
    if off_m <= OFF_M and off_rad <= OFF_RAD:
        return ACCEPTED
    return Rejected(
        f"the device reports its flange at {_said(flange)} m, but for the same joints the model of "
        f"robot.model has it at {_said(ours)} m: {fixed(1e3 * off_m, 1)} mm and "
        f"{np.degrees(off_rad):.1f} degrees apart, allowed: {1e3 * OFF_M:g} mm and "
        f"{np.degrees(OFF_RAD):.1f} degrees. The arm, its zero position or its base differ; "
        "robot.backend.check_pose: false disables this check"
    )


class ReducedSpeed:
    """Enforces the reduced speed of operation mode T1 at the fastest point. This is the TCP of the model, or
    the TCP of the tool, which rotates about the model's TCP.

    Attributes:
        share: share of the joints' maximum speeds at which that point moves at the reduced speed; 1 until the
            model is known.
    """

    def __init__(self) -> None:
        self.share = 1.0
        self._tool = BARE
        self._bare: tuple[tuple[float, float], Numbers7] | None = None  # speeds and pose of the model's TCP

    def set_model(self, model: RobotModel) -> None:
        """Set the arm's model, which also defines the maximum speeds of the joints."""
        self._bare = _fastest(model), model.file_tcp_in_flange
        self.set_tool(self._tool)

    def set_tool(self, tool: Tool) -> None:
        """Set the mounted tool."""
        self._tool = tool
        if self._bare is not None:
            (moves_m_s, turns_rad_s), tcp = self._bare
            lever_m = math.dist((tool.tcp or tcp)[:3], tcp[:3])
            self.share = min(1.0, REDUCED_SHARE * REDUCED_M_S / (moves_m_s + turns_rad_s * lever_m))


def _fastest(model: RobotModel) -> tuple[float, float]:
    """Return the maximum linear and angular speed of the TCP in any posture with the joints at full speed,
    m/s and rad/s.
    """
    limits = model.limits
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=limits.dof))) * limits.max_velocity
    low = np.maximum(limits.min_position, -np.pi)
    high = np.minimum(limits.max_position, np.pi)
    places = [*np.random.default_rng(0).uniform(low, high, (POSES, limits.dof)), np.clip(0.0, low, high)]
    jacobians = [model.jacobian(q) for q in places]
    moves, turns = (
        max(float(np.linalg.norm(corners @ each[rows].T, axis=1).max()) for each in jacobians)
        for rows in (slice(3), slice(3, 6))
    )
    return moves, turns


def _said(pose: Pose) -> str:
    return f"({', '.join(fixed(float(value), 3) for value in pose.position)})"
