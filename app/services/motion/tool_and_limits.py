"""What a user may set of a robot while it runs."""

from __future__ import annotations

from dataclasses import replace

from cobot.motions.requests import Envelope
from cobot.robot.description import RobotDescription
from cobot.types import Pose


class RobotSettings:
    """Limits of one robot's vendor services, back to the configuration's with each start; and its flange.

    Attributes:
        envelope: what the motion queue plans with. Moves that are planned already keep theirs.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self.envelope = Envelope(robot.limits, robot.cartesian_limits)
        self._robot = robot

    def restore_limits(self) -> None:
        """Go back to the joint limits of the configuration."""
        self.envelope = replace(self.envelope, limits=self._robot.limits)

    def flange(self, tcp: Pose) -> Pose:
        """The flange, for a pose of the TCP."""
        return tcp @ self._flange

    def tcp_of_flange(self, flange: Pose) -> Pose:
        """The TCP, for a pose of the flange."""
        return flange @ self._flange.inverse()

    @property
    def _flange(self) -> Pose:
        return self._robot.model.flange_in_tcp()
