"""Path time: how far the arm is along its motion, and how fast it moves on."""

from cobot.types import JointLimits
from rtloop.planned.path import Path

class PathClock:
    """Advances the path time of one motion. Real-time safe.

    Attributes:
        path_time_s: how far the arm is along its motion.
        rate, rate_slope: its first and second derivative, 1 and 1/s.
        target_rate: what was requested last.
    """

    @property
    def path_time_s(self) -> float: ...
    @property
    def rate(self) -> float: ...
    @property
    def rate_slope(self) -> float: ...
    @property
    def target_rate(self) -> float: ...
    def __init__(self, limits: JointLimits, period_s: float) -> None:
        """
        Raises:
            InputError: too many joints.
        """
    def reset(self) -> None:
        """Back to the beginning of a path, at full rate."""
    def shift(self, offset_s: float) -> None:
        """Be at the same place on a path that has begun so much later."""
    @property
    def committed_s(self) -> float:
        """Up to which path time a profile that is under way relies on the path; where there is none, now."""
    @property
    def at_rest(self) -> bool:
        """Whether path time stands still, and nothing is about to change that."""
    @property
    def slowing(self) -> bool:
        """Whether a profile towards the target rate is under way."""
    @property
    def stuck(self) -> bool:
        """Whether the path has left no room to change the rate for as long as a joint at its limits would
        have taken to come to rest. Only a path beyond the limits should do that.
        """
    def request(self, rate: float) -> None:
        """Go over to another rate, as soon and as fast as the joints permit."""
    def advance(self, path: Path) -> None:
        """One period on."""
