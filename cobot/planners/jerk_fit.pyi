"""Finds a motion within limits of velocity, acceleration and jerk that stays in a corridor around a curve.

The control points of a spline must meet four conditions: they lie in the corridor, and their first three
differences keep the bounds. Each condition alone is a projection. The points that meet all conditions best
solve one banded system. The alternating direction method of multipliers alternates between the two. The
corridor moves with the points, because they may be earlier or later along the curve. tests/laws/jerk_fit.py
has the same method in numpy.

Source: Boyd et al., "Distributed Optimization and Statistical Learning via the Alternating Direction Method
of Multipliers", 2011, sections 3.1, 3.4.3 (over-relaxation) and 5.

Attributes:
    WEIGHTS: weights of corridor, velocity, acceleration and jerk, relative to their bounds, for fast
        convergence.
    RELAXATION: over-relaxation factor of an iteration, from 1 to 2.
    TURNS_PER_PLACE: number of iterations after which the corridor is moved to the points.
    LEAD_STEPS: number of steps of the curve by which a point may be ahead of its schedule or behind it, so
        that a delay in one place does not cause haste in another.
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
    """Control points that violate the bounds less than the given ones.

    Args:
        control: shape (n, dof), rad; both ends are at rest and do not change.
        times_s: the schedule: the time on the curve that corresponds to each control point, shape (n,).
        corridor: largest deviation of each joint from the curve, shape (dof,), rad.

    Returns:
        Control points, and the times on the curve that now correspond to them.
    """
