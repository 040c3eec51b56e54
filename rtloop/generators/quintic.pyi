"""References made of quintic polynomials, continuous to the acceleration."""

from cobot.types import Array
from rtloop.generators.interpolation import Interpolator

class Quintic(Interpolator):
    """Continuous to the acceleration, from where the reference is to where the stream will be.

    See quintic.pyx.
    """

    def __init__(
        self, n: int, period_s: float, max_velocity: Array, max_acceleration: Array, max_jerk: Array
    ) -> None:
        """The limits are shape (n,)."""
