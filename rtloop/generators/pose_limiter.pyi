"""The TCP's own limits: of velocity, acceleration and jerk, linear and angular, by norm."""

import numpy.typing as npt

from cobot.types import Array, CartesianLimits
from rtloop.generators.target_range import PoseRange

class PoseLimiter:
    """Follows a pose within the limits. Real-time safe. See pose_limiter.pyx.

    Attributes:
        pose: shape (7,), m and (w, x, y, z).
        twist: its mean velocity in the last period, shape (6,), m/s and rad/s, in the base frame.
        speed: its twist at the end of that period, shape (6,).
        acceleration: the rate of the twist, shape (6,), m/s² and rad/s².
        limited: whether the pose is not the request.
    """

    pose: Array
    twist: Array
    acceleration: Array
    speed: Array
    limited: bool

    def __init__(self, period_s: float, limits: CartesianLimits) -> None: ...
    def stay_within(self, targets: PoseRange | None) -> None:
        """Stop within the range of the targets from now on; None permits every pose."""

    def begin(self, pose: Array, twist: npt.ArrayLike = 0.0) -> None:
        """Start here, with this motion."""

    def step(self, pose: Array) -> None:
        """One period on, towards this pose."""
