"""The planned path that is being followed: piecewise quintics P(s) of the path time s."""

from cobot.types import Array

class Path:
    """Evaluated without allocation. Call `begin` after writing to its arrays.

    Attributes:
        segments: how many it has; 0 before the first path.
        duration_s: path time at the end.
        breakpoints_s: shape (capacity + 1,), of which the first `segments` + 1 count.
        coefficients: shape (capacity, dof, 6): rad, rad/s, ... in the time since the segment's start.
    """

    @property
    def segments(self) -> int: ...
    @property
    def duration_s(self) -> float: ...
    @property
    def breakpoints_s(self) -> Array: ...
    @property
    def coefficients(self) -> Array: ...
    def __init__(self, capacity: int, dof: int) -> None:
        """
        Raises:
            InputError: too many joints.
        """
    def begin(self, segments: int) -> None:
        """From now on the path has so many segments, and is evaluated from its start on.

        Raises:
            ValueError: more than there is room for.
        """
    def evaluate(self, path_time_s: float, rate: float, slope: float, out: Array) -> None:
        """Where the joints are at a path time not before the last one. Real-time safe.

        Args:
            rate, slope: first and second derivative of the path time, 1 and 1/s.
            out: shape (3, dof): rad, rad/s, rad/s²; with the path P(s), P, P' r and P'' r² + P' r'.
        """
    def sample(self, times_s: Array) -> Array:
        """First to third derivative at path times, shape (3, n, dof); at rest past the end."""
    def breakpoints(self, from_s: float, to_s: float) -> Array:
        """The path's breakpoints between two path times, some of them where they are many."""
    def continues(self, old: Path, offset_s: float, from_s: float, until_s: float) -> bool:
        """Whether this path goes on as another one: from one of its path times until another it has the same
        polynomials, bit for bit, as `old` at times that are later by an offset.

        Raises:
            ValueError: a path of another number of joints.
        """
    def increases(self, begin: int, end: int) -> bool:
        """Whether these breakpoints are finite, later than the one before, and the first is 0."""
    def is_finite(self, begin: int, end: int) -> bool:
        """Whether the coefficients of these segments are."""
    def stays_within(self, begin: int, end: int, low: Array, high: Array) -> bool:
        """Whether all positions of these segments, looked at in nine places of each, are between these."""
