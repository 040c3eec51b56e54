"""The motion within velocity, acceleration and jerk that stays in a corridor around a curve, if there is one.

Of a spline's control points four things are asked: that they lie in the corridor, and that their first three
differences keep the bounds. Each alone is a projection, and the points that meet all of them best are one
banded system: the alternating direction method of multipliers goes from one to the other. The corridor moves
with the points: along the curve they may be earlier or later.

Source: Boyd et al., "Distributed Optimization and Statistical Learning via the Alternating Direction Method
of Multipliers", 2011, sections 3.1, 3.4.3 (over-relaxation) and 5.
"""

from __future__ import annotations

from math import comb

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from cobot.planners.corridor import AskedCurve, shift_along
from cobot.planners.timing.uniform_spline import AT_REST
from cobot.types import Array, JointLimits

WEIGHTS = (0.003, 0.3, 3.0, 1.0)
"""Of corridor, velocity, acceleration and jerk, each in shares of its bound: what converges soonest."""
RELAXATION = 1.6
TURNS_PER_PLACE = 5
"""After so many turns the corridor is moved to where the points are by now."""
LEAD_STEPS = 3
ORDERS = range(4)


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
        times_s: of the curve, where each of them belongs to, shape (n,).
        corridor: how far each joint may be beside the curve, shape (dof,), rad.

    Returns:
        Control points, and the times of the curve that they belong to by now.
    """
    origin = control[0]
    bounds = [limits.max_velocity * step_s, limits.max_acceleration * step_s**2, limits.max_jerk * step_s**3]
    weights = [
        weight / float(scale.mean()) ** 2 for weight, scale in zip(WEIGHTS, (corridor, *bounds), strict=True)
    ]
    free = slice(AT_REST, len(control) - AT_REST)
    factor = cholesky_banded(_matrix(len(control), weights)[:, free], check_finite=False)
    points = control - origin
    ends = points.copy()
    ends[free] = 0.0
    pull_of_ends = _pull(_differences(ends), weights)[free]
    tube = _Tube(asked, times_s, origin, corridor, limits)
    wanted = _nearest(_differences(points), tube, bounds)
    owed = [np.zeros_like(each) for each in wanted]
    for turn in range(1, turns + 1):
        aims = [want - owe for want, owe in zip(wanted, owed, strict=True)]
        right = _pull(aims, weights)[free] - pull_of_ends
        points[free] = cho_solve_banded((factor, False), right, overwrite_b=True, check_finite=False)
        relaxed = _differences(points)
        for order in ORDERS:
            relaxed[order] = RELAXATION * relaxed[order] + (1.0 - RELAXATION) * wanted[order] + owed[order]
        wanted = _nearest(relaxed, tube, bounds)
        owed = [each - want for each, want in zip(relaxed, wanted, strict=True)]
        if turn % TURNS_PER_PLACE == 0:
            tube.follow(points)
    return points + origin, tube.times_s


class _Tube:
    """The corridor where the points are now; a straight piece of it for each of them."""

    def __init__(
        self, asked: AskedCurve, times_s: Array, origin: Array, corridor: Array, limits: JointLimits
    ) -> None:
        self._asked = asked
        self._origin = origin
        self._corridor = corridor
        self._range = limits.min_position - origin, limits.max_position - origin
        self._scheduled_s = times_s
        self._place(times_s)

    def _place(self, times_s: Array) -> None:
        self.times_s = times_s
        self._there = self._asked.centre(times_s) - self._origin
        self._direction = self._asked.towards(times_s)

    def follow(self, points: Array) -> None:
        """Move along the curve to where it is nearest to the points."""
        lead_s = LEAD_STEPS * self._asked.step_s
        moved_s = np.clip(
            self.times_s + self._shift(points), self._scheduled_s - lead_s, self._scheduled_s + lead_s
        )
        self._place(self._asked.in_order(moved_s))

    def nearest(self, points: Array) -> Array:
        """The nearest positions within the corridor and the joints' ranges."""
        along = self._there + self._direction * self._shift(points)[:, None]
        beside = np.clip(points - along, -self._corridor, self._corridor)
        return np.clip(along + beside, *self._range)

    def _shift(self, points: Array) -> Array:
        shift = shift_along(points - self._there, self._direction)
        return np.clip(shift, -self._asked.step_s, self._asked.step_s)


def _differences(points: Array) -> list[Array]:
    found = [points]
    for _ in ORDERS[1:]:
        found.append(np.diff(found[-1], axis=0))
    return found


def _nearest(differences: list[Array], tube: _Tube, bounds: list[Array]) -> list[Array]:
    """The nearest values that keep each bound for itself."""
    rates = zip(differences[1:], bounds, strict=True)
    return [tube.nearest(differences[0]), *(np.clip(each, -bound, bound) for each, bound in rates)]


def _pull(differences: list[Array], weights: list[float]) -> Array:
    """The transposed differences of each order, weighted and summed, shape (n, dof)."""
    total = weights[-1] * differences[-1]
    for order in reversed(ORDERS[:-1]):
        longer = weights[order] * differences[order]
        longer[1:] += total
        longer[:-1] -= total
        total = longer
    return np.asarray(total)


def _matrix(count: int, weights: list[float]) -> Array:
    """What `_pull` of `_differences` is, as the upper half of a band, its main diagonal in the last row."""
    band = np.zeros((len(ORDERS), count))
    for order, weight in enumerate(weights):
        row = [(-1) ** k * comb(order, k) for k in range(order + 1)]
        for k, first in enumerate(row):
            for j in range(k, order + 1):
                band[-1 - (j - k), j : count - order + j] += weight * first * row[j]
    return band
