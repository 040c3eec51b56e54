"""RobotConfig: properties of the arm, and limits for the vendor services.

Limits that are set here apply to the motions that MotionControl plans from then on. They can be tighter than
the configured limits, but never wider. A restart of the service resets them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from app.aubo.poses import as_list, numbers_of, place_of
from app.aubo.registry import Json, service
from cobot.errors import InputError, LimitError, NotSupportedError
from cobot.robot.tool import Tool, check_gravity
from cobot.types import Array, CartesianLimits, JointLimits, Numbers6, Pose
from cobot.units import MAX_TIP_M

if TYPE_CHECKING:
    from app.robot_services import Services

SAME = 1e-3
"""Two gravity vectors that differ by at most this are equal, m/s²."""
MIN_VALUE = 1e-3
"""Minimum value of a limit, and minimum distance between the two position limits of a joint. With smaller
values the arm could not move.
"""


@service("RobotConfig")
def get_dof(robot: Services) -> int:
    """The number of joints.

    Returns:
        the number of joints.
    """
    return robot.robot.limits.dof


@service("RobotConfig")
def get_name(robot: Services) -> str:
    """The robot's name.

    Returns:
        The name, as in the settings and in the path of the robot's services.
    """
    return robot.robot.name


@service("RobotConfig")
def get_robot_type(robot: Services) -> str:
    """The arm type.

    Returns:
        The name in the model's file.
    """
    return robot.robot.model.name


@service("RobotConfig")
def get_joint_names(robot: Services) -> list[str]:
    """The joint names.

    Returns:
        The names, in the order that joint positions have in all requests.
    """
    return list(robot.robot.limits.names)


@service("RobotConfig")
def get_cycletime(robot: Services) -> float:
    """The period of the control cycle.

    Returns:
        the period, s.
    """
    return robot.streams.period_s


@service("RobotConfig")
def get_joint_min_positions(robot: Services) -> list[float]:
    """Each joint's minimum position.

    Returns:
        the positions, rad.
    """
    return as_list(_limits(robot).min_position)


@service("RobotConfig")
def get_joint_max_positions(robot: Services) -> list[float]:
    """Each joint's maximum position.

    Returns:
        the positions, rad.
    """
    return as_list(_limits(robot).max_position)


@service("RobotConfig")
def get_joint_max_speeds(robot: Services) -> list[float]:
    """Each joint's maximum velocity.

    Returns:
        the velocities, rad/s.
    """
    return as_list(_limits(robot).max_velocity)


@service("RobotConfig")
def get_joint_max_accelerations(robot: Services) -> list[float]:
    """Each joint's maximum acceleration.

    Returns:
        the accelerations, rad/s².
    """
    return as_list(_limits(robot).max_acceleration)


@service("RobotConfig")
def get_joint_max_torques(robot: Services) -> list[float]:
    """Each joint's maximum torque.

    Returns:
        the torques, N·m.
    """
    return as_list(_limits(robot).max_effort)


@service("RobotConfig")
def get_tcp_max_speeds(robot: Services) -> list[float]:
    """The maximum linear and angular velocities of the tool's tip along lines and arcs.

    Returns:
        both velocities: [m/s, rad/s].
    """
    limits = robot.settings.envelope.cartesian
    return [limits.max_linear_velocity, limits.max_angular_velocity]


@service("RobotConfig")
def get_tcp_max_accelerations(robot: Services) -> list[float]:
    """The maximum linear and angular accelerations of the tool's tip along lines and arcs.

    Returns:
        both accelerations: [m/s², rad/s²].
    """
    limits = robot.settings.envelope.cartesian
    return [limits.max_linear_acceleration, limits.max_angular_acceleration]


@service("RobotConfig")
def set_joint_min_positions(robot: Services, positions: list[float]) -> None:
    """Raise each joint's minimum position.

    Args:
        positions: minimum positions, rad, one for each joint, not below the configured ones.
    """
    least = _each(robot, positions, "positions")
    _require(robot, least, robot.robot.limits.min_position, "positions", "rad", least=True)
    _require(robot, least, _limits(robot).max_position - MIN_VALUE, "positions", "rad")
    _set(robot, replace(_limits(robot), min_position=least))


@service("RobotConfig")
def set_joint_max_positions(robot: Services, positions: list[float]) -> None:
    """Lower each joint's maximum position.

    Args:
        positions: maximum positions, rad, one for each joint, not above the configured ones.
    """
    most = _each(robot, positions, "positions")
    _require(robot, most, robot.robot.limits.max_position, "positions", "rad")
    _require(robot, most, _limits(robot).min_position + MIN_VALUE, "positions", "rad", least=True)
    _set(robot, replace(_limits(robot), max_position=most))


@service("RobotConfig")
def set_joint_max_speeds(robot: Services, speeds: list[float]) -> None:
    """Lower each joint's maximum velocity.

    Args:
        speeds: rad/s, one for each joint, above 0 and not above the configured ones.
    """
    most = _rates(robot, speeds, robot.robot.limits.max_velocity, "speeds", "rad/s")
    _set(robot, replace(_limits(robot), max_velocity=most))


@service("RobotConfig")
def set_joint_max_accelerations(robot: Services, accelerations: list[float]) -> None:
    """Lower each joint's maximum acceleration.

    Args:
        accelerations: rad/s², one for each joint, above 0 and not above the configured ones.
    """
    most = _rates(robot, accelerations, robot.robot.limits.max_acceleration, "accelerations", "rad/s²")
    _set(robot, replace(_limits(robot), max_acceleration=most))


@service("RobotConfig")
def set_tcp_max_speeds(robot: Services, speeds: list[float]) -> None:
    """Lower the maximum velocities of the tool's tip along lines and arcs.

    Args:
        speeds: [m/s, rad/s], above 0 and not above the configured ones.
    """
    whole = robot.robot.cartesian_limits
    linear, angular = _pair(speeds, (whole.max_linear_velocity, whole.max_angular_velocity), "speeds")
    cartesian = robot.settings.envelope.cartesian
    _set(robot, replace(cartesian, max_linear_velocity=linear, max_angular_velocity=angular))


@service("RobotConfig")
def set_tcp_max_accelerations(robot: Services, accelerations: list[float]) -> None:
    """Lower the maximum accelerations of the tool's tip along lines and arcs.

    Args:
        accelerations: [m/s², rad/s²], above 0 and not above the configured ones.
    """
    whole = robot.robot.cartesian_limits
    most = (whole.max_linear_acceleration, whole.max_angular_acceleration)
    linear, angular = _pair(accelerations, most, "accelerations")
    cartesian = robot.settings.envelope.cartesian
    _set(robot, replace(cartesian, max_linear_acceleration=linear, max_angular_acceleration=angular))


@service("RobotConfig")
def reset_limits(robot: Services) -> None:
    """Restore the limits of the configuration."""
    _set(robot, robot.robot.limits)
    _set(robot, robot.robot.cartesian_limits)


@service("RobotConfig")
def get_tcp_offset(robot: Services) -> list[float]:
    """The pose of the tool's tip (TCP), to which all poses refer.

    Returns:
        [x, y, z, rx, ry, rz] in the frame of the TCP in the model's file, m and rad; all 0 for the model's
            own TCP.
    """
    return numbers_of(robot.robot.model.tcp_in_file_tcp())


@service("RobotConfig")
async def set_tcp_offset(robot: Services, offset: list[float]) -> None:
    """Set the tool's tip (TCP), for all interfaces, as POST /robot/tool does. It is kept across restarts.
    Allowed only while the arm is at rest and no moves are waiting.

    Args:
        offset: [x, y, z, rx, ry, rz] in the frame of the TCP in the model's file, m and rad; at most 2 m.
    """
    tip = place_of(offset, "offset", MAX_TIP_M)
    if np.linalg.norm(tip.position) > 2.0:
        raise LimitError(f"offset is {np.linalg.norm(tip.position):.3g} m long, allowed: up to 2 m")
    file_tcp = Pose.from_numbers(robot.robot.model.file_tcp_in_flange)
    tcp = (file_tcp @ tip).numbers if any(offset) else None
    await robot.tool.change(lambda tool: replace(tool, tcp=tcp), "setTcpOffset")


@service("RobotConfig")
def get_gravity(robot: Services) -> list[float]:
    """The gravitational acceleration.

    Returns:
        the vector [x, y, z] in the base frame, m/s².
    """
    return as_list(robot.robot.model.gravity)


@service("RobotConfig")
async def set_gravity(robot: Services, gravity: list[float]) -> None:
    """Set the direction of gravity, for a tilted base. It is kept across restarts. Allowed only while the arm
    is at rest. The magnitude of gravity comes from the model's file.

    Args:
        gravity: gravitational acceleration [x, y, z] in the base frame, m/s².
    """
    if len(gravity) != 3:
        raise InputError(f"gravity must be [x, y, z], got {len(gravity)} numbers")
    x, y, z = gravity
    model = robot.robot.model
    if np.abs(np.array(gravity) - model.gravity).max() <= SAME:
        return
    try:
        check_gravity((x, y, z), model.file_gravity)
    except LimitError as exc:
        raise NotSupportedError(str(exc)) from exc
    as_in_file = bool(np.abs(np.array(gravity) - model.file_gravity).max() <= SAME)
    down = None if as_in_file else (x, y, z)
    await robot.tool.change(lambda tool: replace(tool, gravity=down), "setGravity")


@service("RobotConfig")
def get_payload(robot: Services) -> Json:
    """The mass of tool and load, in addition to the model's file.

    Returns:
        JSON: [mass, centre of gravity, rotation, inertia]: kg; [x, y, z] in the flange's frame, m; always [0,
            0, 0], because the inertia is along the flange's axes; [xx, xy, xz, yy, yz, zz] about the centre,
            kg·m².
    """
    tool = robot.robot.model.tool
    return [tool.mass, list(tool.centre), [0.0] * 3, list(tool.inertia or [0.0] * 6)]


@service("RobotConfig")
async def set_payload(
    robot: Services, m: float, cog: list[float], aom: list[float], inertia: list[float]
) -> None:
    """Set the mass of tool and load, in addition to the model's file, as POST /robot/tool does. All later
    motions are planned with it, and the arm compensates its weight. It is kept across restarts. Allowed only
    while the arm is at rest.

    Args:
        m: mass, kg, up to robot.max_payload_kg of the settings.
        cog: centre of mass [x, y, z] in the flange's frame, m.
        aom: [rx, ry, rz] of the inertia's axes in the flange's frame, rad.
        inertia: [xx, xy, xz, yy, yz, zz] about the centre of mass, kg·m²; all 0 for a point mass.
    """
    for name, values, count in (("cog", cog, 3), ("aom", aom, 3), ("inertia", inertia, 6)):
        if len(values) != count:
            raise InputError(f"{name} must have {count} numbers, got {len(values)}")
    matrix = Tool(mass=m, inertia=cast(Numbers6, tuple(inertia))).inertia_matrix
    turn = place_of([0.0, 0.0, 0.0, *aom], "aom").rotation
    along = as_list((turn @ matrix @ turn.T)[np.triu_indices(3)]) if any(inertia) else None
    changes = {"mass": m, "centre": tuple(cog), "inertia": None if along is None else tuple(along)}
    await robot.tool.change(lambda tool: replace(tool, **cast(dict[str, Any], changes)), "setPayload")


@service("RobotConfig")
def get_collision_level(robot: Services) -> int:
    """The sensitivity of the collision detection.

    Returns:
        Always 0: there are no levels. The arm stops if a joint deviates from its commanded position by more
            than rt.tracking_error_rad in the settings.
    """
    return 0


@service("RobotConfig")
def set_collision_level(robot: Services, level: int) -> None:
    """Accepts only level 0, because there are no levels; see getCollisionLevel.

    Args:
        level: 0.
    """
    if level != 0:
        raise NotSupportedError(
            "there are no collision levels; set rt.tracking_error_rad in the settings instead"
        )


def _limits(robot: Services) -> JointLimits:
    return robot.settings.envelope.limits


def _set(robot: Services, limits: JointLimits | CartesianLimits) -> None:
    envelope = robot.settings.envelope
    if isinstance(limits, JointLimits):
        robot.settings.envelope = replace(envelope, limits=limits)
    else:
        robot.settings.envelope = replace(envelope, cartesian=limits)


def _each(robot: Services, values: list[float], name: str) -> Array:
    if len(values) != robot.robot.limits.dof:
        raise InputError(f"{name} must have {robot.robot.limits.dof} numbers, got {len(values)}")
    return np.array(values)


def _rates(robot: Services, values: list[float], most: Array, name: str, unit: str) -> Array:
    rates = _each(robot, values, name)
    _require(robot, rates, most, name, unit)
    _require(robot, rates, np.full(len(rates), MIN_VALUE), name, unit, least=True)
    return rates


def _require(
    robot: Services, values: Array, bounds: Array, name: str, unit: str, *, least: bool = False
) -> None:
    """Reject values above the bounds or, if the bounds are minimum values, below them."""
    for joint, value, bound in zip(robot.robot.limits.names, values, bounds, strict=True):
        if value < bound if least else value > bound:
            words = "at least" if least else "at most"
            raise LimitError(f"{name}: {joint} is {value:g} {unit}, allowed: {words} {bound:g} {unit}")


def _pair(values: list[float], most: tuple[float, float], name: str) -> tuple[float, float]:
    if len(values) != 2:
        raise InputError(f"{name} must be [linear, angular], got {len(values)} numbers")
    for value, bound in zip(values, most, strict=True):
        if not MIN_VALUE <= value <= bound:
            raise LimitError(f"{name}: is {value:g}, allowed: {MIN_VALUE} to {bound:g}")
    return values[0], values[1]
