"""The compiled kernels of the time law. Oracle: the same laws in plain numpy, with dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from laws.interior_point import Rows, iterate
from laws.reference_motion import reference_motion as plain_reference_motion

from cobot.planners.interior_point import Stations, fastest_rate
from cobot.planners.reference import reference_motion
from cobot.planners.timing.cells import basis
from cobot.types import Array

CELLS, ROWS = 14, 3
EVEN = np.ones(CELLS + 2)
SEEDS = range(6)


def random_rows(random: np.random.Generator, x: float, *, jerk: bool) -> Rows:
    first, second, third = random.normal(size=(3, CELLS, ROWS))
    low, high = -random.uniform(0.5, 2.0, first.shape), random.uniform(0.5, 2.0, first.shape)
    bases = np.broadcast_to(basis(x), (CELLS, 3, 3))
    return Rows(np.arange(CELLS), bases, first, second, third if jerk else None, low, high)


def stations(rows: Rows) -> Stations:
    return Stations(rows.cells, rows.basis, rows.first, rows.second, rows.third, rows.low, rows.high)


def problem(seed: int) -> tuple[Rows, list[Rows]]:
    random = np.random.default_rng(seed)
    places = np.tile(np.arange(CELLS), 3)
    bases = np.concatenate([np.broadcast_to(basis(x), (CELLS, 3, 3)) for x in (0.0, 0.5, 1.0)])
    weights = np.repeat([1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0], CELLS)[:, None]
    times = Rows(places, bases, 0.0 * weights, 0.0 * weights, None, 0.0 * weights, weights)
    return times, [random_rows(random, x, jerk=jerk) for x, jerk in ((0.0, False), (0.0, True), (1.0, True))]


def constant(bounded: list[Rows]) -> float:
    """0.8 of the largest constant that keeps all bounds."""
    shares = []
    for rows in bounded:
        if rows.third is None:
            bound = np.where(rows.second > 0.0, rows.high, rows.low) / rows.second
            shares.append(float(bound.min()))
        else:
            shares.append(float(((rows.high / np.abs(rows.third)) ** (2.0 / 3.0)).min()))
    return 0.8 * min(shares)


@pytest.mark.parametrize("count", [1, 7, 8, 9])
def test_a_block_of_stations_that_is_not_full_counts_each_station_once(count: int) -> None:
    times, (accelerations, *_) = problem(1)
    few = Rows(*(None if each is None else each[:count] for each in vars(accelerations).values()))
    found, _, _ = fastest_rate(EVEN, stations(times), [stations(few), stations(accelerations)], 0.0, 3)
    both = [few, accelerations]
    assert found == pytest.approx(iterate(CELLS, times, both, constant(both), 3), rel=1e-9)


def test_changed_bounds_give_exactly_what_new_stations_with_them_give() -> None:
    times, bounded = problem(2)
    _, others = problem(3)
    changed = [stations(each) for each in bounded]
    fastest_rate(EVEN, stations(times), changed, 1e-3, 10)
    fresh = []
    for each, rows, other in zip(changed, bounded, others, strict=True):
        each.bound(other.low, other.high)
        rows.low, rows.high = other.low, other.high
        fresh.append(stations(rows))
    found = fastest_rate(EVEN, stations(times), changed, 1e-3, 10)[0]
    assert (found == fastest_rate(EVEN, stations(times), fresh, 1e-3, 10)[0]).all()
    with pytest.raises(ValueError, match="rows of shape"):
        changed[0].bound(bounded[0].low[1:], bounded[0].high)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("iterations", [1, 4])
def test_the_iterates_are_those_of_the_law_in_numpy(seed: int, iterations: int) -> None:
    times, bounded = problem(seed)
    found, _, count = fastest_rate(
        EVEN, stations(times), [stations(each) for each in bounded], 0.0, iterations
    )
    assert count == iterations
    expected = iterate(CELLS, times, bounded, constant(bounded), iterations)
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_iterate_keeps_all_bounds(seed: int) -> None:
    times, bounded = problem(seed)
    durations = []
    for iterations in (1, 2, 3, 5, 8, 30):
        c, _, _ = fastest_rate(EVEN, stations(times), [stations(each) for each in bounded], 1e-4, iterations)
        for rows in bounded:
            assert rows.slacks(c)[0].min() > 0.0
        durations.append(float((times.high[:, 0] * times.local(c)[:, 0] ** -0.5).sum()))
    assert durations[-1] == min(durations)


def test_bounds_that_no_rate_keeps_are_refused() -> None:
    times, bounded = problem(0)
    bounded[0].low[3, 1] = 0.1
    with pytest.raises(ValueError, match="no rate keeps the bounds"):
        fastest_rate(EVEN, stations(times), [stations(each) for each in bounded], 1e-3, 10)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("slowness", "jerk", "most"), [(1.0, 0.1, 400), (10.0, 0.1, 400), (10.0, 0.1, 60), (6.0, 0.02, 2000)]
)
def test_the_reference_motion_is_that_of_the_law_in_numpy(
    seed: int, slowness: float, jerk: float, most: int
) -> None:
    random = np.random.default_rng(seed)
    places = np.linspace(0.0, 1.0, 41)
    waves = random.normal(size=(3, 4))

    def wave(order: int) -> Array:
        phase = np.pi / 2 * order
        return np.stack([a * b**order * np.sin(b * places + c + phase) for a, b, c in waves.T], axis=1)

    first, second = wave(1), wave(2)
    speed = 1.0 / slowness / np.abs(first).max(axis=1)
    bounds = (10, most, 8.0)
    found, widths = reference_motion(first, second, jerk * first, speed, 1.0, bounds)
    expected, expected_widths = plain_reference_motion(first, second, jerk * first, speed.copy(), 1.0, bounds)
    assert widths == pytest.approx(expected_widths, rel=1e-9)
    assert found == pytest.approx(expected, abs=1e-9)
    assert (np.diff(found) >= 0.0).all()
    assert len(widths) <= most
    assert (widths.max() > 2.0) == (slowness > 1.0 and most > 60)
