"""Removal of rounding from points that have few decimals and short time steps, because the rounding would
spoil their jerk.

At 2 ms, half a unit of the sixth decimal is a jerk of hundreds of rad/s³. The smoothest curve within one unit
of every point represents the rounded numbers as well as the points themselves. The method is Whittaker's
smoothing. It minimises the sum of the squared deviations and the squared fourth differences, so that a motion
with constant jerk is unchanged.

Source: Eilers, "A perfect smoother", Analytical Chemistry 75, 2003, equations 4 to 6.
"""

from __future__ import annotations

import math

import numpy as np

from cobot.types import Array

DECIMALS = range(4, 10)
"""Numbers of decimals that can be recognised as rounding. With fewer decimals the correction would be too
large. With more decimals, there is nothing to correct.
"""
MIN_POINTS = 100
MAX_STEP_S = 0.02
"""Maximum time step for which points are treated as samples of a curve and are smoothed, s."""
UNEVEN = 0.01
"""Time steps between points are considered equal if they differ by at most this share."""
WINDOWS = (24.0, 16.0, 12.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.0)
"""Numbers of points over which the curve is smoothed. The largest number that keeps the curve within the
rounding is used.
"""
ORDER = 4
REST = 1e4
"""Weight of the condition that the motion starts and ends at rest, relative to the weight of the
differences.
"""
DIFFERENCE = np.array([(-1) ** k * math.comb(ORDER, k) for k in range(ORDER + 1)], dtype=np.float64)


def smoothed(times_s: Array, positions: Array) -> tuple[Array, float] | None:
    """The points without their rounding; the first and the last point do not move.

    Args:
        times_s: increasing times of the points, shape (n,).
        positions: joint positions of the points, shape (n, dof), rad. The motion is at rest at both ends.

    Returns:
        Positions of the same shape, which differ from the given ones by at most one unit of the last decimal,
        and this unit, rad. None if the points are not rounded to few decimals.
    """
    steps_s = np.diff(times_s)
    if len(times_s) < MIN_POINTS or steps_s.max() > MAX_STEP_S or np.ptp(steps_s) > UNEVEN * steps_s.max():
        return None
    unit = _unit(positions[1:-1])
    if unit is None:
        return None
    for window in WINDOWS:
        change = _change(positions, (window / math.pi) ** (2 * ORDER))
        if np.abs(change).max() <= unit:
            return positions + change, unit
    return None


def _unit(positions: Array) -> float | None:
    """The unit of the last decimal of the values, if they have few decimals; otherwise None."""
    for decimals in DECIMALS:
        if np.abs(np.round(positions, decimals) - positions).max() < 1e-3 * 10.0**-decimals:
            return float(10.0**-decimals)
    return None


def _change(positions: Array, weight: float) -> Array:
    """The change that smoothing makes to each row. Solving for the change is far more accurate than solving
    for the smoothed rows.

    Args:
        weight: weight of the differences; variations with a period below 2 π weight^(1/8) rows are removed.
    """
    from scipy.linalg import solveh_banded

    count = len(positions)
    away = positions - positions[0]
    differences = sum(c * away[k : count - ORDER + k] for k, c in enumerate(DIFFERENCE))
    pull = np.zeros_like(away)
    band = np.zeros((ORDER + 1, count))  # the matrix's upper half; its main diagonal is the last row
    for k, c in enumerate(DIFFERENCE):
        pull[k : count - ORDER + k] -= weight * c * differences
        for j in range(k, ORDER + 1):
            band[ORDER - (j - k), j : count - ORDER + j] += weight * c * DIFFERENCE[j]
    band[ORDER] += 1.0
    for rows in (range(ORDER), range(count - 1, count - 1 - ORDER, -1)):
        _rest(band, pull, positions, rows, REST * weight)
    free = slice(1, -1)
    change: Array = np.zeros_like(away)
    change[free] = solveh_banded(band[:, free], pull[free], overwrite_b=True, check_finite=False)
    return change


def _rest(band: Array, pull: Array, positions: Array, rows: range, weight: float) -> None:
    """Move the points at one end to the positions of a motion that starts from rest with constant jerk. Their
    distances are in the ratio 1 : 8 : 27.
    """
    end, *near, far = rows
    for number, row in enumerate(near, start=1):
        share = (number / (len(rows) - 1)) ** 3
        off = positions[row] - positions[end] - share * (positions[far] - positions[end])
        band[ORDER, row] += weight
        band[ORDER, far] += weight * share**2
        band[ORDER - abs(far - row), max(row, far)] -= weight * share
        pull[row] -= weight * off
        pull[far] += weight * share * off
