"""Checks of requests for motions: which fields each planner uses, and the values of the fields.

`check_request` does not need a robot. Each `MotionRequest` calls it when it is made.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cobot.errors import InputError
from cobot.motions.planners import BODY_FIELDS, PLANNERS, PlannerTraits, Way, users_of
from cobot.types import FREE_AXES, RRT_CONNECT, Pose

if TYPE_CHECKING:
    from cobot.motions.requests import Arc, MotionRequest
    from cobot.robot.description import RobotDescription

MIN_AXIS_LENGTH = 1e-3
"""Minimum length of a vector that gives a direction."""


def check_request(request: MotionRequest) -> None:
    """Check that the fields of a request match the planner and each other.

    Raises:
        InputError: a field does not match; the message names the field, its value and what is allowed.
    """
    traits = PLANNERS[request.planner]
    if traits.way is Way.PATH and not isinstance(request.goal, Pose):
        raise InputError(f"{request.planner} needs a pose as its goal, not joint angles")
    given = [field for field in BODY_FIELDS if _is_given(request, field)]
    for field in given:
        if field not in traits.fields:
            users = users_of(field)
            planners = users if "," in users else f"planner {users}"
            raise InputError(f"{_named(request, field)} is for {planners} only, not for {request.planner}")
    _require_one(traits, request, given)
    if request.constraints is not None and request.algorithm != RRT_CONNECT:
        raise InputError(
            f"constraints: {request.algorithm} does not support them; use algorithm {RRT_CONNECT}"
        )
    if request.cyclic and request.end_joints is not None:
        raise InputError("cyclic, end_joints: give one of them, not both")
    if request.arc is not None:
        _check_arc(request.arc)
    if request.free_axes:
        _check_free_axes(request.free_axes)


def check_for_robot(request: MotionRequest, robot: RobotDescription) -> None:
    """Check that the number of end joints and the TCP speed are allowed for a robot.

    Raises:
        InputError: a value is not allowed; the message names the field, its value and what is allowed.
    """
    end, dof = request.end_joints, robot.limits.dof
    if end is not None and len(end) != dof:
        raise InputError(f"end_joints: must have {dof} angles, got {len(end)}")
    speed, limits = request.tcp_speed, robot.cartesian_limits
    for name, value, limit, setting, unit in (
        ("speed_m_s", speed.linear_m_s, limits.max_linear_velocity, "max_linear_velocity", "m/s"),
        ("speed_rad_s", speed.angular_rad_s, limits.max_angular_velocity, "max_angular_velocity", "rad/s"),
    ):
        if value is not None and not 0.0 < value <= limit:
            raise InputError(
                f"{name}: is {value:g} {unit}, allowed: above 0 and up to {limit:g} {unit} "
                f"(planning.{setting})"
            )


def _is_given(request: MotionRequest, field: str) -> bool:
    """Whether a request gives an optional field. A false `cyclic` is treated as not given."""
    value = getattr(request, field)
    if value is None or value is False or isinstance(value, np.ndarray):
        return isinstance(value, np.ndarray)
    return bool(value != request.__dataclass_fields__[field].default)


def _named(request: MotionRequest, field: str) -> str:
    """A field as the beginning of an error: its name in JSON, and its value if that is a word."""
    value = getattr(request, field)
    if field == "tcp_speed" and value.linear_m_s is None:
        return f"{BODY_FIELDS[field][1]}:"
    name = BODY_FIELDS[field][0]
    return f"{name}: {value}" if isinstance(value, str) else f"{name}:"


def _require_one(traits: PlannerTraits, request: MotionRequest, given: list[str]) -> None:
    """Check that the request gives exactly one of the fields that its planner needs."""
    needed = [field for field in traits.needs if field in given]
    if traits.needs and not needed:
        raise InputError(traits.missing)
    if len(needed) > 1:
        names = ", ".join(BODY_FIELDS[field][0] for field in needed)
        raise InputError(f"{names}: give only one of them; it defines the path of planner {request.planner}")


def _check_arc(arc: Arc) -> None:
    """Check that an arc has an angle other than 0, and that its axis gives a direction."""
    if arc.angle_rad == 0.0:
        raise InputError("angle: is 0 rad, so there is no arc, even with a rise; for a line use lin")
    if arc.axis is not None and not math.hypot(*arc.axis) > MIN_AXIS_LENGTH:
        length = math.hypot(*arc.axis)
        raise InputError(
            f"axis: has a length of {length:g}, so it has no direction; the length must be above "
            f"{MIN_AXIS_LENGTH:g}"
        )


def _check_free_axes(free: Sequence[str]) -> None:
    """Check that one axis or all three are free. A free rotation about two axes would also free the third."""
    valid = ", ".join(FREE_AXES)
    for index, axis in enumerate(free):
        if axis not in FREE_AXES:
            raise InputError(
                f"free_axes[{index}]: there is no axis {axis!r}; valid names: {valid}, the rotations "
                "about the tool's x, y and z axis"
            )
        if axis in free[:index]:
            raise InputError(f"free_axes[{index}]: {axis} is given twice")
    if len(free) == len(FREE_AXES) - 1:
        raise InputError(
            f"free_axes: {' and '.join(free)} together already allow every orientation; "
            f"give one of {valid}, or all three if only the position matters"
        )
