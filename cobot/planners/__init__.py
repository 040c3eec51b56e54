"""Planners: pure functions from a robot and a request to a `Trajectory`.

None of them falls back on another one: what a planner cannot do is an error that says so.
"""

from __future__ import annotations

import numpy as np

from cobot.errors import LimitError, PlanningError
from cobot.motions.requests import MotionRequest, WaypointRequest, check_synchronization, check_via
from cobot.planners.checks import is_there, validate
from cobot.planners.chomp import plan_chomp
from cobot.planners.circ import plan_circ
from cobot.planners.lin import plan_lin
from cobot.planners.ptp import plan_ptp
from cobot.planners.waypoints import plan_waypoints
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse, inverse_all
from cobot.robot.limits import check_positions
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose

__all__ = ["MotionRequest", "WaypointRequest", "plan", "plan_waypoints"]


GOALS_OF_AN_INTERVAL = 8
"""Of a pose whose nearest joints touch something, so many are looked at in each interval of the arm angle."""


def _plan_ompl(robot: RobotDescription, request: MotionRequest, goal: Array) -> Trajectory:
    """Imports OMPL when it is used: the service, which leaves planning to its workers, needs none of it."""
    from cobot.planners.sampling import plan_ompl

    return plan_ompl(robot, request, goal)


JOINT_PLANNERS = {PlannerName.PTP: plan_ptp, PlannerName.OMPL: _plan_ompl, PlannerName.CHOMP: plan_chomp}
PATH_PLANNERS = {PlannerName.LIN: plan_lin, PlannerName.CIRC: plan_circ}


def plan(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """A validated motion from rest to rest, or None when the arm is already there.

    Raises:
        InputError: a goal beyond the limits, or fields that this planner does not take.
        PlanningError: there is no such motion, or this planner does not find one.
    """
    robot.collision.check_position(request.start, "the start")
    check_via(request.planner, request.via)
    check_synchronization(request.planner, request.synchronization)
    if request.planner in PATH_PLANNERS:
        trajectory = PATH_PLANNERS[request.planner](robot, request)
    else:
        goal = _joint_goal(robot, request)
        trajectory = (
            None if is_there(request.start, goal) else JOINT_PLANNERS[request.planner](robot, request, goal)
        )
    if trajectory is not None:
        try:
            validate(robot, trajectory, request.scaled_limits(robot))
        except LimitError as exc:
            raise PlanningError(f"{request.planner}: {exc}") from exc
    return trajectory


def _joint_goal(robot: RobotDescription, request: MotionRequest) -> Array:
    if isinstance(request.goal, Pose):
        if _at(robot, request.start, request.goal):
            return request.start
        goal = _free_goal(robot, request.goal, request)
    else:
        goal = request.goal
        check_positions(robot.limits, goal)
    robot.collision.check_position(goal, "the goal")
    return goal


def _free_goal(robot: RobotDescription, pose: Pose, request: MotionRequest) -> Array:
    """The nearest joints at a pose that touch nothing; if there are none, the nearest ones."""
    nearest = inverse(robot.model, pose, request.start, random_seed=request.seed)
    if robot.collision.is_free(nearest):
        return nearest
    every = inverse_all(
        robot.model, pose, request.start, spread=GOALS_OF_AN_INTERVAL, random_seed=request.seed
    )
    return next((joints for joints in every if robot.collision.is_free(joints)), nearest)


def _at(robot: RobotDescription, joints: Array, pose: Pose) -> bool:
    here = robot.model.forward(joints)
    same_place = np.linalg.norm(here.position - pose.position) < 1e-7
    return bool(same_place and 1.0 - abs(here.quaternion @ pose.quaternion) < 1e-14)
