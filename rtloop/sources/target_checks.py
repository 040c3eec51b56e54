"""What a streamed command has to pass.

A pose is shape (7,): x, y, z in m and a quaternion (w, x, y, z) of any sign.
"""

from __future__ import annotations

import math

import numpy as np

from cobot.robot import quaternion
from cobot.types import Array

JOINT_VELOCITY = 10.0
LINEAR_VELOCITY = 10.0
ANGULAR_VELOCITY = 50.0
"""rad/s, m/s, rad/s: no sender means this. What would need more between two commands is a jump."""
DEFAULT_INTERVAL_S = 0.01
SHORTEST_INTERVAL_S = 0.001
LONGEST_INTERVAL_S = 0.1
"""Between two commands: before there are two, and the bounds for what is measured."""
SLACK_S = 0.01
"""How much later than its predecessor a command may have been meant than it came."""


def angular_distance(first: Array, second: Array) -> float:
    """The angle in [0, π] between two orientations (w, x, y, z), rad."""
    return math.hypot(*quaternion.between(first.tolist(), second.tolist()))


def is_finite(values: Array) -> bool:
    """Whether all values are numbers; of none at all they are."""
    return bool(np.isfinite(values).all())


def clamped_interval(interval_s: float) -> float:
    """The interval that thresholds are made of: neither a burst nor a pause makes them extreme."""
    return min(max(interval_s, SHORTEST_INTERVAL_S), LONGEST_INTERVAL_S)


def joint_jump(
    target: Array,
    last: Array,
    interval_s: float = DEFAULT_INTERVAL_S,
    max_velocity: Array | None = None,
    names: tuple[str, ...] = (),
) -> str:
    """Whether a joint would have to jump from the last target to this one.

    Args:
        target, last: shape (dof,), rad.
        interval_s: between the two commands.
        max_velocity: the robot's own, shape (dof,), rad/s. It is allowed `SLACK_S` more time: that a sender
            is not punctual is no jump.
        names: of the joints, for the text.
    """
    if target.shape != last.shape:
        return f"{target.size} joints instead of {last.size}"
    interval_s = clamped_interval(interval_s)
    step = np.abs(target - last)
    threshold = np.full(last.size, JOINT_VELOCITY * interval_s)
    if max_velocity is not None:
        np.minimum(threshold, max_velocity * (interval_s + SLACK_S), out=threshold)
    inside = step <= threshold  # false for a NaN too
    if inside.all():
        return ""
    joint = int(inside.argmin())
    name = names[joint] if names else f"joint{joint + 1}"
    return f"{name} would jump by {step[joint]:.4f} rad, allowed are {threshold[joint]:.4f} rad"


def cartesian_jump(
    pose: Array,
    last: Array,
    interval_s: float = DEFAULT_INTERVAL_S,
    max_linear: float = LINEAR_VELOCITY,
    max_angular: float = ANGULAR_VELOCITY,
) -> str:
    """Whether the TCP would have to jump from the last pose to this one, `interval_s` between the two."""
    if pose.shape != (7,) or last.shape != (7,):
        return f"{pose.size} numbers instead of 7"
    interval_s = clamped_interval(interval_s)
    distance, angle = math.dist(pose[:3].tolist(), last[:3].tolist()), angular_distance(pose[3:], last[3:])
    if not distance <= max_linear * interval_s:
        return f"the TCP would jump by {distance:.4f} m, allowed are {max_linear * interval_s:.4f} m"
    if not angle <= max_angular * interval_s:
        return (
            f"the TCP would turn by {angle:.4f} rad at once, allowed are {max_angular * interval_s:.4f} rad"
        )
    return ""
