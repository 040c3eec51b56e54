"""Planner ompl: a path around obstacles by sampling. With constraints, all samples satisfy them."""

from __future__ import annotations

from cobot.motions.requests import MotionRequest
from cobot.planners.held import Held
from cobot.planners.search.constrained import plan_constrained
from cobot.planners.search.sampling import find_path
from cobot.planners.search.spline import smooth_motion
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array


def plan_ompl(robot: RobotDescription, request: MotionRequest, goals: Array) -> Trajectory:
    """A smooth motion around obstacles to one of the goals, shape (n, dof). The goals must be free of
    collisions.

    Raises:
        PlanningTimeout: no path was found within the request's time.
        CollisionError, PlanningError: the smoothed path touches something or violates a constraint.
    """
    if request.constraints is not None:
        held = Held(robot, request.constraints, request.start)
        return plan_constrained(robot, request, goals, held)
    return smooth_motion(robot, find_path(robot, request, goals), request.scaled_limits(robot))
