"""Settings of a robot that a user may change while the service is running."""

from __future__ import annotations

from dataclasses import replace

from cobot.motions.requests import Envelope
from cobot.robot.description import RobotDescription
from cobot.types import Pose


class RobotSettings:
    """Limits for one robot's vendor services, and conversions between flange and TCP. A restart resets the
    limits to the configured ones.

    Attributes:
        envelope: the limits with which the motion queue plans. Moves that are already planned keep their
            limits.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self.envelope = Envelope(robot.limits, robot.cartesian_limits)
        self._robot = robot

    def restore_limits(self) -> None:
        """Restore the joint limits from the configuration."""
        self.envelope = replace(self.envelope, limits=self._robot.limits)

    def flange(self, tcp: Pose) -> Pose:
        """Convert a TCP pose to the flange pose."""
        return tcp @ self._flange

    def tcp_of_flange(self, flange: Pose) -> Pose:
        """Convert a flange pose to the TCP pose."""
        return flange @ self._flange.inverse()

    @property
    def _flange(self) -> Pose:
        return self._robot.model.flange_in_tcp()
