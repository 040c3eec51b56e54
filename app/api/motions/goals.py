"""Conversion of requests to move, with their path constraints, into goals of the services."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.api.motions.signals import signals_of
from app.robot_services import Services
from app.services.motion.goals import NOWHERE
from cobot.errors import InputError
from cobot.motions.bodies import (
    AnyMotion,
    KeptBox,
    KeptOrientation,
    MotionConstraints,
    MoveArc,
    MoveNamed,
    MovePose,
    PathPoint,
    PathPose,
    TcpMotion,
)
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.motions.fields import Direction
from cobot.motions.requests import NO_START, Arc, MotionRequest, TcpSpeed
from cobot.strict import shown
from cobot.types import Array, JointLimits, PlannerName, Pose, Scaling, Synchronization


def _scaling(body: TcpMotion) -> Scaling:
    """Return the share of the limits; 1 if only a speed in m/s or rad/s is given."""
    in_units = body.speed_m_s is not None or body.speed_rad_s is not None
    speed = 1.0 if in_units and "speed" not in body.model_fields_set else body.speed
    return Scaling(speed, body.accel_scale)


def _arc_to(body: MovePose) -> Arc | None:
    if body.centre is None:
        if body.axis is not None:
            raise InputError("axis: requires centre, which is missing")
        return None
    return Arc(_vector(body.centre), None if body.axis is None else _vector(body.axis))


def _pose(body: PathPose) -> Pose:
    return Pose.from_abc(body.x, body.y, body.z, body.a, body.b, body.c)


def _vector(point: PathPoint | Direction) -> Array:
    return np.array([point.x, point.y, point.z])


def goal_of(body: AnyMotion, services: Services, *, checked: bool = True) -> MotionRequest:
    """Convert a request to move into a goal. Once the start is known, the goal becomes a request to a
    planner.

    Args:
        checked: whether to reject joint angles beyond the limits here. If false, planning rejects them, with
            an error that can suggest a goal that works.

    Raises:
        InputError: fields contradict each other, or the planner or the robot does not support them.
        LimitError: joint angles beyond the limits.
        NotSupportedError, UnavailableError: see `signals_of`.
    """
    goals, constraints = services.goals, constraints_of(body.constraints, services.robot.limits)
    if isinstance(body, MoveArc):
        found = goals.pose(_arc_by_angle(body, constraints), body.frame_id)
    elif isinstance(body, MovePose):
        found = goals.pose(_to_pose(body, constraints, goals.budget_s), body.frame_id)
    else:
        joints = goals.named(body.name) if isinstance(body, MoveNamed) else np.array(body.joints)
        goals.require_joints(joints, checked=checked)
        found = MotionRequest(
            NO_START,
            joints,
            PlannerName(body.planner),
            Scaling(body.speed, body.accel_scale),
            algorithm=body.algorithm,
            synchronization=Synchronization(body.synchronization),
            constraints=constraints,
            budget_s=goals.budget_s if body.budget_s is None else body.budget_s,
        )
    if not (body.actions or body.start_when or body.pause_while or body.until):
        return found
    return replace(found, signals=signals_of(body, found.scaling, services))


def _arc_by_angle(body: MoveArc, constraints: Constraints | None) -> MotionRequest:
    return MotionRequest(
        NO_START,
        NOWHERE,
        PlannerName.CIRC,
        _scaling(body),
        arc=Arc(_vector(body.centre), _vector(body.axis), body.angle, body.rise, body.turn_tool),
        tcp_speed=TcpSpeed(body.speed_m_s, body.speed_rad_s),
        constraints=constraints,
        free_axes=tuple(body.free_axes),
        cyclic=body.cyclic,
    )


def _to_pose(body: MovePose, constraints: Constraints | None, default_budget_s: float) -> MotionRequest:
    return MotionRequest(
        NO_START,
        _pose(body),
        PlannerName(body.planner),
        _scaling(body),
        via=None if body.via is None else _vector(body.via),
        algorithm=body.algorithm,
        synchronization=Synchronization(body.synchronization),
        arc=_arc_to(body),
        through=tuple(map(_pose, body.through)),
        radius_m=body.radius,
        tcp_speed=TcpSpeed(body.speed_m_s, body.speed_rad_s),
        constraints=constraints,
        free_axes=tuple(body.free_axes),
        cyclic=body.cyclic,
        end_joints=None if body.end_joints is None else np.array(body.end_joints),
        budget_s=default_budget_s if body.budget_s is None else body.budget_s,
    )


def constraints_of(asked: MotionConstraints | None, limits: JointLimits) -> Constraints | None:
    """Return the path constraints of a request; None if it has none.

    Raises:
        InputError: a direction without length, an empty box or range, or an unknown joint.
    """
    if asked is None or not asked.model_dump(exclude_defaults=True):
        return None
    return Constraints(
        None if asked.orientation is None else _cone(asked.orientation),
        None if asked.box is None else _box(asked.box),
        tuple(_range(name, low, high, limits) for name, (low, high) in asked.joints.items()),
    )


def _cone(asked: KeptOrientation) -> Cone:
    direction = asked.direction
    return Cone(
        _unit("tool_axis", asked.tool_axis),
        asked.within_rad,
        None if direction is None else _unit("direction", direction),
    )


def _unit(name: str, given: Direction) -> Array:
    axis = _vector(given)
    length = float(np.linalg.norm(axis))
    if not 1e-9 < length < np.inf:
        field = f"constraints.orientation.{name}"
        raise InputError(f"{field}: has a length of {length:g}, so it has no direction")
    return np.asarray(axis / length)


def _box(asked: KeptBox) -> Box:
    for name in "xyz":
        low, high = getattr(asked.min, name), getattr(asked.max, name)
        if not low < high:
            raise InputError(
                f"constraints.box: min.{name} is {low:g} m; it must be below max.{name}, {high:g} m"
            )
    return Box(_vector(asked.min), _vector(asked.max))


def _range(name: str, low: float, high: float, limits: JointLimits) -> tuple[int, float, float]:
    place = f"constraints.joints.{shown(name)[1:-1]}"
    if name not in limits.names:
        raise InputError(f"{place}: there is no such joint; valid names: {', '.join(limits.names)}")
    joint = limits.names.index(name)
    unit = limits.unit(joint)
    what = "angle" if unit == "rad" else "position"
    least, most = float(limits.min_position[joint]), float(limits.max_position[joint])
    if not low <= high:
        raise InputError(f"{place}: is {low:g} to {high:g} {unit}; the smaller {what} must come first")
    if high < least or low > most:
        raise InputError(
            f"{place}: is {low:g} to {high:g} {unit}, beyond the limits of {least:.4f} to {most:.4f} {unit}"
        )
    return joint, low, high
