"""How far a stream's reference may go beyond its targets."""

from cobot.types import Array

SHARE: float
"""Share of the recent way of the targets by which the reference may go beyond the newest one."""
FADING_S: float
"""Time constant with which older steps of the targets are forgotten."""
STILL_S: float
STILL_PERIODS: float
"""A target that has not changed for this time and for this many command periods stands still."""

class TargetRange:
    """Bounds for the reference, from the targets so far. Real-time safe.

    An arm that follows a moving target without a lag needs a way to stop beyond it, as no one knows whether
    another target comes. So the reference may go beyond the newest target, in the direction of its last step,
    by `SHARE` of the way that the recent targets have made. Older steps count less, and the longest one does
    not count: a single step is a target that stands still, and gets nothing. In the other direction the bound
    is the one of the last turn. A target that stands still is a bound itself.
    """

    @property
    def n(self) -> int: ...
    def __init__(self, n: int, period_s: float, command_s: float) -> None:
        """The range of n coordinates; `command_s` is the time between two targets.

        Raises:
            InputError: more coordinates than the compiled cycle has room for.
        """
    @property
    def low(self) -> Array:
        """Lowest permitted position, a copy, shape (n,)."""
    @property
    def high(self) -> Array:
        """Highest permitted position, a copy, shape (n,)."""
    def begin(self, position: Array) -> None:
        """A new stream begins at this position, shape (n,), which is the only target so far."""
    def open(self) -> None:
        """Permit every position until the next `begin`."""
    def expect(self, command_s: float) -> None:
        """The next target is due in this time, which the sender states with each."""
    def update(self, target: Array) -> None:
        """A new target, shape (n,)."""
    def advance(self) -> None:
        """One period on."""
