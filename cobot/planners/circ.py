"""An arc of the TCP through a point, its orientation turning evenly from start to goal."""

from __future__ import annotations

import numpy as np

from cobot.errors import InputError, PlanningError
from cobot.motions.requests import MotionRequest, check_via
from cobot.planners.cartesian import follow
from cobot.planners.tcp_path import TcpPath, turn_between, turned
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, Pose

NEAREST_POINTS_M = 1e-3
SMALLEST_SINE = 1e-3
"""Three points are as good as on a line when the sine of the angle at `via` is smaller."""


def plan_circ(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """The arc from the present position of the TCP through `via` to the goal pose.

    Raises:
        InputError: no `via`, or the goal is not a pose.
        PlanningError: the three points define no circle, or from `follow`.
    """
    check_via(request.planner, request.via)
    if not isinstance(request.goal, Pose):
        raise InputError("circ needs a pose as its goal and via, a point (x, y, z) on the arc")
    assert request.via is not None
    return follow(robot, request, arc(robot.model.forward(request.start), request.via, request.goal))


def arc(start: Pose, via: Array, goal: Pose) -> TcpPath:
    """The path itself.

    Raises:
        PlanningError: two of the points coincide, or all three are on one line.
    """
    to_via, to_goal = via - start.position, goal.position - start.position
    for name, length in (
        ("via and the start", np.linalg.norm(to_via)),
        ("the goal and the start", np.linalg.norm(to_goal)),
        ("via and the goal", np.linalg.norm(via - goal.position)),
    ):
        if length < NEAREST_POINTS_M:
            raise PlanningError(
                f"circ: {name} are {1e3 * length:.2f} mm apart, an arc needs three distinct points"
            )
    normal = np.cross(to_via, to_goal)
    area = float(np.linalg.norm(normal))
    if area < SMALLEST_SINE * np.linalg.norm(to_via) * np.linalg.norm(via - goal.position):
        raise PlanningError("circ: start, via and goal are on one line; use lin")
    # Circumcentre of a triangle with one corner in the origin.
    towards = np.cross(normal, to_via) * (to_goal @ to_goal) + np.cross(to_goal, normal) * (to_via @ to_via)
    radius = towards / (2.0 * area**2)
    centre = start.position + radius
    axis = normal / area
    x, y = -radius, np.cross(axis, -radius)
    angle = float(np.arctan2((goal.position - centre) @ y, (goal.position - centre) @ x) % (2.0 * np.pi))
    turn = turn_between(start, goal)

    def poses(shares: Array) -> Array:
        angles = angle * shares[:, None]
        positions = centre + np.cos(angles) * x + np.sin(angles) * y
        return np.concatenate([positions, turned(start.quaternion, turn, shares)], axis=1)

    return TcpPath("circ", poses, angle * float(np.linalg.norm(radius)), float(np.linalg.norm(turn)))
