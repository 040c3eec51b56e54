"""What a stream of targets does at its end: velocity and acceleration, estimated."""

from cobot.types import Array

FITS: Array

def fit(count: int) -> Array:
    """Weights, shape (2, count), that give slope and curvature at the last of so many equidistant values."""

class Estimate:
    """What a stream does at its newest target. Real-time safe.

    A parabola is fitted to the newest targets, to at least three of them. The mean velocity of the last
    interval alone would be right for half an interval ago: a reference that believes it has to speed up
    and slow down between any two commands as soon as the stream accelerates.
    """

    def __init__(self, max_velocity: Array, max_acceleration: Array, window_s: float) -> None:
        """From the targets of the last `window_s`: the longer, the less there is of the sender's noise."""

    @property
    def target(self) -> Array:
        """The newest one, a copy, shape (n,)."""

    @property
    def velocity(self) -> Array:
        """At the newest target, within the limits, a copy, shape (n,)."""

    @property
    def acceleration(self) -> Array:
        """At the newest target, within the limits, a copy, shape (n,)."""

    def forget(self) -> None:
        """A new stream begins: its first target is one to rest at."""

    def rebase(self, target: Array) -> None:
        """The last target in other coordinates, of which only the origin counts."""

    def update(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        """Another target, one command period after the last; `velocity` is None or the sender's word."""

    def extrapolate(self, ahead_s: float, out: Array) -> None:
        """Where the stream is so long after its newest target, shape (3, n)."""
