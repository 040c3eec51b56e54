"""What `cobot.planners.interior_point` does, said with numpy and dense matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot.types import Array


@dataclass
class Rows:
    """See `Stations`; `third` is None for accelerations."""

    cells: Array
    basis: Array
    first: Array
    second: Array
    third: Array | None
    low: Array
    high: Array

    def local(self, c: Array) -> Array:
        """b, b', b'' at each station, shape (n, 3)."""
        return np.einsum("nij,nj->ni", self.basis, c[self.cells[:, None] + np.arange(3)])

    def slacks(self, c: Array) -> tuple[Array, Array]:
        """To the upper and the lower bound, shape (2, n, m), and their gradients, (2, n, m, len(c))."""
        y = self.local(c)
        if self.third is None:
            g = np.stack([self.second, 0.5 * self.first, 0.0 * self.first], axis=-1)
            upper, lower, slope = self.high, -self.low, np.zeros_like(self.high)
        else:
            g = np.stack([self.third, 1.5 * self.second, 0.5 * self.first], axis=-1)
            upper = lower = self.high * y[:, :1] ** -0.5
            slope = -0.5 * self.high * y[:, :1] ** -1.5
        value = np.einsum("nmi,ni->nm", g, y)
        local = np.array([-g, g])
        local[..., 0] += slope
        full = np.zeros((*local.shape[:3], len(c)))
        for station, cell in enumerate(self.cells):
            full[:, station, :, cell : cell + 3] = local[:, station] @ self.basis[station]
        return np.array([upper - value, lower + value]), full


def iterate(cells: int, times: Rows, bounded: Sequence[Rows], begin: float, iterations: int) -> Array:
    """The coefficients after so many iterations from a constant, without an end."""
    c = np.full(cells + 2, begin)
    rows = sum(2 * each.first.size for each in bounded)
    barrier = 0.3 * _duration(times, c) / rows
    duals: list[Array] = []
    for _ in range(iterations):
        matrix, right = _objective(times, c)
        found = [each.slacks(c) for each in bounded]
        duals = duals or [barrier / slack for slack, _ in found]
        for (slack, gradient), dual in zip(found, duals, strict=True):
            flat = gradient.reshape(-1, len(c))
            matrix += flat.T @ ((dual / slack).reshape(-1, 1) * flat)
            right += flat.T @ (barrier / slack).ravel()
        step = np.linalg.solve(matrix, right)
        primal = dual_share = 1.0
        changes = []
        for each, (slack, gradient), dual in zip(bounded, found, duals, strict=True):
            b, db = each.local(c)[:, 0], each.local(step)[:, 0]
            moved = gradient @ step
            changes.append(barrier / slack - dual - dual / slack * moved)
            primal = min(primal, _share(b, db, 0.9), _share(slack, moved, 0.99))
            dual_share = min(dual_share, _share(dual, changes[-1], 0.99))
        c = c + primal * step
        duals = [dual + dual_share * change for dual, change in zip(duals, changes, strict=True)]
        if primal > 0.5 and dual_share > 0.5:
            barrier *= 0.2
        elif primal > 0.1:
            barrier *= 0.7
    return c


def _share(values: Array, changes: Array, part: float) -> float:
    falling = changes < 0.0
    return float((part * -values[falling] / changes[falling]).min(initial=np.inf))


def _duration(times: Rows, c: Array) -> float:
    return float((times.high[:, 0] * times.local(c)[:, 0] ** -0.5).sum())


def _objective(times: Rows, c: Array) -> tuple[Array, Array]:
    matrix, right = np.zeros((len(c), len(c))), np.zeros(len(c))
    for cell, basis, weight, b in zip(
        times.cells, times.basis, times.high[:, 0], times.local(c)[:, 0], strict=True
    ):
        place = slice(cell, cell + 3)
        matrix[place, place] += 0.75 * weight * b**-2.5 * np.outer(basis[0], basis[0])
        right[place] += 0.5 * weight * b**-1.5 * basis[0]
    return matrix, right
