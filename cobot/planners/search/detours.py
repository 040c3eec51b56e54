"""Removal of detours: a shorter path from several that a search has found.

A search returns a path through the first gap that it finds. This path often passes obstacles at a large
distance. Cuts shorten it only within that gap. Here the corners of several paths form one roadmap, and its
shortest path combines the best part of each. Then configurations are sampled around that path and added to
the next roadmap, until the path no longer improves.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cobot.planners.roadmap import shortest
from cobot.planners.shortcut import shorten
from cobot.robot.clearance import Clearance
from cobot.types import Array

STEP_RAD = 0.8
"""Largest distance between two nodes on a path."""
DRAWS, FINE_RAD = 100, 0.2
"""Number of configurations that are drawn around a path, and distance between the points of the path around
which they are drawn.
"""
SPREADS_RAD = (0.6, 0.4, 0.2)
"""Standard deviation of each joint when configurations are drawn. Each round uses the next value."""
STALLS = 2
"""The search ends after this many rounds with a relative gain below `GAIN`."""
GAIN = 0.01
ROUND_WORK = 10_000
"""Maximum number of collision checks in a round."""


def without_detours(
    clearance: Clearance,
    paths: Sequence[Array],
    goals: Array,
    bounds: tuple[Array, Array],
    seed: int,
    end_s: float = np.inf,
) -> Array:
    """A collision-free polyline that is no longer than the shortest of the given paths.

    Args:
        paths: at least one collision-free path. All begin at the same start and end at one of the goals;
            shape (n, dof) each.
        goals: joint angles of the goals, shape (k, dof).
        bounds: the lowest and the highest allowed joint angles, shape (dof,) each.
        end_s: time of `time.monotonic` after which no further change is tried.
    """
    random = np.random.default_rng(seed)
    best = min(paths, key=length)
    cloud = np.vstack([divide(path, STEP_RAD)[1:-1] for path in paths])
    stalls, number = 0, 0
    while stalls < STALLS and time.monotonic() <= end_s:
        nodes = np.vstack([best[:1], cloud, goals])
        before_rad = length(best)
        way = shortest(clearance, nodes, len(goals), before_rad, ROUND_WORK)
        if way is not None:
            best = shorten(clearance, way, seed, end_s)
        stalls = stalls + 1 if length(best) > (1.0 - GAIN) * before_rad else 0
        drawn = _draw(best, goals, bounds, SPREADS_RAD[number % len(SPREADS_RAD)], random)
        number += 1
        cloud = np.vstack([divide(best, STEP_RAD)[1:-1], drawn[clearance.are_free(drawn)]])
    return best


def _draw(
    way: Array, goals: Array, bounds: tuple[Array, Array], spread_rad: float, random: np.random.Generator
) -> Array:
    """Random configurations near a path, shape (n, dof). A shorter path may lead through them."""
    places = divide(way, FINE_RAD)
    drawn = places[random.integers(len(places), size=DRAWS)]
    drawn = np.clip(drawn + spread_rad * random.normal(size=drawn.shape), *bounds)
    onward = np.linalg.norm(drawn[:, None] - goals, axis=2).min(axis=1)
    return np.asarray(drawn[np.linalg.norm(drawn - way[0], axis=1) + onward < length(way)])


def divide(corners: Array, step_rad: float) -> Array:
    """The polyline with corners added until the distance between neighbours is at most `step_rad`."""
    parts = [corners[:1]]
    for begin, end in pairwise(corners):
        count = max(1, int(np.ceil(np.linalg.norm(end - begin) / step_rad)))
        parts.append(begin + np.arange(1, count + 1)[:, None] / count * (end - begin))
    return np.vstack(parts)


def length(corners: Array) -> float:
    """The length of a polyline, shape (n, dof)."""
    steps = corners[1:] - corners[:-1]
    return float(np.sqrt((steps * steps).sum(axis=1)).sum())
