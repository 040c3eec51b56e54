"""Piecewise quintics. Oracle: scipy's PPoly and BPoly, exact fractions for extrema, dense samples."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, PPoly

from cobot.errors import InputError
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array

SEED = 20261121
EXAMPLES = settings(max_examples=100)
values = st.floats(-3.0, 3.0).map(lambda value: round(value, 6))
durations = st.floats(0.01, 5.0)


@st.composite
def hermite_data(draw: st.DrawFn) -> tuple[Array, Array, Array, Array]:
    """Times (n+1,) and positions, velocities, accelerations (n+1, dof)."""
    steps = draw(st.lists(durations, min_size=1, max_size=5))
    dof = draw(st.integers(1, 3))
    shape = (3, len(steps) + 1, dof)
    flat = draw(st.lists(values, min_size=int(np.prod(shape)), max_size=int(np.prod(shape))))
    positions, velocities, accelerations = np.reshape(flat, shape)
    return np.concatenate([[0.0], np.cumsum(steps)]), positions, velocities, accelerations


def scipys(trajectory: Trajectory) -> PPoly:
    """The same polynomials, for scipy, which counts powers the other way round."""
    return PPoly(trajectory.coefficients.transpose(2, 0, 1)[::-1], trajectory.breakpoints_s)


def dense(trajectory: Trajectory, derivative: int, per_segment: int = 2000) -> Array:
    """Values of each segment from its start to its end, by numpy's polynomials; shape (many, dof)."""
    rows = []
    for segment, duration in enumerate(np.diff(trajectory.breakpoints_s)):
        times = np.linspace(0.0, duration, per_segment)
        polynomials = [
            np.polynomial.Polynomial(column).deriv(derivative)
            if derivative
            else np.polynomial.Polynomial(column)
            for column in trajectory.coefficients[segment]
        ]
        rows.append(np.stack([polynomial(times) for polynomial in polynomials], axis=1))
    return np.concatenate(rows)


def straight(distance: float = 1.0, duration_s: float = 2.0) -> Trajectory:
    """One joint from rest to rest."""
    still = np.zeros((2, 1))
    return from_hermite(np.array([0.0, duration_s]), np.array([[0.0], [distance]]), still, still)


@EXAMPLES
@given(hermite_data(), st.integers(0, 3))
def test_samples_are_those_of_scipys_piecewise_polynomial(
    data: tuple[Array, Array, Array, Array], derivative: int
) -> None:
    trajectory = from_hermite(*data)
    times = np.linspace(0.0, trajectory.duration_s, 101)
    expected = scipys(trajectory).derivative(derivative)(times)
    scale = 1.0 + np.abs(expected).max()
    assert trajectory.sample(times, derivative) == pytest.approx(expected, abs=1e-9 * scale)


@EXAMPLES
@given(hermite_data())
def test_quintics_through_given_values_are_those_of_scipy(data: tuple[Array, Array, Array, Array]) -> None:
    times, *given_values = data
    trajectory = from_hermite(*data)
    expected = BPoly.from_derivatives(times, np.stack(given_values, axis=1), orders=5)
    between = np.linspace(0.0, times[-1], 101)
    for derivative in range(3):
        wanted = expected.derivative(derivative)(between) if derivative else expected(between)
        scale = 1.0 + np.abs(wanted).max()
        assert trajectory.sample(between, derivative) == pytest.approx(wanted, abs=1e-8 * scale)
        at_the_points = trajectory.sample(times, derivative)
        assert at_the_points == pytest.approx(given_values[derivative], abs=1e-7 * scale)


@EXAMPLES
@given(hermite_data(), st.integers(0, 3))
def test_extrema_are_never_exceeded_and_always_attained(
    data: tuple[Array, Array, Array, Array], derivative: int
) -> None:
    trajectory = from_hermite(*data)
    lowest, highest = trajectory.extrema(derivative)
    seen = dense(trajectory, derivative)
    low, high = seen.min(axis=0), seen.max(axis=0)
    span = 1e-9 * (1.0 + np.abs(seen).max())
    assert (lowest <= low + span).all()
    assert (highest >= high - span).all()
    # A sample is half a step from the true extremum at the most: it misses by the slope's change over it.
    step = np.diff(trajectory.breakpoints_s).max() / 1999
    slope = np.abs(dense(trajectory, derivative + 1)).max()
    assert (low - lowest <= 0.5 * step * slope + span).all()
    assert (highest - high <= 0.5 * step * slope + span).all()


