"""Points that were written with few decimals, at short steps: their rounding, taken out of the jerk again.

At 2 ms, half a unit of the sixth decimal is a jerk of hundreds of rad/s³. The smoothest curve that stays
within one unit of every point is as good an answer to what was written as the points themselves. It is
Whittaker's: the least sum of squared deviations and of squared fourth differences, so that where the jerk is
constant nothing is changed.

Source: Eilers, "A perfect smoother", Analytical Chemistry 75, 2003, equations 4 to 6.
"""

from __future__ import annotations

import math

import numpy as np

from cobot.types import Array

DECIMALS = range(4, 10)
"""With fewer decimals a unit is too much to move by; with more there is nothing to take out."""
MIN_POINTS = 100
LONGEST_STEP_S = 0.02
"""Points further apart are meant one by one, s."""
UNEVEN = 0.01
"""Steps of time may differ by this share."""
WINDOWS = (24.0, 16.0, 12.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.0)
"""Over so many points it is smoothed: the most that stays within the rounding."""
ORDER = 4
REST = 1e4
"""How much more than the differences it weighs that the motion comes from rest, and to rest."""
DIFFERENCE = np.array([(-1) ** k * math.comb(ORDER, k) for k in range(ORDER + 1)], dtype=np.float64)


def smoothed(times_s: Array, positions: Array) -> tuple[Array, float] | None:
    """The points without the noise of their rounding; the first and the last one stay where they are.

    Args:
        times_s: shape (n,), increasing.
        positions: shape (n, dof), rad; the motion rests at both ends.

    Returns:
        Positions of the same shape, and the unit in which the given ones were written, rad: no position is
        further from the given one. None if they are not such points.
    """
    steps_s = np.diff(times_s)
    if (
        len(times_s) < MIN_POINTS
        or steps_s.max() > LONGEST_STEP_S
        or np.ptp(steps_s) > UNEVEN * steps_s.max()
    ):
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
    """The last decimal that the numbers have, if they have few."""
    for decimals in DECIMALS:
        if np.abs(np.round(positions, decimals) - positions).max() < 1e-3 * 10.0**-decimals:
            return float(10.0**-decimals)
    return None


def _change(positions: Array, weight: float) -> Array:
    """What smoothing adds to each row; solved for the change itself, which is far more exact than the sum.

    Args:
        weight: of the differences; what repeats within fewer than 2 π weight^(1/8) rows is taken out.
    """
    from scipy.linalg import solveh_banded

    count = len(positions)
    away = positions - positions[0]
    differences = sum(c * away[k : count - ORDER + k] for k, c in enumerate(DIFFERENCE))
    pull = np.zeros_like(away)
    band = np.zeros((ORDER + 1, count))  # the matrix's upper half, its main diagonal in the last row
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
    """Have the points at one end be those of a motion from rest with constant jerk: 1, 8 and 27 parts."""
    end, *near, far = rows
    for number, row in enumerate(near, start=1):
        share = (number / (len(rows) - 1)) ** 3
        off = positions[row] - positions[end] - share * (positions[far] - positions[end])
        band[ORDER, row] += weight
        band[ORDER, far] += weight * share**2
        band[ORDER - abs(far - row), max(row, far)] -= weight * share
        pull[row] -= weight * off
        pull[far] += weight * share * off
