"""Checks of a gripper request, before anything moves."""

from __future__ import annotations

from cobot.errors import LimitError, NotSupportedError
from cobot.findings import Finding
from cobot.grippers import Grasp, GripperCapabilities
from cobot.motions.gripper_bodies import AnyGripperCommand, GripperGrasp, GripperMove, GripperRelease
from cobot.strict import unit_advice

SLACK_M = 1e-9


def check_command(name: str, able: GripperCapabilities, command: AnyGripperCommand) -> None:
    """Check that the gripper supports a command with the given values.

    Args:
        name: the gripper's type, for errors.

    Raises:
        LimitError: a value is out of range.
        NotSupportedError: the gripper does not support this command.
    """
    if isinstance(command, GripperMove | GripperGrasp | GripperRelease) and command.width is not None:
        _check_width(name, able, command.width, grasps=isinstance(command, GripperGrasp))
    if isinstance(command, GripperMove | GripperGrasp):
        _check_range(name, "speed", command.speed, able.speed_m_s, "m/s")
        _check_range(name, "force", command.force, able.force_n, "N")
    if isinstance(command, GripperGrasp) and not able.object_detection and command.if_missed == "success":
        raise NotSupportedError(
            f"if_missed is success, but the gripper {name} does not detect objects: omit if_missed"
        )


def grasp_of(command: GripperGrasp) -> Grasp:
    return Grasp(
        command.width, command.tolerance_inner, command.tolerance_outer, command.speed, command.force
    )


def _check_width(name: str, able: GripperCapabilities, width: float, *, grasps: bool) -> None:
    if able.width_m is None:
        advice = "omit it" if grasps else "use grasp and release"
        raise NotSupportedError(f"width is {width:g} m, but the gripper {name} has no width: {advice}")
    least, most = able.width_m
    if not least - SLACK_M <= width <= most + SLACK_M:
        advice = unit_advice("width", width, most)
        raise LimitError(
            f"width is {width:g} m, but the gripper {name} allows {least:g} to {most:g} m{advice}",
            findings=[_beyond("width", width, able.width_m, "m")],
        )
    if not able.continuous and not grasps and min(width - least, most - width) > SLACK_M:
        raise LimitError(
            f"width is {width:g} m, but the gripper {name} has only two positions: {least:g} m (closed) "
            f"and {most:g} m (open)"
        )


def _check_range(
    name: str, what: str, value: float | None, bounds: tuple[float, float] | None, unit: str
) -> None:
    if value is None:
        return
    if bounds is None:
        raise NotSupportedError(f"{what} is {value:g} {unit}, but the gripper {name} has no {what} control")
    if not bounds[0] <= value <= bounds[1]:
        raise LimitError(
            f"{what} is {value:g} {unit}, but the gripper {name} allows {bounds[0]:g} to {bounds[1]:g} "
            f"{unit}",
            findings=[_beyond(what, value, bounds, unit)],
        )


def _beyond(what: str, value: float, bounds: tuple[float, float], unit: str) -> Finding:
    return Finding("limit", what, value, min(max(value, bounds[0]), bounds[1]), unit, of=(what,))
