"""A first time parameterization along a path: fast where the path allows it, smooth, and at rest at both
ends."""

from cobot.types import Array

def reference_motion(
    first: Array, second: Array, jerk: Array, speed: Array, length: float, bounds: tuple[int, int, float]
) -> tuple[Array, Array]:
    """The control points of s(τ), shape (cells + 3,), and the relative durations of the cells, (cells,)."""