def test_extrema_of_polynomials_with_known_roots_are_exact() -> None:
    # p' = (t - 1/3)(t - 1/2)(t - 3/4)(t - 2), integrated in fractions.
    roots = [Fraction(1, 3), Fraction(1, 2), Fraction(3, 4), Fraction(2)]
    slope = [Fraction(1)]
    for root in roots:
        slope = [a - root * b for a, b in zip([Fraction(0), *slope], [*slope, Fraction(0)], strict=True)]
    coefficients = [Fraction(0), *(c / (k + 1) for k, c in enumerate(slope))]
    places = [Fraction(0), *roots[:3], Fraction(1)]
    candidates = [sum(c * place**k for k, c in enumerate(coefficients)) for place in places]
    trajectory = Trajectory(np.array([0.0, 1.0]), np.array([[[float(c) for c in coefficients]]]))
    lowest, highest = trajectory.extrema()
    assert lowest[0] == pytest.approx(float(min(candidates)), abs=1e-15)
    assert highest[0] == pytest.approx(float(max(candidates)), abs=1e-15)


@pytest.mark.parametrize(
    ("coefficients", "lowest", "highest"),
    [
        ([0, 0, 0, 0, 0, 0], 0.0, 0.0),
        ([2, 0, 0, 0, 0, 0], 2.0, 2.0),
        ([0, 1, 0, 0, 0, 0], 0.0, 1.0),
        ([0, 1, -1, 0, 0, 0], 0.0, 0.25),
        ([0, -1, 1, 0, 0, 0], -0.25, 0.0),
        ([0, 0, 0, 1, -2, 1], 0.0, 0.03456),  # t³(1-t)², largest at 3/5
        ([0, 0, 4, -8, 4, 0], 0.0, 0.25),  # 4t²(1-t)²
        ([0, 1, -1, 0, 0, 1e-14], 0.0, 0.25),
        ([0, 1e-8, -1e-8, 0, 0, 0], 0.0, 0.25e-8),
    ],
)
def test_extrema_of_polynomials_of_any_degree_are_exact(
    coefficients: list[float], lowest: float, highest: float
) -> None:
    trajectory = Trajectory(np.array([0.0, 1.0]), np.array([[coefficients]], dtype=float))
    low, high = trajectory.extrema()
    assert (low[0], high[0]) == pytest.approx((lowest, highest), rel=1e-12, abs=1e-13)


def test_extrema_of_the_jerk_see_both_sides_of_a_step() -> None:
    # Two cubics that meet in position, velocity and acceleration, with jerks of 6 and -6.
    trajectory = Trajectory(
        np.array([0.0, 1.0, 2.0]), np.array([[[0, 0, 0, 1.0, 0, 0]], [[1.0, 3.0, 3.0, -1.0, 0, 0]]])
    )
    low, high = trajectory.extrema(3)
    assert (low[0], high[0]) == (-6.0, 6.0)


@EXAMPLES
@given(hermite_data(), st.floats(0.2, 5.0), st.integers(0, 3))
def test_a_stretched_trajectory_is_the_same_path_more_slowly(
    data: tuple[Array, Array, Array, Array], factor: float, derivative: int
) -> None:
    trajectory = from_hermite(*data)
    slow = trajectory.stretched(factor)
    assert slow.duration_s == pytest.approx(factor * trajectory.duration_s)
    middles = trajectory.breakpoints_s[:-1] + 0.37 * np.diff(trajectory.breakpoints_s)
    expected = scipys(trajectory).derivative(derivative)(middles) / factor**derivative
    scale = 1.0 + np.abs(expected).max()
    assert slow.sample(factor * middles, derivative) == pytest.approx(expected, abs=1e-8 * scale)


@EXAMPLES
@given(hermite_data(), st.integers(0, 3), st.floats(0.0, 2.0))
def test_the_excesses_begin_with_the_first_segment_that_leaves_the_bounds(
    data: tuple[Array, Array, Array, Array], derivative: int, share: float
) -> None:
    trajectory = from_hermite(*data)
    per_segment = dense(trajectory, derivative).reshape(trajectory.segments, -1, trajectory.dof)
    lows, highs = per_segment.min(axis=1), per_segment.max(axis=1)
    high = share * np.abs(per_segment).max(axis=(0, 1)) + 1e-3
    # Where samples come within the bounds by less than they can resolve, they do not judge.
    slope = np.abs(dense(trajectory, derivative + 1)).max()
    blur = np.diff(trajectory.breakpoints_s).max() / 1999 * slope + 1e-9
    surely = np.argwhere((lows < -high - blur) | (highs > high + blur))
    perhaps = np.argwhere((lows < -high + blur) & (lows > -high - blur) | (abs(highs - high) <= blur))
    found = list(zip(*trajectory.excesses(derivative, -high, high), strict=True))
    if len(perhaps) == 0:
        assert len(found) == len(surely)
    if found:
        segment, joint, value = found[0]
        assert abs(value) > high[joint]
        assert lows[segment, joint] - blur <= value <= highs[segment, joint] + blur
        if len(surely):
            assert (segment, joint) <= tuple(surely[0])


