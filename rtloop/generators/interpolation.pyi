"""A reference for every cycle, made of commands that come less often: see interpolation.pyx."""

from cobot.types import Array

class Interpolator:
    """Turns commands into references. Real-time safe.

    Attributes:
        reference: where to be in this cycle, shape (3, n): position, velocity, acceleration. Owned here,
            overwritten by each call.
    """

    reference: Array

    def __init__(self, n: int, period_s: float) -> None:
        """An interpolator of n coordinates.

        Raises:
            InputError: they are more than the compiled cycle has room for.
        """

    def begin(self, state: Array) -> None:
        """Start here, shape (3, n), forget all commands, and hold (what moves is brought to rest)."""

    def rebase(self, state: Array, target: Array) -> None:
        """The current reference and the last target in other coordinates; an `aim` has to follow."""

    def aim(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        """A new command, shape (n,), to be reached `duration_s` from now: one command period.

        Args:
            velocity: at the target, as the sender states it; None: estimated where it is needed.
        """

    def advance(self) -> None:
        """One period on."""

class Hold(Interpolator):
    """No interpolation: the reference is the newest target."""

class Linear(Interpolator):
    """Constant velocity from where the reference is to the target, over one command period; then it rests."""
