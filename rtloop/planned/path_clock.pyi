"""Path time: how far the arm is along its motion, and how fast it moves on."""

from cobot.types import JointLimits
from rtloop.planned.path import Path

class PathClock:
    """Advances the path time of one motion. Real-time safe.

    Attributes:
        path_time_s: how far the arm is along its motion.
        rate, rate_slope: its first and second derivative, 1 and 1/s.
        target_rate: what it goes over to: what was requested last, times the share.
        share: what the device permits of all rates, from 0 to 1.
    """

    @property
    def path_time_s(self) -> float: ...
    @property
    def rate(self) -> float: ...
    @property
    def rate_slope(self) -> float: ...
    @property
    def target_rate(self) -> float: ...
    @property
    def share(self) -> float: ...
    def __init__(self, limits: JointLimits, period_s: float) -> None:
        """
        Raises:
            InputError: too many joints.
        """
    def reset(self) -> None:
        """Back to the beginning of a path, at full rate: of that what the device permits."""
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
    def scale(self, share: float) -> None:
        """Have all rates be so much of what is asked for, now and from every reset on."""
    def hold(self, held: bool) -> None:
        """Come to rest on the path whatever is requested, or go on as requested."""
    def advance(self, path: Path) -> None:
        """One period on."""
