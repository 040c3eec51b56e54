"""What `cobot.planners.reference` does, said with numpy."""

from __future__ import annotations

import math

import numpy as np

from cobot.types import Array


def reference_motion(
    first: Array, second: Array, jerk: Array, speed: Array, length: float, bounds: tuple[int, int, float]
) -> tuple[Array, float]:
    """Control points of s(τ), and how long a cell takes."""
    points = len(first)
    step = length / (points - 1)

    def largest(i: int, square: float, way: float) -> float:
        return max(
            float(((1.0 - way * np.sign(first[i]) * second[i] * square) / np.abs(first[i])).min()), 0.0
        )

    square = speed**2
    square[[0, -1]] = 0.0
    for i in range(points - 1):
        square[i + 1] = min(square[i + 1], square[i] + 2.0 * step * largest(i, square[i], 1.0))
    for i in range(points - 1, 0, -1):
        square[i - 1] = min(square[i - 1], square[i] + 2.0 * step * largest(i, square[i], -1.0))
    v = np.sqrt(square)
    durations = 2.0 * step / (v[1:] + v[:-1])
    times = np.concatenate([[0.0], np.cumsum(durations)])
    ways = step * np.arange(points)
    accelerations = np.diff(v) / durations
    areas = np.concatenate(
        [[0.0], np.cumsum(durations * (ways[:-1] + durations * (2.0 * v[:-1] + v[1:]) / 6.0))]
    )
    window = min(float((np.abs(jerk).max(axis=1) / np.abs(first).max(axis=1)).max()), times[-1])
    cells = int(min(max(math.ceil((times[-1] + window) / window * bounds[2]), bounds[0]), bounds[1]))
    cell_s = (times[-1] + window) / cells

    def at(t: float) -> tuple[float, float]:
        """The integral of the way, and the speed."""
        if t <= 0.0:
            return 0.0, 0.0
        if t >= times[-1]:
            return areas[-1] + length * (t - times[-1]), 0.0
        i = min(int(np.searchsorted(times, t, side="right")) - 1, points - 2)
        e, a = t - times[i], accelerations[i]
        return areas[i] + ways[i] * e + v[i] * e**2 / 2.0 + a * e**3 / 6.0, v[i] + a * e

    control = np.zeros(cells + 3)
    for i in range(2, cells - 1):
        area, now = at(i * cell_s)
        before, then = at(i * cell_s - window)
        control[i + 1] = (area - before) / window - cell_s**2 * (now - then) / window / 6.0
        control[i + 1] = min(max(control[i + 1], control[i]), length)
    control[cells:] = length
    return control, cell_s
