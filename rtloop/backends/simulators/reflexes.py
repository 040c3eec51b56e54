"""Checks for commands that a simulated controller rejects."""

from __future__ import annotations

import numpy as np

from cobot.types import Array
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.results import ACCEPTED, Accepted, Rejected

VELOCITY_SHARE = 1.05
"""Share of a joint's velocity limit above which the motion is stopped."""
JUMP_RAD_S2 = 60.0
"""Maximum acceleration of the commands, rad/s². Planned motions have a fraction of it."""
SLACK_RAD_S = 1e-3
LIMIT_RAD = 0.01
"""Minimum distance of a command from a joint's limits, rad. Closer commands are rejected."""
MAX_WRENCH = 1000.0
"""Maximum force and torque at the TCP, N and N·m. An arm can exert only a fraction of them."""
T1_M_S = 0.25
"""Maximum speed of the TCP in T1, m/s: the reduced speed of ISO 10218-1."""


def check_command(
    arm: ControllerArm,
    position: Array,
    velocity: Array,
    last_velocity: Array,
    time_s: float,
    *,
    in_t1: bool = False,
) -> Accepted | Rejected:
    """Check a command. If it is rejected, the running motion ends.

    Args:
        velocity: velocity since the previous command, rad/s.
        last_velocity: velocity at the previous command, rad/s.
        time_s: time between the two commands, s.
        in_t1: whether the operation mode is T1, which limits the speed.
    """
    if not np.isfinite(position).all():
        return Rejected("the client commands a position that is not finite")
    limits = arm.limits
    outside = np.maximum(limits.min_position - position, position - limits.max_position)
    joint = int(outside.argmax())
    if outside[joint] > LIMIT_RAD:
        return Rejected(
            f"{limits.names[joint]} is commanded to {position[joint]:.6g} rad, but its limits are "
            f"{limits.min_position[joint]:.3f} and {limits.max_position[joint]:.3f} rad"
        )
    speed = np.abs(velocity) / limits.max_velocity
    joint = int(speed.argmax())
    if speed[joint] > VELOCITY_SHARE:
        return Rejected(
            f"{limits.names[joint]} is commanded to move at {velocity[joint]:.6g} rad/s, but its limit "
            f"is {limits.max_velocity[joint]:.3f} rad/s"
        )
    change = np.abs(velocity - last_velocity)
    joint = int(change.argmax())
    if change[joint] > JUMP_RAD_S2 * time_s + SLACK_RAD_S:
        return Rejected(
            f"the command of {limits.names[joint]} jumps: its velocity changes by {change[joint]:.6g} rad/s "
            f"in {time_s * 1e3:.0f} ms"
        )
    if in_t1 and (tcp := arm.speed_at(velocity)) > T1_M_S:
        return Rejected(f"the TCP is commanded to move at {tcp:.3f} m/s; in T1 the maximum is {T1_M_S} m/s")
    return ACCEPTED
