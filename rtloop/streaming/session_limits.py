"""The limits of a session: the limits from the settings, and lower ones in T1."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cobot.types import CartesianLimits, JointLimits
from rtloop.backends.agreement import REDUCED_M_S

MIN_SHARE = 0.01
"""Minimum permitted share of the joints' speed for a session."""
POSES_SHARE, FORCE_SHARE = 0.8, 0.4
"""Shares of the reduced speed for following poses and for additional force control. Even if both act at the
same time as the correction of deviations, the TCP keeps within the reduced speed.
"""


@dataclass(frozen=True, slots=True)
class SessionLimits:
    """The limits for each kind of stream.

    Attributes:
        joints: limits for joint positions and servo points.
        torques: limits for the motion that streamed torques cause.
        tcp: limits for poses.
        force_m_s: maximum speed of force control along an axis.
    """

    joints: JointLimits
    torques: JointLimits
    tcp: CartesianLimits
    force_m_s: float = np.inf

    def in_t1(self, share: float) -> SessionLimits:
        """Return the limits in T1. The joint velocities of streams are limited to `share` of their maximum,
        as for planned motions. Pose streams are limited to the reduced TCP speed; their angular speed is
        reduced by the same factor.
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
