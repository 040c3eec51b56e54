"""RobotConfig: what the arm is, and what its vendor services may do with it.

Limits that are set here are for the motions that MotionControl plans from then on: they can be tighter than
those of the configuration, never wider, and are gone with the next start of the service.
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
"""A gravity that is so near to another one is taken for the same, m/s²."""
MIN_VALUE = 1e-3
"""A rate that is set, and the distance of two position limits, is no smaller: nothing could move at all."""


@service("RobotConfig")
def get_dof(robot: Services) -> int:
    """The number of joints.

    Returns:
        How many numbers a joint position has.
    """
    return robot.robot.limits.dof


@service("RobotConfig")
def get_name(robot: Services) -> str:
    """The robot's name.

    Returns:
        As in the settings, and in the path of its services.
    """
    return robot.robot.name


@service("RobotConfig")
def get_robot_type(robot: Services) -> str:
    """What kind of arm it is.

    Returns:
        The name in the model's file.
    """
    return robot.robot.model.name


@service("RobotConfig")
def get_joint_names(robot: Services) -> list[str]:
    """The names of the joints.

    Returns:
        In the order of all joint positions.
    """
    return list(robot.robot.limits.names)


@service("RobotConfig")
def get_cycletime(robot: Services) -> float:
    """The period of the control cycle.

    Returns:
        s.
    """
    return robot.streams.period_s


@service("RobotConfig")
def get_joint_min_positions(robot: Services) -> list[float]:
    """How far each joint may turn back.

    Returns:
        rad.
    """
    return as_list(_limits(robot).min_position)


@service("RobotConfig")
def get_joint_max_positions(robot: Services) -> list[float]:
    """How far each joint may turn forth.

    Returns:
        rad.
    """
    return as_list(_limits(robot).max_position)


@service("RobotConfig")
def get_joint_max_speeds(robot: Services) -> list[float]:
    """How fast each joint may be.

    Returns:
        rad/s.
    """
    return as_list(_limits(robot).max_velocity)


@service("RobotConfig")
def get_joint_max_accelerations(robot: Services) -> list[float]:
    """How much each joint may accelerate.

    Returns:
        rad/s².
    """
    return as_list(_limits(robot).max_acceleration)


@service("RobotConfig")
def get_joint_max_torques(robot: Services) -> list[float]:
    """How strong each drive is.

    Returns:
        N·m.
    """
    return as_list(_limits(robot).max_effort)


@service("RobotConfig")
def get_tcp_max_speeds(robot: Services) -> list[float]:
    """How fast the tool's tip may move and turn along lines and arcs.

    Returns:
        [m/s, rad/s].
    """
    limits = robot.settings.envelope.cartesian
    return [limits.max_linear_velocity, limits.max_angular_velocity]


@service("RobotConfig")
def get_tcp_max_accelerations(robot: Services) -> list[float]:
    """How much the tool's tip may accelerate along lines and arcs.

    Returns:
        [m/s², rad/s²].
    """
    limits = robot.settings.envelope.cartesian
    return [limits.max_linear_acceleration, limits.max_angular_acceleration]


@service("RobotConfig")
def set_joint_min_positions(robot: Services, positions: list[float]) -> None:
    """Tighten how far each joint may turn back.

    Args:
        positions: rad, one for each joint, not below those of the configuration.
    """
    least = _each(robot, positions, "positions")
    _require(robot, least, robot.robot.limits.min_position, "positions", "rad", least=True)
    _require(robot, least, _limits(robot).max_position - MIN_VALUE, "positions", "rad")
    _set(robot, replace(_limits(robot), min_position=least))


@service("RobotConfig")
def set_joint_max_positions(robot: Services, positions: list[float]) -> None:
    """Tighten how far each joint may turn forth.

    Args:
        positions: rad, one for each joint, not above those of the configuration.
    """
    most = _each(robot, positions, "positions")
    _require(robot, most, robot.robot.limits.max_position, "positions", "rad")
    _require(robot, most, _limits(robot).min_position + MIN_VALUE, "positions", "rad", least=True)
    _set(robot, replace(_limits(robot), max_position=most))


@service("RobotConfig")
def set_joint_max_speeds(robot: Services, speeds: list[float]) -> None:
    """Tighten how fast each joint may be.

    Args:
        speeds: rad/s, one for each joint, above 0 and not above those of the configuration.
    """
    most = _rates(robot, speeds, robot.robot.limits.max_velocity, "speeds", "rad/s")
    _set(robot, replace(_limits(robot), max_velocity=most))


@service("RobotConfig")
def set_joint_max_accelerations(robot: Services, accelerations: list[float]) -> None:
    """Tighten how much each joint may accelerate.

    Args:
        accelerations: rad/s², one for each joint, above 0 and not above those of the configuration.
    """
    most = _rates(robot, accelerations, robot.robot.limits.max_acceleration, "accelerations", "rad/s²")
    _set(robot, replace(_limits(robot), max_acceleration=most))


@service("RobotConfig")
def set_tcp_max_speeds(robot: Services, speeds: list[float]) -> None:
    """Tighten how fast the tool's tip may move and turn along lines and arcs.

    Args:
        speeds: [m/s, rad/s], above 0 and not above those of the configuration.
    """
    whole = robot.robot.cartesian_limits
    linear, angular = _pair(speeds, (whole.max_linear_velocity, whole.max_angular_velocity), "speeds")
    cartesian = robot.settings.envelope.cartesian
    _set(robot, replace(cartesian, max_linear_velocity=linear, max_angular_velocity=angular))


@service("RobotConfig")
def set_tcp_max_accelerations(robot: Services, accelerations: list[float]) -> None:
    """Tighten how much the tool's tip may accelerate along lines and arcs.

    Args:
        accelerations: [m/s², rad/s²], above 0 and not above those of the configuration.
    """
    whole = robot.robot.cartesian_limits
    most = (whole.max_linear_acceleration, whole.max_angular_acceleration)
    linear, angular = _pair(accelerations, most, "accelerations")
    cartesian = robot.settings.envelope.cartesian
    _set(robot, replace(cartesian, max_linear_acceleration=linear, max_angular_acceleration=angular))


@service("RobotConfig")
def reset_limits(robot: Services) -> None:
    """Go back to the limits of the configuration."""
    _set(robot, robot.robot.limits)
    _set(robot, robot.robot.cartesian_limits)


@service("RobotConfig")
def get_tcp_offset(robot: Services) -> list[float]:
    """Where the tool's tip is, the TCP that all poses are about.

    Returns:
        [x, y, z, rx, ry, rz] in the frame of the TCP in the model's file, m and rad; all 0 when it is that.
    """
    return numbers_of(robot.robot.model.tcp_in_file_tcp())


@service("RobotConfig")
async def set_tcp_offset(robot: Services, offset: list[float]) -> None:
    """Say where the tool's tip is, for everything, as POST /robot/tool does; kept over restarts. Only while
    the arm rests and no moves wait.

    Args:
        offset: [x, y, z, rx, ry, rz] in the frame of the TCP in the model's file, m and rad; at most 2 m.
    """
    tip = place_of(offset, "offset", MAX_TIP_M)
    if np.linalg.norm(tip.position) > 2.0:
        raise LimitError(f"offset must be at most 2 m away, got {np.linalg.norm(tip.position):.3g} m")
    file_tcp = Pose.from_numbers(robot.robot.model.file_tcp_in_flange)
    tcp = (file_tcp @ tip).numbers if any(offset) else None
    await robot.tool.change(lambda tool: replace(tool, tcp=tcp), "setTcpOffset")


@service("RobotConfig")
def get_gravity(robot: Services) -> list[float]:
    """The acceleration of free fall.

    Returns:
        [x, y, z] in the base frame, m/s².
    """
    return as_list(robot.robot.model.gravity)


@service("RobotConfig")
async def set_gravity(robot: Services, gravity: list[float]) -> None:
    """Say where down is, for a base that is tilted; kept over restarts. Only while the arm rests. The size of
    gravity is part of the model's file.

    Args:
        gravity: [x, y, z] in the base frame, m/s².
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
    """What is mounted beyond the model's file, tool and load.

    Returns:
        JSON: [mass, centre of gravity, rotation, inertia]: kg; [x, y, z] in the flange's frame, m; [0, 0, 0],
        for the inertia is along the flange's axes; [xx, xy, xz, yy, yz, zz] about the centre, kg·m².
    """
    tool = robot.robot.model.tool
    return [tool.mass, list(tool.centre), [0.0] * 3, list(tool.inertia or [0.0] * 6)]


