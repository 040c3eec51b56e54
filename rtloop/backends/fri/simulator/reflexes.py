"""Checks for client commands that a cabinet rejects."""

from __future__ import annotations

import numpy as np

from cobot.types import Array
from rtloop.backends.fri.messages import CommandMessage, CommandMode
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.reflexes import MAX_WRENCH
from rtloop.results import ACCEPTED, Accepted, Rejected

ECHO_RAD = 1e-3
"""Maximum distance of a command from the interpolator while the motion is waiting, rad."""


def usable(command: CommandMessage, mode: CommandMode, dof: int) -> bool:
    """Whether a command contains all values that the overlay needs."""
    return (
        len(command.position) == dof
        and (mode != CommandMode.TORQUE or len(command.torque) == dof)
        and (mode != CommandMode.WRENCH or len(command.wrench) == 6)
    )


def check_overlay(command: CommandMessage, mode: CommandMode) -> Accepted | Rejected:
    """Check the torques or the wrench in a command. If they are rejected, the motion ends. Finite torques are
    then clamped to the drives' limits.
    """
    if mode == CommandMode.TORQUE and not np.isfinite(command.torque).all():
        return Rejected("the client commands a torque that is not finite")
    if mode != CommandMode.WRENCH:
        return ACCEPTED
    if not np.isfinite(command.wrench).all():
        return Rejected("the client commands a wrench that is not finite")
    most = max(command.wrench, key=abs)
    if abs(most) > MAX_WRENCH:
        return Rejected(f"the client commands a wrench of {most:.6g}, allowed: {MAX_WRENCH:g} N or N·m")
    return ACCEPTED


def check_echo(arm: ControllerArm, position: Array) -> Accepted | Rejected:
    """Check that a waiting motion may begin."""
    off = np.abs(position - arm.setpoint)
    if not np.isfinite(off).all():
        return Rejected("the client commands a position that is not finite")
    joint = int(off.argmax())
    if off[joint] > ECHO_RAD:
        return Rejected(
            f"{arm.limits.names[joint]} is commanded {off[joint]:.6g} rad from the interpolator, "
            f"allowed: {ECHO_RAD} rad while the motion waits"
        )
    return ACCEPTED
