"""The end of a TCP path: a pose that the arm can reach, and the joints there.

These joints may be those at the start of the path, given joints, or any joints.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from cobot.errors import PlanningError, UnreachableError
from cobot.findings import Finding
from cobot.motions.requests import Arc, MotionRequest
from cobot.planners.path.cartesian import follow
from cobot.planners.path.joint_path import MAX_DEVIATION_M, MAX_DEVIATION_RAD
from cobot.planners.path.tcp_path import TcpPath, angles_between, with_shortest_turn
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import apart, inverse
from cobot.trajectory import Notice, Trajectory
from cobot.types import Array, Pose

CLOSED_M, CLOSED_RAD = 2.0 * MAX_DEVIATION_M, 2.0 * MAX_DEVIATION_RAD
"""A path that ends this close to the TCP pose that belongs to the end joints is changed to end exactly at
that pose, because the client may have rounded its pose to four digits.
"""
ALLOWED = f"allowed: {1e3 * CLOSED_M:g} mm and {np.degrees(CLOSED_RAD):g} degrees"


def reachable(robot: RobotDescription, request: MotionRequest, before: Pose, goal: Pose) -> Pose:
    """The pose to use as the goal of a path from the pose `before`.

    An arm that reaches most poses only approximately goes to the reachable pose nearest to the goal, if that
    is within lin's tolerance. A free rotation is chosen so that the TCP turns the shorter way.
    """
    if robot.model.inverse_kinematics.lacking:
        with suppress(UnreachableError):  # planning the path reports the share at which it ends
            goal = robot.model.forward(inverse(robot.model, goal, request.start, free=request.free_axes))
    return with_shortest_turn(before, goal, request.free_axes) if request.free_axes else goal


def end_of(robot: RobotDescription, request: MotionRequest, goal: Pose) -> tuple[Pose, Array | None]:
    """The end of a path to this pose, and the required joint positions there, shape (dof,). They are None if
    any joint positions are allowed.

    The path ends exactly at the TCP pose for these joints.

    Raises:
        PlanningError: the TCP is not at the pose with these joints; reports the distance.
    """
    if request.end_joints is not None:
        away = _away(robot.model.forward(request.end_joints), goal, request)
        _require(
            *away,
            f"end_joints: their pose is {apart(*away)} from the goal, {ALLOWED}; give joints "
            "with which the TCP is there",
        )
        return robot.model.forward(request.end_joints), request.end_joints
    if request.cyclic:
        away = _away(robot.model.forward(request.start), goal, request)
        _require(
            *away,
            f"cyclic: the path of {request.planner} ends {apart(*away)} from where it begins, {ALLOWED}; "
            "lead it back to its start, or give end_joints for the way back",
        )
        return robot.model.forward(request.start), request.start
    return goal, None


def follow_or_relax(
    robot: RobotDescription, request: MotionRequest, path: TcpPath, end: Array, required: bool
) -> Trajectory | None:
    """The result of `follow`. If the motion cannot end in the end joints and these are not required, it ends
    in different joints.
    """
    if required:
        return follow(robot, request, path, end)
    try:
        motion = follow(robot, request, path, end)
        if motion is not None:
            robot.collision.check_trajectory(motion)
    except PlanningError as exc:
        motion = follow(robot, request, path)
        if motion is not None:
            note = f"the motion does not end in the joints in which it began: {exc}"
            motion = replace(motion, note=note, notices=(Notice("end_joints", {}),))
    return motion


def full_turns(start: Pose, arc: Arc | None) -> float | None:
    """If an arc makes full turns and therefore ends at its start, return its angle, rad; otherwise None."""
    if arc is None or arc.angle_rad is None or arc.axis is None or arc.rise_m != 0.0:
        return None
    angle = 2.0 * np.pi * round(arc.angle_rad / (2.0 * np.pi))
    axis = arc.axis / np.linalg.norm(arc.axis)
    away = start.position - arc.centre
    missing = abs(arc.angle_rad - angle)
    radius_m = float(np.linalg.norm(away - (away @ axis) * axis))
    is_full = angle != 0.0 and missing <= CLOSED_RAD and missing * radius_m <= CLOSED_M
    return float(angle) if is_full else None


def _away(pose: Pose, goal: Pose, request: MotionRequest) -> tuple[float, float]:
    angle = angles_between(pose.quaternion[None], goal.quaternion[None], request.free_axes)[0]
    return float(np.linalg.norm(pose.position - goal.position)), float(angle)


def _require(distance_m: float, angle_rad: float, said: str) -> None:
    if distance_m > CLOSED_M or angle_rad > CLOSED_RAD:
        raise PlanningError(
            said,
            findings=[
                Finding("path", "distance to the end", distance_m, CLOSED_M, "m", 1.0),
                Finding("path", "angle to the end", angle_rad, float(CLOSED_RAD), "rad", 1.0),
            ],
        )
