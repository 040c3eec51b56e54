"""Trajectories as piecewise quintic polynomials, twice continuously differentiable.

A polynomial defines the motion completely between its ends, so limits are checked at the true extrema and not
at samples. It also needs little memory, so a whole motion is transferred before it starts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import comb
from typing import Literal

import numpy as np
import numpy.typing as npt

from cobot.errors import InputError
from cobot.polynomials import EXPONENTS, FACTORS, control_points, hermite, jumps
from cobot.types import Array

Integers = npt.NDArray[np.intp]
CHANGE_PEAKS = (1.875, 5.7735, 60.0)
"""Peak velocity, acceleration and jerk of the quintic that moves by 1 in 1 s from rest to rest."""
ALLOWED_JUMPS = np.array([1e-6, 1e-5, 1e-3])
"""Largest jumps of position, velocity and acceleration between two segments that are treated as rounding
errors. They are relative to the amount, or absolute if the amount is below 1.
"""
ORDER = 6
"""Number of coefficients of a quintic, in ascending powers of the time since the segment's start."""


@dataclass(frozen=True, slots=True)
class Changes:
    """The differences between a motion through timed points and the requested points.

    Attributes:
        blended_rad, blended_s: initial offset of the arm from the first point, and time in which it is
            blended out.
        smoothed_rad: largest deviation of the motion from the curve through the points.
        stretch: motion duration as a multiple of the requested duration.
        slowed_s: range of the points' times in which the motion is slower than requested; None if there is no
            such range.
    """

    blended_rad: float = 0.0
    blended_s: float = 0.0
    smoothed_rad: float = 0.0
    stretch: float = 1.0
    slowed_s: tuple[float, float] | None = None


UNCHANGED = Changes()
NoticeKind = Literal["auto", "left_start", "chomp", "radius", "end_joints"]


