"""The fastest reference to a moving target that keeps the limits, planned again with each target."""

from cobot.types import Array
from rtloop.generators.interpolation import Interpolator

WINDOW_S: float

class OnlineTrajectory(Interpolator):
    """The fastest profile to the moving target, within the limits of velocity, acceleration and jerk.

    See online_trajectory.pyx.
    """

    def __init__(
        self, n: int, period_s: float, max_velocity: Array, max_acceleration: Array, max_jerk: Array
    ) -> None:
        """The limits are shape (n,)."""

    def forget(self) -> None:
        """What comes next is no part of the stream so far."""

    def settle(self, state: Array, target: Array) -> None:
        """From this state, shape (3, n), to rest at the target."""
