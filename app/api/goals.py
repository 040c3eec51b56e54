"""Requests to move as goals of the services."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.api.constraints import constraints_of
from app.robot_services import Services
from app.services.motion.goals import NOWHERE, Goal, Goals
from cobot.errors import InputError
from cobot.motions.bodies import (
    AnyMotion,
    MoveArc,
    MoveJoints,
    MoveNamed,
    MovePose,
    PathPoint,
    PathPose,
    TcpMotion,
)
from cobot.motions.checks import check_algorithm
from cobot.motions.requests import Arc, TcpSpeed
from cobot.robot.frames import pose_from_abc
from cobot.types import Array, PlannerName, Pose, Scaling, Synchronization


def _scaling(body: TcpMotion) -> Scaling:
    """The share of the limits; all of them where only a speed in m/s or rad/s is given."""
    in_units = body.speed_m_s is not None or body.speed_rad_s is not None
    speed = 1.0 if in_units and "speed" not in body.model_fields_set else body.speed
    return Scaling(speed, body.accel_scale)


def _arc_to(body: MovePose) -> Arc | None:
    if body.centre is None:
        if body.axis is not None:
            raise InputError("axis: goes with centre, which is missing")
        return None
    return Arc(_vector(body.centre), None if body.axis is None else _vector(body.axis))


def _pose(body: PathPose) -> Pose:
    return pose_from_abc(body.x, body.y, body.z, body.a, body.b, body.c)


def _vector(point: PathPoint) -> Array:
    return np.array([point.x, point.y, point.z])


def goal_of(body: AnyMotion, services: Services, *, checked: bool = True) -> Goal:
    """The goal of a request to move.

    Args:
        checked: whether joint angles are checked against the limits already here; planning checks them too.

    Raises:
        InputError, LimitError: see `Goals.named`, `joints`, `pose` and `arc`.
    """
    constraints = constraints_of(body.constraints, services.robot.limits)
    if isinstance(body, MoveArc):
        return replace(_along_arc(body, services.goals), constraints=constraints)
    goal, planner = _to_goal(body, services.goals, checked=checked), PlannerName(body.planner)
    check_algorithm(planner, body.algorithm, constraints)
    return replace(goal, planner=planner, algorithm=body.algorithm, constraints=constraints)


def _along_arc(body: MoveArc, goals: Goals) -> Goal:
    goal = Goal(
        NOWHERE,
        _scaling(body),
        PlannerName.CIRC,
        arc=Arc(_vector(body.centre), _vector(body.axis), body.angle, body.rise, body.turn_tool),
        tcp_speed=TcpSpeed(body.speed_m_s, body.speed_rad_s),
        free_axes=tuple(body.free_axes),
        cyclic=body.cyclic,
    )
    return goals.pose(goal, body.frame_id)


def _to_goal(body: MoveNamed | MoveJoints | MovePose, goals: Goals, *, checked: bool) -> Goal:
    scaling, synchronization = Scaling(body.speed, body.accel_scale), Synchronization(body.synchronization)
    if isinstance(body, MoveNamed):
        return goals.named(body.name, scaling, synchronization, checked=checked)
    if isinstance(body, MoveJoints):
        return goals.joints(body.joints, scaling, synchronization, checked=checked)
    goal = Goal(
        _pose(body),
        _scaling(body),
        PlannerName(body.planner),
        via=None if body.via is None else _vector(body.via),
        synchronization=synchronization,
        arc=_arc_to(body),
        through=tuple(map(_pose, body.through)),
        radius_m=body.radius,
        tcp_speed=TcpSpeed(body.speed_m_s, body.speed_rad_s),
        free_axes=tuple(body.free_axes),
        cyclic=body.cyclic,
        end_joints=None if body.end_joints is None else np.array(body.end_joints),
    )
    return goals.pose(goal, body.frame_id)
