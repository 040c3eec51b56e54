"""Quintic polynomials: their bases, and motions of several coordinates that consist of them.

A quintic leads from one state, shape (3, n): position, velocity and acceleration, to another in a given time.
Its coefficients, shape (6, n), are those of the powers of s, the share of that time, in [0, 1].

Attributes:
    FACTORS, EXPONENTS: shape (4, 6), of the powers of s in a polynomial and in its first three derivatives.
    HERMITE: shape (6, 6): coefficients on [0, 1] from the value and two derivatives by s at 0, then at 1.
"""

from cobot.types import Array

FACTORS: Array
EXPONENTS: Array
HERMITE: Array

def between(start: Array, end: Array, duration_s: float) -> Array:
    """The coefficients of the quintic between two states."""

def evaluate(coefficients: Array, time_s: float, duration_s: float, out: Array) -> None:
    """Position, velocity and acceleration, shape (3, n), at a time after the start."""

def peaks(coefficients: Array, duration_s: float, places: int) -> Array:
    """The largest magnitudes of velocity, acceleration and jerk, shape (3, n), at `places` equidistant times
    from the start to the end."""

def pieces_at(breakpoints: Array, coefficients: Array, places: Array) -> Array:
    """The values and three derivatives, shape (4, m, n), of piecewise quintics, shape (pieces, n, 6), in
    powers of the distance from each piece's start, at places of shape (m,)."""

def hermite(times: Array, positions: Array, velocities: Array, accelerations: Array) -> Array:
    """The quintics, shape (pieces, n, 6), in powers of the time since each piece's start, that take the given
    values and derivatives, shape (pieces + 1, n) each, at the given times, shape (pieces + 1,).

    They are computed relative to each piece's start, so a large position costs no digits of the motion.
    """

def control_points(coefficients: Array, widths: Array) -> Array:
    """Bezier's control points, shape (pieces, order, n), of polynomials, shape (pieces, n, order), of up to
    degree 5, in powers of the distance from each piece's start, on pieces of these widths,
    shape (pieces,)."""

def jumps(coefficients: Array, durations: Array) -> tuple[Array, Array]:
    """The jumps of position, velocity and acceleration, shape (3, pieces - 1, n), from the end of each
    quintic, shape (pieces, n, 6), to the start of the next one; and the magnitudes at that start."""

def greatest_rates(coefficients: Array, durations: Array, enough: Array | None = None) -> Array:
    """The exact largest magnitudes of velocity, acceleration and jerk, shape (3, pieces, n), of quintics.

    coefficients: shape (pieces, n, 6), for powers of the time since each piece's start.
    enough: values that can be broadcast to the shape of the result. If a magnitude is certainly not above its
    value here, an upper bound that is not above it either may be returned, which takes a fifth of the time.
    """
