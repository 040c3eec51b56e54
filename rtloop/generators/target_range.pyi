"""How far a stream's reference may go beyond its targets."""

from cobot.types import Array

SHARE: float
"""Share of the recent way of joint targets by which the reference may go beyond the newest one."""
POSE_SHARE: float
"""Share of the margin for poses. The TCP's jerk limit is low: with less it follows a circle with a lag."""
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
    def __init__(self, n: int, period_s: float, command_s: float, share: float = ...) -> None:
        """The range of n coordinates; `command_s` is the time between two targets, `share` is in place of
        `SHARE`.

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
    def open_at(self, target: Array) -> None:
        """A new target, shape (n,), whose sender states that it moves on: permit every position, but only for
        as long as the target does not stand still."""
    def extend(self, target: Array) -> None:
        """A target that is known ahead, shape (n,): extend the bounds to it."""
    def expect(self, command_s: float) -> None:
        """The next target is due in this time, which the sender states with each."""
    def update(self, target: Array) -> None:
        """A new target, shape (n,)."""
    def advance(self) -> None:
        """One period on."""

class PoseRange:
    """A `TargetRange` of poses of a TCP: x, y, z, and turns about the axes of the base. Real-time safe."""

    @property
    def chart(self) -> TargetRange:
        """The range of the positions and of the sums of the turns."""
    def __init__(self, period_s: float, command_s: float, share: float = ...) -> None:
        """`command_s` is the time between two poses, `share` is in place of `POSE_SHARE`."""
    def begin(self, pose: Array) -> None:
        """A new stream begins at this pose, shape (7,), which is the only target so far."""
    def update(self, pose: Array, states_motion: bool = False) -> None:
        """A new pose, shape (7,); the sender may state that it moves on."""
    def advance(self) -> None:
        """One period on."""
    def stands(self, pose: Array) -> bool:
        """Whether this is the newest pose, shape (7,), and stands still."""
    def room(self, pose: Array) -> tuple[Array, Array]:
        """How far it is from a pose down and up to the bounds, shape (6,) each: m and rad."""
