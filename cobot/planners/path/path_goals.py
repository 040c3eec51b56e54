"""Goal poses of TCP paths, adapted to what an arm with few joints or free rotations can reach."""

from __future__ import annotations

from cobot.errors import UnreachableError
from cobot.motions.requests import MotionRequest
from cobot.planners.path.tcp_path import untwisted
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.types import Pose


def reachable(robot: RobotDescription, request: MotionRequest, before: Pose, goal: Pose) -> Pose:
    """The pose to use as the goal of a path from the pose `before`.

    An arm that reaches most poses only approximately goes to the reachable pose nearest to the goal, if that
    is within lin's tolerance. A free rotation is chosen so that the TCP turns the shorter way.
    """
    if robot.model.inverse_kinematics.lacking:
        try:
            joints = inverse(robot.model, goal, request.start, free=request.free_axes)
        except UnreachableError:  # planning the path reports the share at which it ends
            return untwisted(before, goal, request.free_axes)
        goal = robot.model.forward(joints)
    return untwisted(before, goal, request.free_axes)
