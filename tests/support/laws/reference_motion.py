"""What `cobot.planners.reference` does, said with numpy."""

from __future__ import annotations

import itertools
import math

import numpy as np

from cobot.types import Array

DENSE, MAX_FACTOR, CHANGE, MEAN, WORTH, GENTLE = 3.0, 10.0, 0.07, 17, 0.7, 2.0


def reference_motion(
    first: Array, second: Array, jerk: Array, speed: Array, length: float, bounds: tuple[int, int, float]
) -> tuple[Array, Array]:
    """Control points of s(τ), and the relative durations of the cells."""
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
    even = max(math.ceil((times[-1] + window) / window * bounds[2]), bounds[0])
    cell_s = (times[-1] + window) / even
    along = 0.5 * np.diff(square) / step
    used = [
        np.abs(first[k:][: points - 1] * along[:, None] + (second * square[:, None])[k:][: points - 1])
        for k in (0, 1)
    ]
    speeding_up_s = float((np.abs(first) * v[:, None]).max())
    gentler = min(max((speeding_up_s / (GENTLE * window)) ** (1.0 / 3.0), 1.0), 10.0)
    factors = widened(times, np.max(used, axis=(0, 2)), cell_s, even, int(bounds[2]) + 1, gentler)
    amounts = np.concatenate([[0.0], np.cumsum(1.0 / factors)])
    cells = int(min(max(math.ceil(amounts[-1]), bounds[0]), bounds[1]))
    places = np.interp(np.linspace(0.0, amounts[-1], cells + 1), amounts, np.arange(even + 1.0))
    if are_equal := amounts[-1] > min(WORTH * even, bounds[1]):
        cells = min(even, int(bounds[1]))
        places = np.arange(cells + 1.0) * even / cells
    ends, widths = cell_s * places, np.diff(places)

    def at(t: float) -> tuple[float, float, float]:
        """The integral of the way, the way, and the speed."""
        if t <= 0.0:
            return 0.0, 0.0, 0.0
        if t >= times[-1]:
            return areas[-1] + length * (t - times[-1]), length, 0.0
        i = min(int(np.searchsorted(times, t, side="right")) - 1, points - 2)
        e, a = t - times[i], accelerations[i]
        area = areas[i] + ways[i] * e + v[i] * e**2 / 2.0 + a * e**3 / 6.0
        return area, ways[i] + v[i] * e + a * e**2 / 2.0, v[i] + a * e

    control = np.zeros(cells + 3)
    for i in range(2, cells - 1):
        value, slope, bend = (np.array(at(ends[i])) - at(ends[i] - window)) / window
        mean_s, longer_s = 0.5 * (ends[i + 1] - ends[i - 1]), ends[i + 1] - 2.0 * ends[i] + ends[i - 1]
        control[i + 1] = value - (bend * mean_s**2 + slope * longer_s) / 6.0
        control[i + 1] = min(max(control[i + 1], control[i]), length)
    control[cells:] = length
    return control, widths / widths[0] if are_equal else widths


def widened(times: Array, used: Array, cell_s: float, even: int, mean: int, gentler: float) -> Array:
    """How many times longer than `cell_s` a cell may take, at the middle of each of `even` cells."""
    grid = np.arange(even + 1.0) * cell_s
    needed = np.zeros(even)
    for i, (begin, end) in enumerate(itertools.pairwise(grid)):
        inside = (times[1:] > begin) & (times[:-1] < end)
        passed = float(np.diff(np.interp([begin, end], times, np.arange(len(times))))[0])
        needed[i] = max(passed, DENSE * used[inside].max(initial=0.0))
    needed[: mean + 1] = 1.0
    needed[grid[1:] >= times[-1] - mean * cell_s] = 1.0
    needed = np.clip(needed, 1.0 / MAX_FACTOR, 1.0)
    factors = np.array([1.0 / needed[max(0, i - mean) : i + 2].max() for i in range(even)])
    steps = CHANGE / gentler * np.abs(np.subtract.outer(np.arange(even), np.arange(even)))
    factors = (factors + steps).min(axis=1)
    half = int(gentler * MEAN / 2.0)
    for _ in range(3):
        padded = np.pad(factors, half, mode="edge")
        factors = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).mean(axis=1)
    return np.asarray(factors)