@service("RobotConfig")
async def set_payload(
    robot: Services, m: float, cog: list[float], aom: list[float], inertia: list[float]
) -> None:
    """Say what is mounted beyond the model's file, tool and load, as POST /robot/tool does: all later motions
    are planned with it, and the arm makes up for its weight. Kept over restarts. Only while the arm rests.

    Args:
        m: kg, up to robot.max_payload_kg of the settings.
        cog: [x, y, z] of its centre in the flange's frame, m.
        aom: [rx, ry, rz] of the inertia's axes in the flange's frame, rad.
        inertia: [xx, xy, xz, yy, yz, zz] about the centre, kg·m²; all 0 for a point.
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
    """How sensitive the arm is to being pushed.

    Returns:
        Always 0: there are no levels. The arm stops when a joint is further from where it should be than
        rt.tracking_error_rad in the settings.
    """
    return 0


@service("RobotConfig")
def set_collision_level(robot: Services, level: int) -> None:
    """See that the arm has this sensitivity: there are no levels, see getCollisionLevel.

    Args:
        level: 0.
    """
    if level != 0:
        raise NotSupportedError(
            "there are no collision levels; rt.tracking_error_rad in the settings is what stops the arm"
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
    """Refuse values beyond bounds, above them or, if they are the least possible ones, below them."""
    for joint, value, bound in zip(robot.robot.limits.names, values, bounds, strict=True):
        if value < bound if least else value > bound:
            words = "at least" if least else "at most"
            raise LimitError(f"{name}: {joint} is {value:g} {unit}, possible is {words} {bound:g} {unit}")


def _pair(values: list[float], most: tuple[float, float], name: str) -> tuple[float, float]:
    if len(values) != 2:
        raise InputError(f"{name} must be [linear, angular], got {len(values)} numbers")
    for value, bound in zip(values, most, strict=True):
        if not MIN_VALUE <= value <= bound:
            raise LimitError(f"{name}: possible is from {MIN_VALUE} to {bound:g}, got {value:g}")
    return values[0], values[1]
