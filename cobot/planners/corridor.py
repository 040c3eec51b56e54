"""The requested curve, and how far a motion deviates from it.

The deviation is Fréchet's distance, joint by joint: a motion passes the same points in the same order,
earlier or later. Slowing down is therefore not a deviation, but leaving out a turning point is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.planners.timing.uniform_spline import knots_of, moving_average, spline_at
from cobot.trajectory import Trajectory
from cobot.types import Array

PARTS = 5
"""Number of rows in the curve's table for each step."""
CALM_STEPS, CALM_TIMES = 1, 4
"""Number of steps on each side over which the curve is averaged, and number of times that the average is
taken. This smooths the curve before its direction is computed, because the direction of noise is random.
"""
DENSE_STEPS = 0.5
"""With less than this many steps per point, the curve is linear between points: a spline exaggerates
noise.
"""
STANDSTILL = 1e-2
"""If the speed is below this value, rad/s, the curve's direction is not meaningful, so time is not shifted
along the curve.
"""
REFINEMENTS = 3


@dataclass(frozen=True, slots=True)
class AskedCurve:
    """A table of the requested curve over its own time.

    Attributes:
        step_s: step of the fitted motion that this table is made for.
        interval_s: time between two rows.
        positions: joint positions, shape (m, dof), rad.
        centres: averages of the positions over one step before and after; the centre of the fit's corridor.
        directions: velocities of the smoothed curve, shape (m, dof), rad/s.
        given: times, shape (k,), and positions, shape (k, dof), that the motion must pass.
    """

    duration_s: float
    step_s: float
    interval_s: float
    positions: Array
    centres: Array
    directions: Array
    given: list[tuple[Array, Array]]

    def at(self, times_s: Array) -> Array:
        """The positions at the given times, shape (n, dof)."""
        return self._row(self.positions, times_s)

    def centre(self, times_s: Array) -> Array:
        """The centres at the given times, shape (n, dof)."""
        return self._row(self.centres, times_s)

    @property
    def noise(self) -> Array:
        """The largest distance between each joint's positions and their centres. Shape: (dof,), in rad."""
        return np.asarray(np.abs(self.positions - self.centres).max(axis=0))

    def towards(self, times_s: Array) -> Array:
        """The directions of the curve at the given times, shape (n, dof)."""
        return self._row(self.directions, times_s)

    def in_order(self, times_s: Array) -> Array:
        """These times, made non-decreasing and clipped to the curve."""
        return np.asarray(np.clip(np.maximum.accumulate(times_s), 0.0, self.duration_s))

    def _row(self, table: Array, times_s: Array) -> Array:
        place = times_s / self.interval_s
        index = np.clip(place.astype(np.intp), 0, len(table) - 2)
        share = (place - index)[:, None]
        before = table[index]
        return np.asarray(before + share * (table[index + 1] - before))


def asked_curve(motion: Trajectory, step_s: float) -> AskedCurve:
    """Create the table of a motion, for a fit with steps of `step_s`."""
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
    centres = _averaged(positions, 1, 1)
    directions = np.gradient(_averaged(positions, CALM_STEPS, CALM_TIMES), interval_s, axis=0)
    return AskedCurve(motion.duration_s, step_s, interval_s, positions, centres, directions, given)


def _averaged(rows: Array, steps: int, times: int) -> Array:
    """A moving average over `steps` rows before and after each row, applied `times` times."""
    reach, calm = steps * PARTS, rows
    for _ in range(times):
        calm = moving_average(calm, 2 * reach + 1)
    return calm[times * reach : times * reach + len(rows)]


def shift_along(apart: Array, direction: Array) -> Array:
    """The time by which to shift a motion so that it is closest to a point at the offset `apart`. The motion
    proceeds along `direction`. Shape: (n,), in s.
    """
    square = np.einsum("ij,ij->i", direction, direction) + STANDSTILL**2
    return np.asarray(np.einsum("ij,ij->i", apart, direction) / square)


@dataclass(frozen=True, slots=True)
class Deviation:
    """The deviation of a motion from the curve.

    Attributes:
        largest: largest deviation of each joint anywhere on the curve, shape (dof,), rad.
        at_knots: deviation of each joint at each knot, shape (n, dof), rad.
        times_s: the time on the curve that corresponds to each knot, in order, shape (n,).
    """

    largest: Array
    at_knots: Array
    times_s: Array


def deviation(asked: AskedCurve, control: Array, times_s: Array, step_s: float) -> Deviation:
    """The deviation of a uniform spline's motion from the curve.

    Args:
        control: control points of the spline, shape (n, dof).
        times_s: the time on the curve that corresponds to each control point, shape (n,).
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
    """The largest distance of each joint between a motion and the given positions. Each position is compared
    only with points of the motion near its given time, in order. Shape: (dof,), in rad.
    """
    positions, velocities = spline_at(control, step_s, times_s)
    shift = shift_along(given - positions, velocities)
    nearer = np.maximum.accumulate(times_s + np.clip(shift, -step_s, step_s))
    nearer = np.clip(nearer, 0.0, times_s[-1])
    return np.asarray(np.abs(given - spline_at(control, step_s, nearer)[0]).max(axis=0))