def test_times_outside_the_trajectory_are_held_at_its_ends() -> None:
    trajectory = straight(distance=1.0, duration_s=2.0)
    assert trajectory.sample([-1.0, 0.0, 2.0, 99.0])[:, 0] == pytest.approx([0.0, 0.0, 1.0, 1.0])
    assert trajectory.start.tolist() == [0.0]
    assert trajectory.end == pytest.approx([1.0])


def test_a_motion_followed_by_another_is_both_after_each_other() -> None:
    first, second = straight(1.0, 2.0), straight(-0.5, 1.0)
    moved = Trajectory(second.breakpoints_s, second.coefficients + np.eye(6)[0] * 1.0)
    both = first.followed_by(moved)
    assert both.duration_s == 3.0
    assert both.segments == 2
    assert both.sample([1.0, 2.0, 2.5, 3.0]) == pytest.approx(
        np.vstack([first.sample([1.0, 2.0]), moved.sample([0.5, 1.0])])
    )


def test_motions_that_do_not_meet_cannot_follow_each_other() -> None:
    with pytest.raises(InputError, match=r"position of joint 1 jumps by 1 at 2\.000 s"):
        straight(1.0, 2.0).followed_by(straight(1.0, 2.0))


@pytest.mark.parametrize(("order", "name"), [(0, "position"), (1, "velocity"), (2, "acceleration")])
def test_a_jump_is_refused_with_its_quantity_joint_size_and_time(order: int, name: str) -> None:
    coefficients = np.zeros((3, 2, 6))
    coefficients[2, 1, order] = 0.25
    size = 0.25 * (2 if order == 2 else 1)
    with pytest.raises(InputError, match=rf"the {name} of joint 2 jumps by {size:g} at 1\.500 s"):
        Trajectory(np.array([0.0, 0.5, 1.5, 2.0]), coefficients)


def test_a_jump_of_the_jerk_is_no_jump() -> None:
    coefficients = np.zeros((2, 1, 6))
    coefficients[1, 0, 3:] = 1.0
    assert Trajectory(np.array([0.0, 1.0, 2.0]), coefficients).segments == 2


@pytest.mark.parametrize(
    ("breakpoints", "shape", "message"),
    [
        ([0.0, 1.0], (1, 2, 5), "needs breakpoints"),
        ([0.0, 1.0], (2, 2, 6), "needs breakpoints"),
        ([0.0, 1.0, 2.0], (1, 2, 6), "needs breakpoints"),
        ([0.0, 1.0], (2, 6), "needs breakpoints"),
        ([0.0], (0, 2, 6), "start at 0 and be strictly increasing"),
        ([0.1, 1.0], (1, 2, 6), "start at 0 and be strictly increasing"),
        ([0.0, 1.0, 1.0], (2, 2, 6), "start at 0 and be strictly increasing"),
        ([0.0, 1.0, 0.5], (2, 2, 6), "start at 0 and be strictly increasing"),
        ([0.0, np.nan], (1, 2, 6), "must be finite"),
        ([0.0, np.inf], (1, 2, 6), "must be finite"),
    ],
)
def test_what_is_no_trajectory_is_refused(
    breakpoints: list[float], shape: tuple[int, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Trajectory(np.array(breakpoints), np.zeros(shape))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_coefficients_that_are_not_finite_are_refused(value: float) -> None:
    coefficients = np.zeros((1, 2, 6))
    coefficients[0, 1, 3] = value
    with pytest.raises(InputError, match="must be finite"):
        Trajectory(np.array([0.0, 1.0]), coefficients)


def test_a_trajectory_cannot_be_changed_after_its_checks() -> None:
    trajectory = straight()
    with pytest.raises(ValueError, match="read-only"):
        trajectory.coefficients[0, 0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.breakpoints_s[0] = 1.0
