"""Creates the interpolator that a stream requests."""

from __future__ import annotations

from cobot.ipc.layout import Interpolation
from cobot.types import Array
from rtloop.generators.interpolation import Hold, Interpolator, Linear
from rtloop.generators.online_trajectory import OnlineTrajectory
from rtloop.generators.quintic import Quintic


def make_interpolator(
    kind: Interpolation,
    n: int,
    period_s: float,
    max_velocity: Array,
    max_acceleration: Array,
    max_jerk: Array,
) -> Interpolator:
    """Create an interpolator for n coordinates. The limits have shape (n,) and the units of the
    coordinates.
    """
    if kind is Interpolation.NONE:
        return Hold(n, period_s)
    if kind is Interpolation.LINEAR:
        return Linear(n, period_s)
    smooth = Quintic if kind is Interpolation.QUINTIC else OnlineTrajectory
    return smooth(n, period_s, max_velocity, max_acceleration, max_jerk)
