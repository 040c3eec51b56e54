"""The cheapest way through a graph of arm angles. Oracle: the costs of all ways, edge by edge, in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from cobot.planners.lattice import cheapest, leads, link
from cobot.types import Array

DOF = 7
STEP_RAD = 0.9


def costs_of_all_ways(rows: Array, costs: Array, start: Array, weights: Array, window: int) -> Array:
    """Of the cheapest way to each node, shape (n, m), by the definition of an edge."""
    n, m = costs.shape
    found = np.full((n, m), np.inf)
    for place in range(n):
        begins = start[None] if place == 0 else rows[place - 1]
        before = np.zeros(1) if place == 0 else found[place - 1]
        for angle in range(m):
            steps = np.abs(rows[place, angle] - begins)
            edges = np.where((steps <= STEP_RAD).all(axis=1), ((steps * weights) ** 2).sum(axis=1), np.inf)
            if place > 0:
                apart = np.abs(np.arange(m) - angle)
                edges[np.minimum(apart, m - apart) > window] = np.inf
            found[place, angle] = costs[place, angle] + (before + edges).min()
    return found


@pytest.mark.parametrize("window", [0, 1, 4])
@pytest.mark.parametrize("seed", range(20))
def test_no_way_is_cheaper(seed: int, window: int) -> None:
    random = np.random.default_rng(seed)
    n, m = 12, 9
    rows, start = random.uniform(-0.5, 0.5, (n, m, DOF)), np.zeros(DOF)
    costs = np.where(random.uniform(size=(n, m)) < 0.2, np.inf, random.uniform(size=(n, m)))
    if seed % 4 == 0:
        costs[7] = np.inf  # No way leads on from there.
    weights = random.uniform(0.5, 2.0, DOF)
    expected = costs_of_all_ways(rows, costs, start, weights, window)
    leads_on = np.isfinite(expected).any(axis=1)
    indices, reached = cheapest(rows, costs, start, weights, window, STEP_RAD)
    if not leads_on.all():
        assert (len(indices), reached) == (0, int(leads_on.argmin()))
        return
    assert reached == n
    way = rows[np.arange(n), indices]
    steps = np.diff(np.vstack([start, way]), axis=0)
    assert np.abs(steps).max() <= STEP_RAD
    turned = np.abs(np.diff(indices))
    assert np.minimum(turned, m - turned).max() <= window
    total = costs[np.arange(n), indices].sum() + ((steps * weights) ** 2).sum()
    assert total == pytest.approx(expected[-1].min(), rel=1e-12)


@pytest.mark.parametrize("window", [0, 1, 4, 40])
@pytest.mark.parametrize("seed", range(10))
def test_ways_lead_as_far_as_the_cheapest_ones(seed: int, window: int) -> None:
    random = np.random.default_rng(seed)
    n, m = 12, 9
    rows, start = random.uniform(-0.6, 0.6, (n, m, DOF)), np.zeros(DOF)
    good = random.uniform(size=(n, m)) < 0.7
    costs = np.where(good, 0.0, np.inf)
    expected = np.isfinite(costs_of_all_ways(rows, costs, start, np.ones(DOF), min(window, m // 2)))
    leads_on = expected.any(axis=1)
    reached = n if leads_on.all() else int(leads_on.argmin())
    assert leads(rows, good, start, window, STEP_RAD) == reached


@pytest.mark.parametrize("seed", range(5))
def test_each_node_is_linked_to_the_cheapest_way_before_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, before = random.uniform(-0.7, 0.7, (20, DOF)), random.uniform(-0.7, 0.7, (30, DOF))
    rows[:3] += 5.0  # out of reach
    costs, spent = random.uniform(size=20), random.uniform(size=30)
    weights = random.uniform(0.5, 2.0, DOF)
    steps = rows[:, None] - before
    totals = spent + ((steps * weights) ** 2).sum(axis=2)
    totals[np.abs(steps).max(axis=2) > STEP_RAD] = np.inf
    parents, found = link(rows, costs, before, spent, weights, STEP_RAD)
    reached = np.isfinite(totals.min(axis=1))
    assert reached.tolist() == 3 * [False] + 17 * [True]
    assert (parents[reached] == totals.argmin(axis=1)[reached]).all()
    np.testing.assert_allclose(found, totals.min(axis=1) + costs, rtol=1e-14)
