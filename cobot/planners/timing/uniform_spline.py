"""Motions as uniform cubic B-splines, whose control points show whether limits hold.

With control points c at a step h, the velocity is in the hull of Δc / h, the acceleration is linear from one
Δ²c / h² to the next, and the jerk is Δ³c / h³ from knot to knot. If these differences are within bounds, the
motion is therefore within them everywhere, not only at samples. Knot k is at (c[k] + 4 c[k+1] + c[k+2]) / 6.
Three equal control points at an end mean that the motion is at rest there.

Source: de Boor, "A Practical Guide to Splines", chapter X.
"""

from __future__ import annotations

import numpy as np

from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array, JointLimits

AT_REST = 3
"""Number of equal control points at each end that make the spline begin and end at rest."""


def stretch_needed(control: Array, step_s: float, limits: JointLimits) -> Array:
    """For each control point, the factor by which the time around it must be stretched to stay within the
    limits. Shape: (n,).
    """
    found = np.zeros(len(control))
    difference = control
    for order, bound in enumerate((limits.max_velocity, limits.max_acceleration, limits.max_jerk), start=1):
        difference = np.diff(difference, axis=0)
        factors = (np.abs(difference) / (bound * step_s**order)).max(axis=1) ** (1.0 / order)
        for first in range(order + 1):
            part = found[first : first + len(factors)]
            np.maximum(part, factors, out=part)
    return found


def knots_of(control: Array) -> Array:
    """The positions at the knots, shape (n - 2, dof)."""
    return np.asarray((control[:-2] + 4.0 * control[1:-1] + control[2:]) / 6.0)


def spline_motion(control: Array, step_s: float) -> Trajectory:
    """The motion with these control points, shape (n, dof), as n - 3 segments."""
    first = np.diff(control, axis=0)
    second = np.diff(first, axis=0)
    coefficients = np.zeros((len(control) - 3, control.shape[1], ORDER))
    coefficients[:, :, 0] = knots_of(control)[:-1]
    coefficients[:, :, 1] = 0.5 * (first[:-2] + first[1:-1]) / step_s
    coefficients[:, :, 2] = 0.5 * second[:-1] / step_s**2
    coefficients[:, :, 3] = np.diff(second, axis=0) / (6.0 * step_s**3)
    return Trajectory(np.arange(len(coefficients) + 1.0) * np.float64(step_s), coefficients)


def spline_at(control: Array, step_s: float, times_s: Array) -> tuple[Array, Array]:
    """Position and velocity at the given times, shape (m, dof) each."""
    place = times_s / step_s
    index = np.clip(place.astype(np.intp), 0, len(control) - 4)
    t = (place - index)[:, None]
    rest, square = 1.0 - t, t * t
    weights = (
        rest**3,
        4.0 - 6.0 * square + 3.0 * square * t,
        1.0 + 3.0 * (t + square - square * t),
        square * t,
    )
    rates = (-(rest**2), 3.0 * square - 4.0 * t, 1.0 + 2.0 * t - 3.0 * square, square)
    rows = [control[index + k] for k in range(4)]
    position = sum(weight * row for weight, row in zip(weights, rows, strict=True))
    velocity = sum(rate * row for rate, row in zip(rates, rows, strict=True))
    return np.asarray(position) / 6.0, np.asarray(velocity) / (2.0 * step_s)


def moving_average(values: Array, count: int) -> Array:
    """The moving average over `count` rows. It begins as if the first value had been constant before, and
    ends as if the last value stayed constant. It has `count` - 1 rows more than `values`.

    If the differences of the values are within bounds, those of the average are too. Differences of one order
    higher are divided by `count`.
    """
    if count <= 1:
        return values
    ends = [np.repeat(values[index : index + 1], count, axis=0) for index in (0, len(values) - 1)]
    rows = np.concatenate([ends[0], values, ends[1][1:]]) - values[0]
    sums = np.cumsum(rows, axis=0)
    mean: Array = values[0] + (sums[count:] - sums[:-count]) / count
    return mean