@dataclass(frozen=True, slots=True)
class Notice:
    """A difference between a motion and its request, in a form for programs. `Trajectory.note` contains it as
    a sentence.

    Attributes:
        values: facts of this kind of notice, by their names in docs/conventions.md.
    """

    kind: NoticeKind
    values: Mapping[str, str | float]


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A motion of all joints over time.

    Attributes:
        breakpoints_s: times, strictly increasing from 0, shape (n+1,).
        coefficients: polynomials in the time since the start of each segment, in ascending powers, shape (n,
            dof, 6); rad, rad/s and so on.
        note: human-readable sentence about the differences from the request; "" if the motion is as
            requested.
        changes: the differences as numbers, for a motion through timed points.
        notices: the differences of a planned motion, in the same order as in `note`.

    Raises:
        InputError: a shape is wrong, times do not increase, a value is not finite, or position, velocity or
            acceleration jumps between two segments.
    """

    breakpoints_s: Array
    coefficients: Array
    note: str = ""
    changes: Changes = UNCHANGED
    notices: tuple[Notice, ...] = ()

    def __post_init__(self) -> None:
        times = np.ascontiguousarray(self.breakpoints_s, dtype=np.float64)
        coefficients = np.ascontiguousarray(self.coefficients, dtype=np.float64)
        if (
            coefficients.ndim != 3
            or coefficients.shape[2] != ORDER
            or times.shape != (len(coefficients) + 1,)
        ):
            raise InputError(
                f"a trajectory needs breakpoints (n+1,) and coefficients (n, dof, {ORDER}), "
                f"got {times.shape} and {coefficients.shape}"
            )
        if not (np.isfinite(times).all() and np.isfinite(coefficients).all()):
            raise InputError("a trajectory must be finite")
        if len(coefficients) == 0 or times[0] != 0.0 or not (np.diff(times) > 0.0).all():
            raise InputError("a trajectory's breakpoints must start at 0 and be strictly increasing")
        for array in (times, coefficients):
            array.flags.writeable = False
        object.__setattr__(self, "breakpoints_s", times)
        object.__setattr__(self, "coefficients", coefficients)
        self._require_continuity()

    def _require_continuity(self) -> None:
        gaps, amounts = jumps(self.coefficients, np.diff(self.breakpoints_s))
        too_far = gaps > ALLOWED_JUMPS[:, None, None] * (1.0 + amounts)
        if too_far.any():
            order, segment, joint = np.argwhere(too_far)[0]
            name = ("position", "velocity", "acceleration")[order]
            raise InputError(
                f"the {name} of joint {joint + 1} jumps by {gaps[order, segment, joint]:.3g} "
                f"at {self.breakpoints_s[segment + 1]:.3f} s"
            )

    @property
    def segments(self) -> int:
        return len(self.coefficients)

    @property
    def dof(self) -> int:
        return int(self.coefficients.shape[1])

    @property
    def duration_s(self) -> float:
        return float(self.breakpoints_s[-1])

    @property
    def start(self) -> Array:
        """Joint positions at the start, shape (dof,), rad."""
        return self.coefficients[0, :, 0].copy()

    @property
    def end(self) -> Array:
        """Joint positions at the end, shape (dof,), rad."""
        return np.asarray(self.sample([self.duration_s])[0])

    def sample(self, times_s: Sequence[float] | Array, derivative: int = 0) -> Array:
        """Positions at the given times, or one of their first three derivatives. Shape: (len(times), dof).

        A time outside the trajectory gives the value at its nearest end.
        """
        times = np.clip(np.asarray(times_s, dtype=np.float64), 0.0, self.duration_s)
        index = np.clip(np.searchsorted(self.breakpoints_s, times, side="right") - 1, 0, self.segments - 1)
        local = times - self.breakpoints_s[index]
        powers = FACTORS[derivative] * local[:, None] ** EXPONENTS[derivative]
        return np.asarray(np.einsum("ijk,ik->ij", self.coefficients[index], powers))

    def extrema(self, derivative: int = 0) -> tuple[Array, Array]:
        """The exact lowest and highest value that each joint reaches, shape (dof,) each."""
        polynomials = self._unit_polynomials(derivative)
        lowest = np.empty(self.dof)
        highest = np.empty(self.dof)
        for joint in range(self.dof):
            rows = polynomials[:, joint]
            ends = np.concatenate([rows[:, 0], rows.sum(axis=1)])
            low, high = _bernstein_hull(rows)
            open_rows = rows[(low < ends.min()) | (high > ends.max())]
            row_low, row_high = _polynomial_extrema(open_rows)
            lowest[joint] = min(ends.min(), row_low.min(initial=np.inf))
            highest[joint] = max(ends.max(), row_high.max(initial=-np.inf))
        return lowest, highest

    def excesses(self, derivative: int, low: Array, high: Array) -> tuple[Integers, Integers, Array]:
        """Find the extrema outside the range from `low` to `high`, each of shape (dof,). Returns three arrays
        of shape (m,): the segment, the joint and the value of each extremum, in order.
        """
        rows = self.coefficients
        if derivative > 0:
            rows = rows[:, :, derivative:] * FACTORS[derivative, derivative:]
        hull = control_points(rows, np.diff(self.breakpoints_s))
        outside = (hull < low) | (hull > high)
        segments, joints = np.nonzero(outside.any(axis=1))
        if len(segments) == 0:
            return segments, joints, np.empty(0)
        lowest, highest = _polynomial_extrema(self._unit_polynomials(derivative)[segments, joints])
        beneath, above = lowest < low[joints], highest > high[joints]
        guilty = beneath | above
        return segments[guilty], joints[guilty], np.where(beneath, lowest, highest)[guilty]

    def stretched(self, factor: float) -> Trajectory:
        """The same path with `factor` times the duration. Velocities are divided by `factor`, jerks by
        `factor`³.
        """
        coefficients = self.coefficients / factor ** np.arange(ORDER)
        return Trajectory(self.breakpoints_s * factor, coefficients, self.note, self.changes, self.notices)

    def followed_by(self, other: Trajectory) -> Trajectory:
        """This trajectory, followed by the other trajectory.

        Position, velocity and acceleration must be continuous between them.
        """
        return Trajectory(
            np.concatenate([self.breakpoints_s, self.duration_s + other.breakpoints_s[1:]]),
            np.concatenate([self.coefficients, other.coefficients]),
            "; ".join(filter(None, (self.note, other.note))),
            self.changes if other.changes == UNCHANGED else other.changes,
            self.notices + other.notices,
        )

    def _unit_polynomials(self, derivative: int) -> Array:
        """Coefficients of a derivative as polynomials in a time that is scaled to [0, 1] within each segment.
        Shape: (n, dof, 6 − derivative).
        """
        rows = self.coefficients[:, :, derivative:] * FACTORS[derivative, derivative:]
        durations = np.diff(self.breakpoints_s)
        return np.asarray(rows * durations[:, None, None] ** np.arange(ORDER - derivative))


def from_hermite(times_s: Array, positions: Array, velocities: Array, accelerations: Array) -> Trajectory:
    """The quintics that have the given values at the given times. The second derivative is therefore
    continuous.

    Args:
        times_s: times starting at 0, shape (n+1,). All other arguments have the shape (n+1, dof).
    """
    times = np.asarray(times_s, dtype=np.float64)
    return Trajectory(times, hermite(times, positions, velocities, accelerations))


@cache
def _bernstein(degree: int) -> Array:
    """The matrix that converts the coefficients of a polynomial to its Bernstein control points."""
    return np.array(
        [
            [comb(i, k) / comb(degree, k) if k <= i else 0.0 for k in range(degree + 1)]
            for i in range(degree + 1)
        ]
    )


def _bernstein_hull(rows: Array) -> tuple[Array, Array]:
    """Bounds of polynomials on [0, 1], computed from their control points: low and high, shape
    rows.shape[:-1] each.
    """
    points = rows @ _bernstein(rows.shape[-1] - 1).T
    return points.min(axis=-1), points.max(axis=-1)


def _polynomial_extrema(rows: Array) -> tuple[Array, Array]:
    """The exact lowest and highest values on [0, 1] of polynomials with ascending coefficients, shape (m,
    k).
    """
    lowest = np.minimum(rows[:, 0], rows.sum(axis=1))
    highest = np.maximum(rows[:, 0], rows.sum(axis=1))
    slopes = rows[:, 1:] * np.arange(1, rows.shape[1])
    scale = np.abs(slopes).max(axis=1, initial=0.0)
    significant = np.abs(slopes) > 1e-12 * scale[:, None]
    degrees = np.where(
        significant.any(axis=1), slopes.shape[1] - 1 - np.argmax(significant[:, ::-1], axis=1), 0
    )
    for degree in range(1, slopes.shape[1]):
        chosen = np.flatnonzero(degrees == degree)
        if len(chosen) == 0:
            continue
        companion = np.zeros((len(chosen), degree, degree))
        companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
        companion[:, :, -1] = -slopes[chosen, :degree] / slopes[chosen, degree, None]
        # A double root may be found with a small imaginary part. Its real part is still the time of the
        # extremum. A time that is not an extremum only adds a value that the polynomial also takes.
        roots = np.clip(np.linalg.eigvals(companion).real, 0.0, 1.0)
        values = np.einsum("mk,mrk->mr", rows[chosen], roots[:, :, None] ** np.arange(rows.shape[1]))
        lowest[chosen] = np.minimum(lowest[chosen], values.min(axis=1))
        highest[chosen] = np.maximum(highest[chosen], values.max(axis=1))
    return lowest, highest
