"""Splines of the time parameterization: a cubic spline for s(τ), and a quadratic spline for the square of the
rate dτ/dt.

Both splines have their knots at integer τ. The cells are the intervals between the knots. x is the position
in a cell, from 0 to 1.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array

MIDDLE = 0.5


def basis(x: float) -> Array:
    """The values of a quadratic B-spline at `x` and its two derivatives. There is one column for each of the
    cell's three control points, shape (3, 3).
    """
    return np.array(
        [
            [0.5 * (1.0 - x) ** 2, 0.5 + x * (1.0 - x), 0.5 * x**2],
            [x - 1.0, 1.0 - 2.0 * x, x],
            [1.0, -2.0, 1.0],
        ]
    )


BASES = np.array([basis(x) for x in (0.0, MIDDLE, 1.0)])


@lru_cache(maxsize=32)
def acceleration_stations(cells: int) -> tuple[Array, Array]:
    """The points where accelerations are limited: the beginning and the middle of each cell, and the end of
    the last.

    Returns:
        The cell of each point, shape (n,), and the basis there, shape (n, 3, 3).
    """
    even = np.arange(cells)
    index = np.concatenate([even, even, even[-1:]])
    return index, BASES.repeat([cells, cells, 1], axis=0)


@lru_cache(maxsize=32)
def jerk_stations(cells: int, ending: int) -> tuple[Array, Array]:
    """The points where jerks are limited: both ends of each cell, and the middle of each of the first and the
    last `ending` cells. Returns the cell of each point and the basis there.
    """
    even = np.arange(cells)
    index = np.concatenate([even, even, even[:ending], even[-ending:]])
    return index, BASES[[0, 2, 1]].repeat([cells, cells, 2 * ending], axis=0)


@lru_cache(maxsize=32)
def duration_stations(cells: int) -> tuple[Array, Array, Array]:
    """Cells and bases at the beginning, middle and end of each cell, and Simpson's weights, shape (n, 1)."""
    weights = np.repeat([1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0], cells)[:, None]
    return np.tile(np.arange(cells), 3), BASES.repeat(cells, axis=0), weights


NODES, WEIGHTS = (0.5 * each for each in np.polynomial.legendre.leggauss(4))
AT_NODES = np.stack([basis(0.5 + node)[0] for node in NODES], axis=1)
"""Spline basis at the nodes of the Gauss-Legendre rule, which computes the time that a cell takes."""


def cubic_basis(x: float) -> Array:
    """The values of a cubic B-spline at `x` and its three derivatives. There is one column for each of the
    cell's four control points, shape (4, 4).
    """
    y = 1.0 - x
    return np.array(
        [
            [y**3 / 6, (3 * x**3 - 6 * x**2 + 4) / 6, (3 * y**3 - 6 * y**2 + 4) / 6, x**3 / 6],
            [-(y**2) / 2, (3 * x**2 - 4 * x) / 2, (4 * y - 3 * y**2) / 2, x**2 / 2],
            [y, 3 * x - 2, 1 - 3 * x, x],
            [-1.0, 3.0, -3.0, 1.0],
        ]
    )


CUBIC = np.array([cubic_basis(x) for x in (0.0, MIDDLE, 1.0)])


def cubics(points: Array) -> Array:
    """A cubic B-spline and its three derivatives at the beginning, the middle and the end of each cell, shape
    (3, 4, cells).
    """
    return np.asarray(CUBIC @ np.array([points[:-3], points[1:-2], points[2:-1], points[3:]]))


def times_of(rate: Array) -> tuple[Array, Array, Array]:
    """Three values for each knot: the time (s), the squared rate, and the slope of the squared rate. Each
    array has shape (cells + 1,).
    """
    squares = AT_NODES.T @ np.array([rate[:-2], rate[1:-1], rate[2:]])
    times = np.zeros(len(rate) - 1)
    np.cumsum(WEIGHTS @ (1.0 / np.sqrt(squares)), out=times[1:])
    return times, 0.5 * (rate[:-1] + rate[1:]), rate[1:] - rate[:-1]


def motion(
    times: Array, positions: Array, first: Array, second: Array, squares: Array, slopes: Array
) -> Trajectory:
    """A trajectory of quintics. At each knot it has the given position, and the given first and second
    derivatives with respect to τ. These three arrays have shape (n, dof).
    """
    return from_hermite(times, *states(positions, first, second, squares, slopes))


def states(
    positions: Array, first: Array, second: Array, squares: Array, slopes: Array
) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations with respect to time, shape (n, dof) each."""
    velocity = first * np.sqrt(squares)[:, None]
    return positions, velocity, second * squares[:, None] + 0.5 * first * slopes[:, None]
