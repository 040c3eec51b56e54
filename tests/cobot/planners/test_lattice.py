"""The cheapest way through a graph of arm angles. Oracle: the costs of all ways, edge by edge, in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from cobot.planners.lattice import cheapest
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
