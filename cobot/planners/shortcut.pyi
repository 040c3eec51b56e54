from cobot.robot.clearance import Clearance
from cobot.types import Array

def shorten(clearance: Clearance, corners: Array, seed: int, end_s: float = ...) -> Array:
    """A polyline with the same ends that is no longer and just as free, shape (m, dof).

    Cuts between random points of the polyline are tried, the most promising ones only: the gain is known
    before the motion is checked.

    Args:
        corners: shape (n, dof), n at least 2.
        end_s: time of `time.monotonic` after which no further change is tried.
    """

def draw_in(clearance: Clearance, corners: Array, end_s: float = ...) -> Array:
    """A polyline as that of `shorten`, with every corner moved towards the line between its neighbours as far
    as the motion stays free. This takes longer than cuts, because corners get near to what they go around.
    """
