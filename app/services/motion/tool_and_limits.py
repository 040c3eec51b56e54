"""What a user may set of a robot while it runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cobot.motions.requests import Envelope
from cobot.robot import quaternion
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
        return compose(tcp, self._flange)

    def tcp_of_flange(self, flange: Pose) -> Pose:
        """The TCP, for a pose of the flange."""
        return compose(flange, inverted(self._flange))

    @property
    def _flange(self) -> Pose:
        flange = self._robot.model.flange_in_tcp()
        return Pose(flange[:3], flange[3:])


def compose(first: Pose, second: Pose) -> Pose:
    """The second pose, given in the frame of the first one, in the first one's own frame."""
    position = first.position + quaternion.rotated(first.quaternion.tolist(), second.position.tolist())
    turn = quaternion.product(first.quaternion.tolist(), second.quaternion.tolist())
    return Pose(position, np.array(turn))


def inverted(pose: Pose) -> Pose:
    """The frame in which a pose is given, in the pose's own frame."""
    back = quaternion.conjugate(pose.quaternion.tolist())
    return Pose(-np.array(quaternion.rotated(back, pose.position.tolist())), np.array(back))
