"""Joint paths without timing: curves in joint space as piecewise polynomials of a parameter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from cobot.errors import InputError
from cobot.polynomials import control_points, pieces_at
from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = ORDER - 1
SWUNG = 1.0
"""If a control point of a piece is outside the limits by this angle, rad, the piece is considered outside,
and its extrema are not computed.
"""
POINTS_ALONG = 200
"""Number of points of a trajectory through which its path is computed."""


@dataclass(frozen=True, slots=True)
class JointCurve:
    """A twice continuously differentiable curve of all joints over a parameter s, which can have any unit.

    Attributes:
        breakpoints: values of s, strictly increasing from 0, shape (n+1,).
        coefficients: polynomials in s, measured from the start of each piece, in ascending powers, shape (n,
            dof, 6), rad.

    Raises:
        InputError: wrong shapes, parameters that do not increase, or values that are not finite.
    """

    breakpoints: Array
    coefficients: Array

    def __post_init__(self) -> None:
        breakpoints, coefficients = self.breakpoints, self.coefficients
        if coefficients.ndim != 3 or coefficients.shape[2] != ORDER:
            raise InputError(f"a path needs coefficients (n, dof, {ORDER}), got {coefficients.shape}")
        if breakpoints.shape != (len(coefficients) + 1,) or len(coefficients) == 0:
            raise InputError(f"a path needs breakpoints (n+1,), got {breakpoints.shape}")
        if not (np.isfinite(breakpoints).all() and np.isfinite(coefficients).all()):
            raise InputError("a path must be finite")
        if breakpoints[0] != 0.0 or not (np.diff(breakpoints) > 0.0).all():
            raise InputError("a path's breakpoints must start at 0 and be strictly increasing")

    @classmethod
    def of_spline(cls, spline: BSpline) -> JointCurve:
        """The path along a spline of degree 5 or less, from its first to its last inner knot.

        The value of the spline at each parameter has the shape (dof,).
        """
        knots = np.unique(spline.t[spline.k : len(spline.t) - spline.k])
        powers = np.zeros((len(knots) - 1, spline.c.shape[1], ORDER))
        for order in range(spline.k + 1):
            powers[:, :, order] = spline(knots[:-1], order) / factorial(order)
        return cls(knots - knots[0], powers)

    @classmethod
    def through(cls, parameters: Array, points: Array) -> JointCurve:
        """The curve that passes through the given points at the given parameters. Four of its derivatives are
        continuous. Shapes: (n, dof) and (n,).
        """
        return cls.of_spline(spline_through(parameters, points))

    @classmethod
    def through_even(cls, points: Array) -> JointCurve:
        """The curve of `through` for evenly spaced parameters from 0 to 1."""
        breakpoints, units = _even_units(len(points))
        return cls(breakpoints, np.einsum("nmk,md->ndk", units, points))

    @classmethod
    def straight(cls, start: Array, goal: Array) -> JointCurve:
        """The straight line from one point to another, with s from 0 to 1. The points have shape (dof,)."""
        coefficients = np.zeros((1, len(start), ORDER))
        coefficients[0, :, 0], coefficients[0, :, 1] = start, goal - start
        return cls(np.array([0.0, 1.0]), coefficients)

    @classmethod
    def of_trajectory(cls, trajectory: Trajectory) -> JointCurve:
        """The path of a motion that does not stop, as a curve over its length in joint space.

        It passes at least `POINTS_ALONG` points of the motion at equal steps of this length.
        """
        times = np.linspace(0.0, trajectory.duration_s, 16 * max(POINTS_ALONG, trajectory.segments) + 1)
        steps = np.linalg.norm(np.diff(trajectory.sample(times), axis=0), axis=1)
        length = np.concatenate([[0.0], np.cumsum(steps)])
        even = np.linspace(0.0, length[-1], max(POINTS_ALONG, trajectory.segments) + 1)
        return cls.through(even, trajectory.sample(np.interp(even, length, times)))

    @property
    def length(self) -> float:
        """The largest value of the parameter."""
        return float(self.breakpoints[-1])

    @property
    def dof(self) -> int:
        return int(self.coefficients.shape[1])

    def at(self, places: Array, derivative: int = 0) -> Array:
        """Positions, or one of their first three derivatives with respect to s. Shape: (len(places), dof)."""
        return np.asarray(self.derivatives(places)[derivative])

    def bezier(self) -> Array:
        """The pieces as Bezier curves, for `Clearance.contact`: control points, shape (n, 6, dof)."""
        return control_points(self.coefficients, np.diff(self.breakpoints))

    def places_outside(self, low: Array, high: Array) -> Array:
        """The parameter at the start of each piece that leaves the range from `low` to `high`. Both limits
        have shape (dof,).
        """
        hull = self.bezier()
        if (hull >= low).all() and (hull <= high).all():
            return np.empty(0)
        wild = ((hull < low - SWUNG) | (hull > high + SWUNG)).any(axis=(1, 2))
        if wild.any():
            return self.breakpoints[:-1][wild]
        pieces, _, _ = Trajectory(self.breakpoints, self.coefficients).excesses(0, low, high)
        return self.breakpoints[pieces]

    def derivatives(self, places: Array) -> Array:
        """Positions and their first three derivatives with respect to s, shape (4, len(places), dof)."""
        inside = np.minimum(np.maximum(places, 0.0), self.length)
        return pieces_at(self.breakpoints, self.coefficients, inside)


def spline_through(parameters: Array, points: Array) -> BSpline:
    """The interpolating spline from which `JointCurve.through` makes its curve."""
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(parameters, points, k=min(DEGREE, len(points) - 1), check_finite=False)


@lru_cache(maxsize=8)
def _even_units(count: int) -> tuple[Array, Array]:
    """Breakpoints and coefficients of `count` splines over evenly spaced points. The coefficients have shape
    (pieces, count, 6). Each spline is 1 at one of the points and 0 at the others, so every spline through
    these points is a sum of them.
    """
    path = JointCurve.through(np.linspace(0.0, 1.0, count), np.eye(count))
    return path.breakpoints, path.coefficients
