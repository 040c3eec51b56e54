"""The limits of a session: those of the settings, and less by hand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cobot.types import CartesianLimits, JointLimits
from rtloop.backends.agreement import REDUCED_M_S

LEAST_SHARE = 0.01
"""Of the joints' speed: with less no session is begun."""
POSES_SHARE, FORCE_SHARE = 0.8, 0.4
"""Of the reduced speed, that poses are followed with, and that force control moves with across them: both,
and what the arm catches up with, are within it."""


@dataclass(frozen=True, slots=True)
class SessionLimits:
    """Attributes:
    joints: of a stream of joint positions and of servo points.
    torques: of the motion that streamed torques make.
    tcp: of streamed poses.
    force_m_s: the fastest that force control moves along an axis.
    """

    joints: JointLimits
    torques: JointLimits
    tcp: CartesianLimits
    force_m_s: float = np.inf

    def in_t1(self, share: float) -> SessionLimits:
        """By hand. What streams joints goes with this share of the joints' speed, as planned motions do;
        poses go with the reduced speed of the TCP itself, and turn as much slower.
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
