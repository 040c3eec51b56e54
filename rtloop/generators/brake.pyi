"""To rest, within the limits of acceleration and jerk."""

from cobot.types import Array

class Brake:
    """Brings a reference to rest, each coordinate for itself, as fast as the limits permit, and without
    turning back. Real-time safe."""

    def __init__(self, period_s: float, max_acceleration: Array, max_jerk: Array) -> None:
        """The limits are shape (n,)."""

    def begin(self, reference: Array) -> None:
        """Brake from this state, shape (3, n)."""

    def advance(self, reference: Array) -> bool:
        """One period on. Returns whether the reference is at rest."""
