"""Quintics. Oracle: numpy's polynomials, and the six equations of a quintic between two states."""

from __future__ import annotations

import numpy as np
import pytest

from cobot.polynomials import (
    EXPONENTS,
    FACTORS,
    HERMITE,
    between,
    control_points,
    evaluate,
    greatest_rates,
    hermite,
    jumps,
    peaks,
    pieces_at,
)
from cobot.types import Array

COLUMNS, ROUNDS = 5000, 20


def states(seed: int) -> tuple[np.random.Generator, Array, Array, float]:
    """Of so many coordinates at both ends, and a duration."""
    rng = np.random.default_rng(seed)
    scale = np.array([1.0, 2.0, 20.0])[:, None]
    ends = rng.uniform(-scale, scale, (2, 3, COLUMNS))
    return rng, ends[0], ends[1], float(rng.uniform(1e-3, 2.0))


def values(coefficients: Array, order: int, s: Array | float, duration_s: float) -> Array:
    """The derivative of an order by time, shape (n,) or (n, places)."""
    rows = np.polynomial.polynomial.polyder(coefficients, order, axis=0)
    return np.asarray(np.polynomial.polynomial.polyval(s, rows) / duration_s**order)


def test_the_bases_are_those_of_derivatives_and_of_the_six_equations_at_both_ends() -> None:
    for order in range(4):
        for power in range(6):
            basis = np.polynomial.Polynomial.basis(power)
            expected = basis.deriv(order) if order else basis
            for s in (0.0, 0.3, 1.0):
                found = FACTORS[order, power] * s ** EXPONENTS[order, power]
                assert found == pytest.approx(expected(s), abs=1e-15)
    ends = [[FACTORS[k, p] * s ** EXPONENTS[k, p] for p in range(6)] for s in (0.0, 1.0) for k in range(3)]
    np.testing.assert_allclose(np.array(ends) @ HERMITE, np.eye(6), atol=1e-13)


@pytest.mark.parametrize("seed", range(ROUNDS))
def test_a_quintic_leads_from_one_state_to_the_other(seed: int) -> None:
    _, start, end, duration_s = states(seed)
    scale = np.array([[1.0], [duration_s], [duration_s**2]])
    expected = HERMITE @ np.concatenate([start * scale, end * scale])
    coefficients = between(start, end, duration_s)
    np.testing.assert_allclose(coefficients, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    for state, time_s in ((start, 0.0), (end, duration_s)):
        out = np.zeros((3, COLUMNS))
        evaluate(coefficients, time_s, duration_s, out)
        np.testing.assert_allclose(out * scale, state * scale, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(ROUNDS))
def test_values_and_peaks_are_those_of_numpy(seed: int) -> None:
    rng, start, end, duration_s = states(seed)
    coefficients, s = between(start, end, duration_s), float(rng.uniform(0.0, 1.0))
    out = np.zeros((3, COLUMNS))
    evaluate(coefficients, s * duration_s, duration_s, out)
    largest = np.abs(coefficients).max() * 60.0
    for order in range(3):
        expected = values(coefficients, order, s, duration_s)
        np.testing.assert_allclose(out[order], expected, atol=1e-12 * largest / duration_s**order)
    found = peaks(coefficients, duration_s, 11)
    for order in (1, 2, 3):
        everywhere = values(coefficients, order, np.linspace(0.0, 1.0, 11), duration_s)
        expected = np.abs(everywhere).max(axis=-1)
        np.testing.assert_allclose(found[order - 1], expected, atol=1e-12 * largest / duration_s**order)


def test_what_does_not_move_does_not_move_by_a_rounding_either() -> None:
    rest = np.zeros((3, 1000))
    rest[0] = np.random.default_rng(1).normal(size=1000)
    coefficients, out = between(rest, rest, 0.033), np.zeros((3, 1000))
    for time_s in np.linspace(0.0, 0.033, 34):
        evaluate(coefficients, float(time_s), 0.033, out)
        np.testing.assert_array_equal(out, rest)


def test_what_is_no_number_is_a_peak_that_is_none() -> None:
    coefficients = np.zeros((6, 2))
    coefficients[3, 1] = np.nan
    assert np.isnan(peaks(coefficients, 1.0, 5)[:, 1]).all()
    assert not peaks(coefficients, 1.0, 5)[:, 0].any()


@pytest.mark.parametrize("seed", range(ROUNDS))
def test_pieces_are_evaluated_as_numpys_polynomials(seed: int) -> None:
    rng = np.random.default_rng(seed)
    breakpoints = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 1.0, 12))])
    coefficients = rng.normal(size=(12, 5, 6))
    places = np.concatenate([rng.uniform(0.0, breakpoints[-1], 50), breakpoints])
    piece = np.clip(np.searchsorted(breakpoints, places, side="right") - 1, 0, 11)
    found = pieces_at(breakpoints, coefficients, places)
    for order in range(4):
        rows = np.polynomial.polynomial.polyder(coefficients, order, axis=2)[piece]
        since = (places - breakpoints[piece])[:, None, None] ** np.arange(6 - order)
        assert found[order] == pytest.approx((rows * since).sum(axis=2), abs=1e-12, rel=1e-12)


