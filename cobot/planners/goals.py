"""The joint angles at which a motion may end."""

from __future__ import annotations

import numpy as np

from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import by_distance, inverse, inverse_all
from cobot.robot.limits import check_positions
from cobot.types import Array, Pose

SPREAD = 8
"""Number of configurations that are checked in each interval of the arm angle."""
ALREADY_THERE_RAD = 1e-6


def is_there(start: Array, goal: Array) -> bool:
    """Whether the arm is already at the goal."""
    return bool(np.abs(goal - start).max() < ALREADY_THERE_RAD)


def joint_goals(robot: RobotDescription, request: MotionRequest) -> Array:
    """All known collision-free goals, sorted by their distance from the start. Shape: (n, dof), in rad.

    Raises:
        LimitError: joint angles beyond the limits.
        UnreachableError: no joint angles reach the pose.
        CollisionError: all goals are in collision; the message names what the arm touches at the nearest one.
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
    """More collision-free configurations at a pose, shape (n, dof). There may be none. A higher `number`
    returns more.

    An arm with more joints than the pose needs has infinitely many configurations at it, and possibly no
    collision-free path to the known ones.
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
    """The collision-free joint angles nearest to the start, shape (dof,). Raises the same errors as
    `joint_goals`.
    """
    free = request.free_axes
    if isinstance(request.goal, Pose) and (free or not _at(robot, request.start, request.goal)):
        joints = inverse(robot.model, request.goal, request.start, random_seed=request.seed, free=free)
        if robot.collision.is_free(joints):
            return joints
    return np.asarray(joint_goals(robot, request)[0])


def _configurations(robot: RobotDescription, pose: Pose, request: MotionRequest) -> Array:
    """The solutions of the inverse kinematics, sorted by their distance from the start."""
    model, seed, free = robot.model, request.seed, request.free_axes
    found = [inverse(model, pose, request.start, random_seed=seed, free=free)]
    found += inverse_all(model, pose, request.start, spread=SPREAD, random_seed=seed, free=free)
    return by_distance(np.array(found), request.start)


def _at(robot: RobotDescription, joints: Array, pose: Pose) -> bool:
    here = robot.model.forward(joints)
    same_place = np.linalg.norm(here.position - pose.position) < 1e-7
    return bool(same_place and 1.0 - abs(here.quaternion @ pose.quaternion) < 1e-14)
