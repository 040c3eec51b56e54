"""The motion within velocity, acceleration and jerk that stays in a corridor around a curve, if there is one.

Of a spline's control points four things are asked: that they lie in the corridor, and that their first three
differences keep the bounds. Each alone is a projection, and the points that meet all of them best are one
banded system: the alternating direction method of multipliers goes from one to the other. The corridor moves
with the points: along the curve they may be earlier or later. The same in numpy: tests/laws/jerk_fit.py.

Source: Boyd et al., "Distributed Optimization and Statistical Learning via the Alternating Direction Method
of Multipliers", 2011, sections 3.1, 3.4.3 (over-relaxation) and 5.

Attributes:
    WEIGHTS: of corridor, velocity, acceleration and jerk, each by its bound: what converges soonest.
    RELAXATION: how far beyond its aim a turn goes, from 1 to 2.
    TURNS_PER_PLACE: after so many turns the corridor is moved to where the points are by then.
    LEAD_STEPS: by so many steps of the curve a point may be before or after its schedule: what is lost in one
        place is not made up for by haste in another.
"""

from cobot.planners.corridor import AskedCurve
from cobot.types import Array, JointLimits

WEIGHTS: tuple[float, float, float, float]
RELAXATION: float
TURNS_PER_PLACE: int
LEAD_STEPS: int

def fit(
    asked: AskedCurve,
    control: Array,
    times_s: Array,
    step_s: float,
    limits: JointLimits,
    corridor: Array,
    turns: int,
) -> tuple[Array, Array]:
    """Control points nearer to all bounds than the given ones.

    Args:
        control: shape (n, dof), rad; both ends rest, and stay where they are.
        times_s: of the curve, where each of them belongs to, shape (n,): their schedule.
        corridor: largest deviation of each joint from the curve, shape (dof,), rad.

    Returns:
        Control points, and the times of the curve that they belong to by now.
    """
