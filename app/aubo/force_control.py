"""ForceControl: the TCP exerts a force along some axes and keeps its pose along the others."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from app.aubo.poses import place_of
from app.aubo.registry import Json, service
from cobot.errors import InputError, NotSupportedError

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "ForceControl"


class TaskFrame(IntEnum):
    """Reference of the force frame, with the numbers of the vendor interface."""

    NONE = 0
    POINT_FORCE = 1
    FRAME_FORCE = 2
    MOTION_FORCE = 3
    TOOL_FORCE = 4


@service(CLASS)
async def fc_enable(robot: Services) -> None:
    """Begin force control with the values from setTargetForce, setDynamicModel and fcSetSensorLimits.

    The arm holds its pose along the axes that are not force controlled. Force control is a streaming session,
    so planned motions are rejected until fcDisable. If a servo session of mode 6 or 7 begins later, it
    continues the force control. A stop ends force control.
    """
    await robot.force.enable()


@service(CLASS)
async def fc_disable(robot: Services) -> None:
    """End force control. Returns when the arm is at rest."""
    await robot.force.disable()


@service(CLASS)
def is_fc_enabled(robot: Services) -> bool:
    """Whether force control is on.

    Returns:
        true while force control is on; false after fcDisable, or after a stop, a limit or a threshold has
            ended it.
    """
    return robot.force.settings.enabled


@service(CLASS)
def get_fc_end_reason(robot: Services) -> str:
    """The reason why force control has ended on its own.

    Returns:
        the reason as a sentence; empty if force control has not ended on its own since fcEnable.
    """
    return robot.force.reason


@service(CLASS)
def set_target_force(
    robot: Services,
    feature: list[float],
    compliance: list[bool],
    wrench: list[float],
    limits: list[float],
    frame_type: int = TaskFrame.FRAME_FORCE,
) -> None:
    """Set the axes along which the TCP exerts a force, and the wrench. While force control is on, only the
    wrench may change.

    Args:
        feature: the force frame [x, y, z, rx, ry, rz], m and rad; empty for the reference frame itself, see
            frame_type.
        compliance: for each of x, y, z, rx, ry, rz: true if the force is controlled, false if the pose is.
        wrench: wrench of the TCP on its surroundings, in the force frame, N and N·m, 6 values.
        limits: maximum velocities of force control, m/s and rad/s, 6 values; 0 or empty for 0.1 and 0.5.
        frame_type: reference frame of the force frame: 2 the base frame, 4 the TCP frame; 0 means 2. 1 and 3
            are not supported.
    """
    if frame_type not in list(TaskFrame):
        valid = ", ".join(f"{each} {each.name.lower()}" for each in TaskFrame)
        raise InputError(f"there is no frame_type {frame_type}; valid values: {valid}")
    if frame_type in (TaskFrame.POINT_FORCE, TaskFrame.MOTION_FORCE):
        raise NotSupportedError(
            f"frame_type {frame_type}: a force frame that turns with a point or a motion is not supported; "
            f"use 2 or 4"
        )
    place = place_of(feature or [0.0] * 6, "feature")
    frame = np.concatenate([place.position, place.quaternion])
    robot.force.set_target(compliance, wrench, limits, frame, in_tcp=frame_type == TaskFrame.TOOL_FORCE)


@service(CLASS)
def set_dynamic_model(robot: Services, m: list[float], d: list[float], k: list[float]) -> None:
    """Set the compliance of the axes that keep their pose: each acts like a damped spring. Rejected while
    force control is on.

    Args:
        m: empty or zeros. Force control always has the arm's own inertia.
        d: damping ratios, from 0.3 to 1, 6 values; 0 or empty for 0.7.
        k: stiffness, N/m and N·m/rad, 6 values, up to the nominal stiffness; 0 or empty for the nominal one.
    """
    if any(m):
        raise NotSupportedError(
            f"m must be empty or zeros, because force control always has the arm's own inertia; got {m}"
        )
    robot.force.set_impedance(d, k)


@service(CLASS)
def get_dynamic_model(robot: Services) -> Json:
    """The values set by setDynamicModel.

    Returns:
        {"m": zeros, "d": damping ratios, "k": N/m and N·m/rad}, 6 values each; k is null for the nominal one.
    """
    settings = robot.force.settings
    return {"m": [0.0] * 6, "d": settings.damping_ratio, "k": settings.stiffness}


@service(CLASS)
def get_target_force(robot: Services) -> list[float]:
    """The wrench set by setTargetForce.

    Returns:
        N and N·m, 6 values, in the force frame.
    """
    return list(robot.force.settings.wrench)


@service(CLASS)
def get_external_wrench(robot: Services) -> list[float]:
    """The wrench of the surroundings on the TCP, estimated from the joint torques.

    Returns:
        N and N·m, 6 values, in the base frame.
    """
    wrench: list[float] = robot.force.external_wrench().tolist()
    return wrench


@service(CLASS)
def fc_set_sensor_thresholds(robot: Services, thresholds: list[float]) -> None:
    """Set the external wrench above which the arm is stopped and force control ends. Takes effect at once.

    The service checks it every 10 ms while force control is on, also in servo sessions.

    Args:
        thresholds: N and N·m at the TCP, along and about each axis of the base frame, 6 values; 0 for none.
    """
    robot.force.set_thresholds(thresholds)


@service(CLASS)
def get_fc_sensor_thresholds(robot: Services) -> list[float]:
    """The thresholds set by fcSetSensorThresholds.

    Returns:
        the thresholds, N and N·m, 6 values; 0 for none.
    """
    return _finite(robot.force.settings.thresholds)


@service(CLASS)
def fc_set_sensor_limits(robot: Services, limits: list[float]) -> None:
    """Set the external wrench above which the real-time process ends force control at once. Rejected while
    force control is on.

    Args:
        limits: N and N·m at the TCP, along and about each axis of the base frame, 6 values; 0 for none.
    """
    robot.force.set_limits(limits)


@service(CLASS)
def get_fc_sensor_limits(robot: Services) -> list[float]:
    """The limits set by fcSetSensorLimits.

    Returns:
        the limits, N and N·m, 6 values; 0 for none.
    """
    return _finite(robot.force.settings.limits)


def _finite(bounds: tuple[float, ...]) -> list[float]:
    return [bound if np.isfinite(bound) else 0.0 for bound in bounds]
