"""The poses that a path of the TCP leads to, as an arm with few joints or free rotations reaches them."""

from __future__ import annotations

from cobot.errors import UnreachableError
from cobot.motions.requests import MotionRequest
from cobot.planners.path.tcp_path import untwisted
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.types import Pose


def reachable(robot: RobotDescription, request: MotionRequest, before: Pose, goal: Pose) -> Pose:
    """The pose that counts for a goal to which a path leads from the pose `before`.

    An arm that comes near most poses only goes to the one next to the goal, if that is within lin's
    tolerance. A rotation that is free is chosen so that the TCP turns the short way.
    """
    if robot.model.inverse_kinematics.lacking:
        try:
            joints = inverse(robot.model, goal, request.start, free=request.free_axes)
        except UnreachableError:  # The path says at which share it ends.
            return untwisted(before, goal, request.free_axes)
        goal = robot.model.forward(joints)
    return untwisted(before, goal, request.free_axes)
