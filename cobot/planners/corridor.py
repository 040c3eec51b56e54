"""The curve that somebody asked for, and how far a motion is from it.

The distance is Fréchet's: what passes the same places in the same order, each joint within the corridor, may
be earlier or later there, so that slowing down is no deviation and leaving out a turn is one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.planners.timing.uniform_spline import averaged, knots_of, spline_at
from cobot.trajectory import Trajectory
from cobot.types import Array

PARTS = 5
"""The curve's table has so many rows for each step."""
CALM_STEPS, CALM_TIMES = 1, 4
"""The direction of the curve is that of its mean over so many steps, so many times: noise points anywhere."""
DENSE_STEPS = 0.5
"""Between points that are nearer than so many steps the curve is straight: a spline exaggerates noise."""
STANDSTILL = 1e-2
"""Slower than this, rad/s, a curve has no direction in which time could be shifted."""
REFINEMENTS = 3


@dataclass(frozen=True, slots=True)
class AskedCurve:
    """A table of the curve: where it is, and where it leads, by its own time.

    Attributes:
        step_s: the step of the fitted motion for which this table was made.
        interval_s: between two rows.
        positions: shape (m, dof), rad.
        centres: their means over the steps before and after, of which the fit makes its corridor.
        directions: shape (m, dof), rad/s.
        given: times, shape (k,), and positions, shape (k, dof), that must not be missed.
    """

    duration_s: float
    step_s: float
    interval_s: float
    positions: Array
    centres: Array
    directions: Array
    given: list[tuple[Array, Array]]

    def at(self, times_s: Array) -> Array:
        """The positions at these times, shape (n, dof)."""
        return self._row(self.positions, times_s)

    def centre(self, times_s: Array) -> Array:
        """The centres at these times, shape (n, dof)."""
        return self._row(self.centres, times_s)

    @property
    def noise(self) -> Array:
        """How far the positions are from the centres at the most, shape (dof,), rad."""
        return np.asarray(np.abs(self.positions - self.centres).max(axis=0))

    def towards(self, times_s: Array) -> Array:
        """The directions at these times, shape (n, dof)."""
        return self._row(self.directions, times_s)

    def in_order(self, times_s: Array) -> Array:
        """The same times, none before the one before it or outside the curve."""
        return np.asarray(np.clip(np.maximum.accumulate(times_s), 0.0, self.duration_s))

    def _row(self, table: Array, times_s: Array) -> Array:
        place = times_s / self.interval_s
        index = np.clip(place.astype(np.intp), 0, len(table) - 2)
        share = (place - index)[:, None]
        before = table[index]
        return np.asarray(before + share * (table[index + 1] - before))


def asked_curve(motion: Trajectory, step_s: float) -> AskedCurve:
    """The table of a motion, for a fit with this step, s."""
    rows = max(round(motion.duration_s / step_s), 1) * PARTS
    interval_s = motion.duration_s / rows
    rows_s, marks_s = np.linspace(0.0, motion.duration_s, rows + 1), motion.breakpoints_s
    marks = motion.sample(marks_s)
    given = [(marks_s, marks)]
    if motion.duration_s < DENSE_STEPS * step_s * motion.segments:
        positions = np.stack([np.interp(rows_s, marks_s, column) for column in marks.T], axis=1)
    else:
        positions = motion.sample(rows_s)
        given.append((rows_s, positions))
    centres = _calmed(positions, 1, 1)
    directions = np.gradient(_calmed(positions, CALM_STEPS, CALM_TIMES), interval_s, axis=0)
    return AskedCurve(motion.duration_s, step_s, interval_s, positions, centres, directions, given)


def _calmed(rows: Array, steps: int, times: int) -> Array:
    """The means over so many steps before and after each row, taken so many times."""
    reach, calm = steps * PARTS, rows
    for _ in range(times):
        calm = averaged(calm, 2 * reach + 1)
    return calm[times * reach : times * reach + len(rows)]


def shift_along(apart: Array, direction: Array) -> Array:
    """How much later what moves in this direction is nearest to what lies so far apart, shape (n,), s."""
    square = np.einsum("ij,ij->i", direction, direction) + STANDSTILL**2
    return np.asarray(np.einsum("ij,ij->i", apart, direction) / square)


@dataclass(frozen=True, slots=True)
class Deviation:
    """How far a motion is from the curve.

    Attributes:
        largest: of each joint anywhere, shape (dof,), rad.
        at_knots: of each joint at each knot, shape (n, dof), rad.
        times_s: of the curve, where each knot belongs to, in order, shape (n,).
    """

    largest: Array
    at_knots: Array
    times_s: Array


def deviation(asked: AskedCurve, control: Array, times_s: Array, step_s: float) -> Deviation:
    """How far the motion of a uniform spline is from the curve.

    Args:
        control: its control points, shape (n, dof).
        times_s: of the curve, where each control point belongs to, shape (n,).
    """
    knots, matched = knots_of(control), times_s[1:-1]
    for _ in range(REFINEMENTS):
        shift = shift_along(knots - asked.at(matched), asked.towards(matched))
        matched = asked.in_order(matched + np.clip(shift, -asked.step_s, asked.step_s))
    matched[0], matched[-1] = 0.0, asked.duration_s
    at_knots = np.abs(knots - asked.at(matched))
    off = at_knots.max(axis=0)
    clock_s = step_s * np.arange(float(len(matched)))
    for given_s, given in asked.given:
        passed_s = np.interp(given_s, matched, clock_s)
        off = np.maximum(off, _missed(given, control, step_s, passed_s))
    return Deviation(off, at_knots, matched)


def _missed(given: Array, control: Array, step_s: float, times_s: Array) -> Array:
    """How far a motion stays from the given positions, near these times and in this order, shape (dof,)."""
    positions, velocities = spline_at(control, step_s, times_s)
    shift = shift_along(given - positions, velocities)
    nearer = np.maximum.accumulate(times_s + np.clip(shift, -step_s, step_s))
    nearer = np.clip(nearer, 0.0, times_s[-1])
    return np.asarray(np.abs(given - spline_at(control, step_s, nearer)[0]).max(axis=0))
