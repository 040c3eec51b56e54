"""Checks of requests for motions: which planner takes which field, and which values."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cobot.errors import InputError
from cobot.motions.constraints import Constraints
from cobot.motions.requests import PATH_PLANNERS, Arc, TcpSpeed
from cobot.types import (
    FREE_AXES,
    RRT_CONNECT,
    Algorithm,
    Array,
    CartesianLimits,
    PlannerName,
    Pose,
    Synchronization,
)

SHORTEST_AXIS = 1e-3
"""Shorter vectors are rejected as directions."""


def check_via(planner: PlannerName, via: object, arc: object = None) -> None:
    """Require a point on the arc or its centre for circ, and none for other planners.

    Raises:
        InputError: circ has neither or both, or another planner has one.
    """
    if planner is PlannerName.CIRC and via is None and arc is None:
        raise InputError("via: is missing; planner circ needs a point on its arc, or its centre")
    if planner is PlannerName.CIRC and via is not None and arc is not None:
        raise InputError("via, centre: one of them defines the arc of planner circ, not both")
    for name, given in (("via", via), ("centre", arc)):
        if given is not None and planner is not PlannerName.CIRC:
            raise InputError(f"{name}: is for planner circ only, not for {planner}")


def check_through(planner: PlannerName, through: Sequence[Pose], radius_m: float) -> None:
    """Require poses on the way for polyline, and neither these nor a radius for other planners.

    Raises:
        InputError: polyline has none, or another planner has some.
    """
    if planner is PlannerName.POLYLINE and not through:
        raise InputError(
            "through: is empty; planner polyline needs at least one pose on the way; or take lin"
        )
    for name, given in (("through", len(through) > 0), ("radius", radius_m != 0.0)):
        if given and planner is not PlannerName.POLYLINE:
            raise InputError(f"{name}: is for planner polyline only, not for {planner}")


def check_arc(arc: Arc | None) -> None:
    """Require an arc to turn, about a direction.

    Raises:
        InputError: the angle is 0, or the axis has no length.
    """
    if arc is None:
        return
    if arc.angle_rad == 0.0:
        raise InputError("angle: is 0 rad, which is no arc, with or without a rise; for a line there is lin")
    if arc.axis is not None and not math.hypot(*arc.axis) > SHORTEST_AXIS:
        length = math.hypot(*arc.axis)
        raise InputError(
            f"axis: has a length of {length:g}, which is no direction; above {SHORTEST_AXIS:g} is"
        )


def check_tcp_speed(planner: PlannerName, speed: TcpSpeed, limits: CartesianLimits) -> None:
    """Require a speed of the TCP to be within its limit, and none for planners in joint space.

    Raises:
        InputError: names the field, its value and what is possible.
    """
    for name, value, limit, setting, unit in (
        ("speed_m_s", speed.linear_m_s, limits.max_linear_velocity, "max_linear_velocity", "m/s"),
        ("speed_rad_s", speed.angular_rad_s, limits.max_angular_velocity, "max_angular_velocity", "rad/s"),
    ):
        if value is None:
            continue
        if planner not in PATH_PLANNERS:
            raise InputError(f"{name}: is for lin, circ and polyline only, not for {planner}")
        if not 0.0 < value <= limit:
            raise InputError(
                f"{name}: is {value:g} {unit}, possible is above 0 and up to {limit:g} {unit} "
                f"(planning.{setting})"
            )


def check_end(planner: PlannerName, cyclic: bool | None, end_joints: Array | None) -> None:
    """Require at most one choice of the end's joints, and none for planners in joint space.

    Raises:
        InputError: names the field.
    """
    for name, given in (("cyclic", cyclic), ("end_joints", end_joints is not None)):
        if given and planner not in PATH_PLANNERS:
            raise InputError(f"{name}: is for lin, circ and polyline only, not for {planner}")
    if cyclic and end_joints is not None:
        raise InputError("cyclic, end_joints: give one of them, not both")


def check_free_axes(free: Sequence[str]) -> None:
    """Require no free axis, one, or all three, because two of them together make the third.

    Raises:
        InputError: there are two, or one is unknown or given twice.
    """
    valid = ", ".join(FREE_AXES)
    for index, axis in enumerate(free):
        if axis not in FREE_AXES:
            raise InputError(
                f"free_axes[{index}]: there is no axis {axis!r}; valid are: {valid}, the rotations about the "
                "tool's x, y and z axis"
            )
        if axis in free[:index]:
            raise InputError(f"free_axes[{index}]: {axis} is given twice")
    if len(free) == len(FREE_AXES) - 1:
        raise InputError(
            f"free_axes: has {' and '.join(free)}, by which every orientation is reached; "
            f"valid are one of {valid}, or all three for the position alone"
        )


def check_synchronization(planner: PlannerName, synchronization: Synchronization) -> None:
    """Reject phase synchronization of planners other than ptp.

    Raises:
        InputError: names the planner.
    """
    if synchronization is Synchronization.PHASE and planner is not PlannerName.PTP:
        raise InputError(f"synchronization: phase is for planner ptp only, not for {planner}")


def check_algorithm(planner: PlannerName, algorithm: Algorithm, constraints: Constraints | None) -> None:
    """Require the algorithm to fit the planner and the constraints.

    Raises:
        InputError: the planner is not ompl's, or the algorithm cannot keep constraints.
    """
    if algorithm != RRT_CONNECT and planner not in (PlannerName.OMPL, PlannerName.AUTO):
        raise InputError(f"algorithm: {algorithm} is for planner ompl and auto only, not for {planner}")
    if constraints is not None and algorithm != RRT_CONNECT:
        raise InputError(f"constraints: of ompl's planners {RRT_CONNECT} alone keeps them, not {algorithm}")
