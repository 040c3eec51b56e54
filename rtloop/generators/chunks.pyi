"""Action chunks: a policy sends its next waypoints, each with its time. See chunks.pyx."""

from cobot.types import Array
from rtloop.results import Accepted, Rejected

class ChunkInterpolator:
    """Follows chunks of waypoints. Real-time safe.

    Attributes:
        reference: where to be in this cycle, shape (3, n): position, velocity, acceleration.
        late: waypoints that were dropped because their time had passed, refused chunks included.
        starved: how often the waypoints ran out, and it had to brake.
    """

    reference: Array
    late: int
    starved: int

    def __init__(
        self, n: int, period_s: float, max_velocity: Array, max_acceleration: Array, max_jerk: Array
    ) -> None:
        """The limits are shape (n,).

        Raises:
            InputError: they are more than the compiled cycle has room for.
        """

    def begin(self, state: Array) -> None:
        """Start here, shape (3, n), forget all waypoints, and hold (what moves is brought to rest)."""

    def take(self, times_s: Array, positions: Array, now_s: float) -> Accepted | Rejected:
        """Replace what lies ahead from the first of these waypoints on that is not past.

        Args:
            times_s: when the waypoints are meant, on the robot's clock, increasing, shape (k,).
            positions: where, shape (k, n).
            now_s: the time of the reference as it is.

        Returns:
            `Rejected` if the chunk is not taken; then nothing has changed but `late`.
        """

    def advance(self, now_s: float) -> None:
        """The reference for this time; it must not go back, nor pass the last waypoint unnoticed."""

def spline(times_s: Array, points: Array) -> tuple[Array, Array]:
    """Velocity and acceleration, each shape (k, n), at the knots of the cubic spline through points (k, n)
    whose first and last pieces are parabolas; a single point is one to rest at."""
