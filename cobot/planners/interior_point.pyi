"""The fastest rate along a reference motion that keeps limits of velocity, acceleration, jerk and torque.

Attributes:
    Stations: the places at which one kind of limit is checked.
"""

from cobot.types import Array

class Stations:
    def __init__(
        self,
        cells: Array,
        basis: Array,
        first: Array,
        second: Array,
        third: Array | None,
        low: Array,
        high: Array,
    ) -> None: ...
    def bound(self, low: Array, high: Array) -> None:
        """Change the bounds, shape (n, m) each."""

def fastest_rate(
    begin: Array, times: Stations, bounded: list[Stations], gap: float, iterations: int
) -> tuple[Array, float, int]:
    """The coefficients of the square of the rate, shape (cells + 2,), the remaining gap as a share of the
    duration, and the number of iterations. `begin` has the coefficients to begin with, except for a
    factor."""
