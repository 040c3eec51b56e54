"""The splines of the time law: s(τ), a cubic one, and the square of the rate dτ/dt, a quadratic one.

Both have their knots at the whole numbers τ, between which are the cells. x is a place within a cell, from 0
to 1.
"""

from __future__ import annotations

import numpy as np

from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array


def basis(x: float) -> Array:
    """A quadratic B-spline and its two derivatives, by the cell's three control points, shape (3, 3)."""
    return np.array(
        [
            [0.5 * (1.0 - x) ** 2, 0.5 + x * (1.0 - x), 0.5 * x**2],
            [x - 1.0, 1.0 - 2.0 * x, x],
            [1.0, -2.0, 1.0],
        ]
    )


def bases(x: float, count: int) -> Array:
    """The same for each of so many cells, shape (count, 3, 3)."""
    return np.broadcast_to(basis(x), (count, 3, 3))


NODES, WEIGHTS = (0.5 * each for each in np.polynomial.legendre.leggauss(4))
AT_NODES = np.stack([basis(0.5 + node)[0] for node in NODES], axis=1)
"""Gauss and Legendre's rule for the time that a cell takes."""


def cubic(points: Array, x: float) -> Array:
    """A cubic B-spline and its three derivatives at one place in each cell, shape (4, cells)."""
    y = 1.0 - x
    weights = np.array(
        [
            [y**3 / 6, (3 * x**3 - 6 * x**2 + 4) / 6, (3 * y**3 - 6 * y**2 + 4) / 6, x**3 / 6],
            [-(y**2) / 2, (3 * x**2 - 4 * x) / 2, (4 * y - 3 * y**2) / 2, x**2 / 2],
            [y, 3 * x - 2, 1 - 3 * x, x],
            [-1.0, 3.0, -3.0, 1.0],
        ]
    )
    return np.asarray(weights @ np.stack([points[:-3], points[1:-2], points[2:-1], points[3:]]))


def chained(derivatives: Array, law: Array) -> Array:
    """Derivatives by τ, shape (3, n, m), of derivatives by s, and of s and its derivatives by τ, (4, n)."""
    first, second, third = derivatives
    u, v, w = law[1][:, None], law[2][:, None], law[3][:, None]
    return np.array([first * u, second * u**2 + first * v, third * u**3 + 3.0 * second * u * v + first * w])


def times_of(rate: Array) -> tuple[Array, Array, Array]:
    """The times at the knots, s, and there the square of the rate and its slope, shape (cells + 1,) each."""
    windows = np.stack([rate[:-2], rate[1:-1], rate[2:]], axis=1)
    durations = (WEIGHTS / np.sqrt(windows @ AT_NODES)).sum(axis=1)
    (value, slope, _), (last, last_slope, _) = basis(0.0), basis(1.0)
    squares = np.append(windows @ value, windows[-1] @ last)
    slopes = np.append(windows @ slope, windows[-1] @ last_slope)
    return np.concatenate([[0.0], np.cumsum(durations)]), squares, slopes


def motion(
    times: Array, positions: Array, first: Array, second: Array, squares: Array, slopes: Array
) -> Trajectory:
    """Quintics through positions and derivatives by τ, shape (n, dof) each, at the knots."""
    velocity = first * np.sqrt(squares)[:, None]
    acceleration = second * squares[:, None] + 0.5 * first * slopes[:, None]
    return from_hermite(times, positions, velocity, acceleration)
