"""A straight line of the TCP, along which its orientation turns evenly from start to goal."""

from __future__ import annotations

import numpy as np

from cobot.motions.requests import MotionRequest
from cobot.planners.path.cartesian import follow
from cobot.planners.path.ends import end_of, reachable
from cobot.planners.path.tcp_path import TcpPath, least_turn, turn_between, turned
from cobot.robot.description import RobotDescription
from cobot.robot.quaternion import SMALL_RAD
from cobot.trajectory import Trajectory
from cobot.types import Array, Pose


def plan_lin(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """The straight line from the current pose of the TCP to the goal pose; None if the TCP is already at the
    goal.

    Raises:
        PlanningError: see `follow` and `end_of`.
    """
    assert isinstance(request.goal, Pose)
    start = robot.model.forward(request.start)
    goal, end = end_of(robot, request, reachable(robot, request, start, request.goal))
    return follow(robot, request, straight_line(start, goal, least_turn(robot)), end)


def straight_line(start: Pose, goal: Pose, least_rad: float = SMALL_RAD) -> TcpPath:
    """The straight path of the TCP from one pose to another."""
    across, turn = goal.position - start.position, turn_between(start, goal)

    def poses(shares: Array) -> Array:
        rows = np.empty((len(shares), 7))
        rows[:, :3] = start.position + shares[:, None] * across
        rows[:, 3:] = turned(start.quaternion, turn, shares, least_rad)
        return rows

    return TcpPath("lin", poses, float(np.linalg.norm(across)), float(np.linalg.norm(turn)))
