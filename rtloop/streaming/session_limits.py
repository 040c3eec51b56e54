"""The limits of a session: those of the settings, and lower ones in T1."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cobot.types import CartesianLimits, JointLimits
from rtloop.backends.agreement import REDUCED_M_S

MIN_SHARE = 0.01
"""A session needs at least this share of the joints' speed."""
POSES_SHARE, FORCE_SHARE = 0.8, 0.4
"""Shares of the reduced speed for following poses, and for force control across them. Both together, with the
arm's catching up, stay within the reduced speed."""


@dataclass(frozen=True, slots=True)
class SessionLimits:
    """The limits for each kind of stream.

    Attributes:
        joints: for joint positions and servo points.
        torques: for the motion that streamed torques cause.
        tcp: for poses.
        force_m_s: maximum speed of force control along an axis.
    """

    joints: JointLimits
    torques: JointLimits
    tcp: CartesianLimits
    force_m_s: float = np.inf

    def in_t1(self, share: float) -> SessionLimits:
        """The limits in T1. Joint streams get this share of the joints' speed, as planned motions do. Pose
        streams get the reduced speed of the TCP, and turn more slowly by the same factor.
        """
        most = share * self.torques.max_velocity
        linear = min(self.tcp.max_linear_velocity, POSES_SHARE * REDUCED_M_S)
        angular = self.tcp.max_angular_velocity * linear / self.tcp.max_linear_velocity
        return SessionLimits(
            joints=replace(self.joints, max_velocity=np.minimum(self.joints.max_velocity, most)),
            torques=replace(self.torques, max_velocity=most),
            tcp=replace(self.tcp, max_linear_velocity=linear, max_angular_velocity=angular),
            force_m_s=FORCE_SHARE * REDUCED_M_S,
        )
