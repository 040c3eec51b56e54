"""The joint angles at which a motion may end."""

from __future__ import annotations

import numpy as np

from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse, inverse_all
from cobot.robot.limits import check_positions
from cobot.types import Array, Pose

SPREAD = 8
"""So many are looked at in each interval of the arm angle."""


def joint_goals(robot: RobotDescription, request: MotionRequest) -> Array:
    """All that are known, shape (n, dof), rad, free of collisions, the nearest to the start first.

    Raises:
        LimitError: joint angles beyond the limits.
        UnreachableError: no joint angles lead to the pose.
        CollisionError: none of them is free; with what the nearest one touches.
    """
    goal = request.goal
    if not isinstance(goal, Pose):
        check_positions(robot.limits, goal, share=1.0)
        robot.collision.check_position(goal, "the goal", 1.0)
        return np.array([goal], dtype=np.float64)
    if not request.free_axes and _at(robot, request.start, goal):
        return np.array([request.start])
    found = _configurations(robot, goal, request)
    free = found[robot.collision.clearance.are_free(found)]
    if len(free) == 0:
        several = f", as in the other {len(found) - 1} configurations," if len(found) > 1 else ""
        robot.collision.check_position(found[0], f"the goal in the nearest configuration{several}", 1.0)
    return free


def more_goals(robot: RobotDescription, request: MotionRequest, number: int) -> Array:
    """Further free configurations of a pose, shape (n, dof), the more the higher the number; maybe none.

    An arm with more joints than the pose needs has configurations without end, and those that are known may
    all be where no free way leads.
    """
    assert isinstance(request.goal, Pose)
    seed = request.seed + 1009 * number
    found = inverse_all(
        robot.model,
        request.goal,
        request.start,
        spread=SPREAD * (number + 1),
        random_seed=seed,
        free=request.free_axes,
    )
    return np.array(found)[robot.collision.clearance.are_free(np.array(found))]


def nearest_goal(robot: RobotDescription, request: MotionRequest) -> Array:
    """The nearest free joint angles alone, shape (dof,); raises as `joint_goals`."""
    free = request.free_axes
    if isinstance(request.goal, Pose) and (free or not _at(robot, request.start, request.goal)):
        joints = inverse(robot.model, request.goal, request.start, random_seed=request.seed, free=free)
        if robot.collision.is_free(joints):
            return joints
    return np.asarray(joint_goals(robot, request)[0])


def _configurations(robot: RobotDescription, pose: Pose, request: MotionRequest) -> Array:
    """Of the inverse kinematics, the nearest to the start first."""
    model, seed, free = robot.model, request.seed, request.free_axes
    found = [inverse(model, pose, request.start, random_seed=seed, free=free)]
    found += inverse_all(model, pose, request.start, spread=SPREAD, random_seed=seed, free=free)
    return np.array(sorted(found, key=lambda joints: float(np.linalg.norm(joints - request.start))))


def _at(robot: RobotDescription, joints: Array, pose: Pose) -> bool:
    here = robot.model.forward(joints)
    same_place = np.linalg.norm(here.position - pose.position) < 1e-7
    return bool(same_place and 1.0 - abs(here.quaternion @ pose.quaternion) < 1e-14)