def test_jumps_are_the_differences_of_numpys_polynomials_where_pieces_meet() -> None:
    rng = np.random.default_rng(3)
    coefficients, durations = rng.normal(size=(40, 7, 6)), rng.uniform(0.01, 3.0, 40)
    gaps, amounts = jumps(coefficients, durations)
    for order in range(3):
        rows = np.polynomial.polynomial.polyder(coefficients, order, axis=2)
        ends = np.einsum("nik,nk->ni", rows, durations[:, None] ** np.arange(6 - order))
        assert gaps[order] == pytest.approx(np.abs(ends[:-1] - rows[1:, :, 0]), rel=1e-12, abs=1e-12)
        assert amounts[order] == pytest.approx(np.abs(rows[1:, :, 0]), rel=1e-12)
    assert jumps(coefficients[:1], durations[:1])[0].shape == (3, 0, 7)


@pytest.mark.parametrize("seed", range(ROUNDS))
def test_the_greatest_rates_are_where_numpys_roots_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=(6, 4, 6)) * 10.0 ** rng.uniform(-6.0, 0.0, (6, 4, 1))
    coefficients[0, 0, 3:], coefficients[1, 1], coefficients[2, 2, 4:] = 0.0, 0.0, 0.0
    durations = rng.uniform(0.01, 3.0, 6)
    found = greatest_rates(coefficients, durations)
    for order in range(1, 4):
        for piece, duration in enumerate(durations):
            for joint in range(4):
                curve = np.polynomial.Polynomial(coefficients[piece, joint]).deriv(order)
                flat = curve.deriv().trim().roots()
                inside = flat[np.abs(flat.imag) < 1e-9].real
                places = np.concatenate([[0.0, duration], inside[(inside > 0.0) & (inside < duration)]])
                expected = np.abs(curve(places)).max()
                assert found[order - 1, piece, joint] == pytest.approx(expected, rel=1e-11, abs=1e-12)


def test_a_polynomial_is_its_bezier_curve() -> None:
    random = np.random.default_rng(5)
    coefficients, widths = random.normal(size=(4, 3, 6)), random.uniform(0.1, 2.0, 4)
    control = control_points(coefficients, widths)
    halves = control.copy()
    for level in range(5):
        halves[:, : 5 - level] = 0.5 * (halves[:, : 5 - level] + halves[:, 1 : 6 - level])
    units = coefficients * widths[:, None, None] ** np.arange(6)
    assert halves[:, 0] == pytest.approx((units * 0.5 ** np.arange(6)).sum(axis=2), abs=1e-12)
    assert control[:, 0] == pytest.approx(coefficients[:, :, 0])
    assert control[:, -1] == pytest.approx(units.sum(axis=2))
    assert control_points(coefficients[:, :, :3], widths).shape == (4, 3, 3)


def test_quintics_have_the_values_and_derivatives_that_they_were_made_of() -> None:
    random = np.random.default_rng(6)
    times = np.cumsum(random.uniform(0.02, 1.0, 8)) + 3.0
    wanted = random.normal(size=(3, 8, 5))
    coefficients = hermite(times, *wanted)
    for piece, duration in enumerate(np.diff(times)):
        for order in range(3):
            found = [
                [np.polyval(np.polyder(row[::-1], order), at) for row in coefficients[piece]]
                for at in (0.0, duration)
            ]
            np.testing.assert_allclose(found, wanted[order, piece : piece + 2], atol=1e-9)


def test_what_has_other_shapes_is_refused() -> None:
    with pytest.raises(ValueError, match=r"values of shape \(2, 1\), not \(3, 1\)"):
        hermite(np.arange(3.0), np.zeros((3, 1)), np.zeros((2, 1)), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="intervals"):
        control_points(np.zeros((3, 1, 6)), np.ones(2))
