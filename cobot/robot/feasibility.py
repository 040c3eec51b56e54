"""The one check of a trajectory against the joint limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot.errors import LimitError
from cobot.trajectory import Trajectory
from cobot.types import JointLimits

RELATIVE_TOLERANCE = 1e-6
"""Rounding that a value may exceed its limit by: planners drive exactly at the limits."""

ROUNDING = 1e-6
"""By how much more than needed a motion is stretched, so that rounding does not exceed the limits again."""

QUANTITIES = ("position", "velocity", "acceleration", "jerk")
UNITS = ("rad", "rad/s", "rad/s²", "rad/s³")


def check_limits(trajectory: Trajectory, limits: JointLimits, labels: Sequence[str] | None = None) -> None:
    """Refuse a trajectory whose true extrema leave the limits, whichever comes first in time.

    Args:
        labels: what the caller calls the breakpoints, for the message.

    Raises:
        LimitError: naming the place, the joint, the quantity, the value and the limit.
    """
    found = None
    for derivative, (low, high) in enumerate(_bounds(limits)):
        excess = trajectory.first_excess(derivative, low, high)
        if excess is not None and (found is None or excess[0] < found[1][0]):
            found = derivative, excess
    if found is None:
        return
    derivative, (segment, joint, value) = found
    low, high = _bounds(limits)[derivative]
    limit = low[joint] if value < low[joint] else high[joint]
    begin, end = trajectory.breakpoints_s[segment : segment + 2]
    place = f"from {begin:.3f} s to {end:.3f} s"
    if labels is not None:
        place = f"between {labels[segment]} and {labels[segment + 1]} ({place})"
    raise LimitError(
        f"{place} the {QUANTITIES[derivative]} of {limits.names[joint]} reaches "
        f"{value:.6g} {UNITS[derivative]}, its limit is {limit:.6g} {UNITS[derivative]}"
    )


def in_range(trajectory: Trajectory, limits: JointLimits) -> bool:
    """Whether all joints stay within their positions' limits."""
    return trajectory.first_excess(0, *_bounds(limits)[0]) is None


def stretch_to_limits(trajectory: Trajectory, limits: JointLimits) -> Trajectory:
    """The same path, slowed down evenly by just so much that all rate limits hold."""
    factor = 1.0
    for derivative in (1, 2, 3):
        low, high = trajectory.extrema(derivative)
        bound = _bounds(limits)[derivative][1]
        ratio = float(np.max(np.maximum(-low, high) / bound))
        factor = max(factor, ratio ** (1.0 / derivative))
    return trajectory if factor <= 1.0 else trajectory.stretched(factor * (1.0 + ROUNDING))


def _bounds(limits: JointLimits) -> list[tuple[np.ndarray, np.ndarray]]:
    slack = 1.0 + RELATIVE_TOLERANCE
    rates = [bound * slack for bound in (limits.max_velocity, limits.max_acceleration, limits.max_jerk)]
    span = RELATIVE_TOLERANCE * (limits.max_position - limits.min_position)
    return [(limits.min_position - span, limits.max_position + span), *((-rate, rate) for rate in rates)]
