"""How far the arm goes beyond the targets of a stream that steps, stops or wavers, at jitter up to a period.

Oracle: the range of the targets that the test itself sends; the figures are those of docs/streaming.md.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from rig import Rig

from cobot.ipc.layout import Interpolation
from cobot.types import Array
from rtloop.generators.target_range import SHARE

MOVED = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0])
"""Joints far from everything: with the others the arm slows down near itself."""
RATES_HZ = (10, 30, 100, 333, 1000)
ROUNDING_RAD = 2e-6
"""A stop this far beyond a target is one at the target: the safety layer rounds stops to 1e-7 rad."""
STILL_S = 0.3


def steps(rate_hz: int, random: np.random.Generator) -> Array:
    """Still, a step that no jump is, still: up, and half the way back."""
    size = min(0.02, 0.7 * (1.0 / rate_hz + 0.005))
    held = np.ones(max(2, round(0.4 * rate_hz)))
    return np.concatenate([0.0 * held, size * held, 0.5 * size * held])


def ramp(rate_hz: int, random: np.random.Generator) -> Array:
    """At a constant speed, then still at once."""
    speed, rise_s = random.uniform(0.05, 0.6), random.uniform(0.2, 1.0)
    times_s = np.arange(round((rise_s + 0.5) * rate_hz) + 2) / rate_hz
    return speed * np.minimum(times_s, rise_s)


def walk(rate_hz: int, random: np.random.Generator) -> Array:
    return np.cumsum(random.uniform(-0.6, 0.6, max(12, round(0.8 * rate_hz))) / rate_hz)


def noise(rate_hz: int, random: np.random.Generator) -> Array:
    return random.uniform(-1.0, 1.0, max(12, round(0.6 * rate_hz))) * min(0.01, 0.4 / rate_hz)


def followed(rig: Rig, kind: Interpolation, rate_hz: int, targets: Array, arrivals_s: Array) -> Array:
    """Where the moved joints are commanded, from home, (n, 4)."""
    assert rig.stream(interpolation=kind, decimation=max(1, round(1000 / rate_hz))) == ""
    sent, begun = 0, len(rig.commanded)
    for cycle in range(round((arrivals_s[-1] + STILL_S) * 1000)):
        arrived = np.searchsorted(arrivals_s, cycle * 1e-3 + 1e-9, side="right")
        if arrived > sent:
            rig.aim(joints=rig.home + MOVED * targets[arrived - 1])
            sent = arrived
        rig.step()
    return (np.array(rig.commanded[begun:]) - rig.home)[:, MOVED > 0.0]


def arrivals(targets: Array, rate_hz: int, jitter: float, random: np.random.Generator) -> Array:
    """In order, each up to a share of a period late."""
    late = random.uniform(0.0, jitter, len(targets))
    return np.maximum.accumulate((np.arange(len(targets)) + late) / rate_hz)


@pytest.mark.parametrize("kind", Interpolation)
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_no_stream_goes_beyond_a_step_that_stands_still(rig: Rig, kind: Interpolation, rate_hz: int) -> None:
    random = np.random.default_rng(rate_hz)
    targets = steps(rate_hz, random)
    way = followed(rig, kind, rate_hz, targets, arrivals(targets, rate_hz, random.uniform(), random))
    peak = int(way[:, 0].argmax())
    assert way.max() <= targets.max() + ROUNDING_RAD
    assert way[:peak].min() >= -ROUNDING_RAD
    assert way[peak:].min() >= targets[-1] - ROUNDING_RAD
    np.testing.assert_allclose(way[-1], targets[-1], atol=1e-5)
    assert rig.counted().keys() <= {"VELOCITY", "ACCELERATION", "JERK"}


@pytest.mark.parametrize("kind", Interpolation)
@pytest.mark.parametrize("make", [ramp, walk, noise])
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_no_stream_goes_beyond_the_range_of_its_targets_by_more_than_the_stated_share(
    rig: Rig, kind: Interpolation, make: Callable[[int, np.random.Generator], Array], rate_hz: int
) -> None:
    random = np.random.default_rng([rate_hz, len(make.__name__)])
    targets = make(rate_hz, random)
    way = followed(rig, kind, rate_hz, targets, arrivals(targets, rate_hz, random.uniform(), random))
    low, high = min(targets.min(), 0.0), max(targets.max(), 0.0)
    beyond = max(way.max() - high, low - way.min())
    assert beyond <= SHARE * (high - low) + ROUNDING_RAD
    if kind is Interpolation.NONE:
        assert beyond <= ROUNDING_RAD, "it never looks ahead"
