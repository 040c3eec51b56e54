"""How far the arm goes beyond the targets of a stream that steps, stops or wavers, at jitter up to a period.

Oracle: the range of the targets that the test itself sends; the figures are those of docs/streaming.md.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from rig import Rig

from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.ipc.stream_writer import PointWriter
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


def followed_points(
    rig: Rig, mode: ServoMode, law: tuple[float, float], rate_hz: int, targets: Array, arrivals_s: Array
) -> Array:
    """The same of the points of a servo session."""
    assert rig.stream(servo_mode=mode, watchdog_s=60.0) == ""
    writer = PointWriter(rig.memory)
    writer.begin(int(rig.memory.session.data["number"]))
    sent, begun = 0, len(rig.commanded)
    for cycle in range(round((arrivals_s[-1] + 1.5) * 1000)):
        arrived = np.searchsorted(arrivals_s, cycle * 1e-3 + 1e-9, side="right")
        for target in targets[sent:arrived]:
            assert writer.put(rig.home + MOVED * target, 1.0 / rate_hz, *law)
        sent = arrived
        rig.step()
    return (np.array(rig.commanded[begun:]) - rig.home)[:, MOVED > 0.0]


def require_no_way_beyond_steps(way: Array, targets: Array) -> None:
    peak = int(way[:, 0].argmax())
    assert way.max() <= targets.max() + ROUNDING_RAD
    assert way[:peak].min() >= -ROUNDING_RAD
    assert way[peak:].min() >= targets[-1] - ROUNDING_RAD
    np.testing.assert_allclose(way[-1], targets[-1], atol=1e-5)


def beyond(way: Array, targets: Array) -> tuple[float, float]:
    """How far the way leads beyond the range of the targets and its start, and that range."""
    low, high = min(targets.min(), 0.0), max(targets.max(), 0.0)
    return max(way.max() - high, low - way.min()), high - low


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
    require_no_way_beyond_steps(way, targets)
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
    too_far, extent = beyond(way, targets)
    assert too_far <= SHARE * extent + ROUNDING_RAD
    if kind is Interpolation.NONE:
        assert too_far <= ROUNDING_RAD, "it never looks ahead"


NO_LAW, LEAST_DAMPED = (0.0, 0.0), (0.03, 100.0)
"""Of lookahead_time and gain: a damping ratio of 0.15, with which the law by itself overshoots by 62 %."""
SERVO = [
    (ServoMode.REPLANNED, NO_LAW),
    (ServoMode.DIRECT, NO_LAW),
    (ServoMode.DIRECT, LEAST_DAMPED),
    (ServoMode.BUFFERED, NO_LAW),
    (ServoMode.BUFFERED, LEAST_DAMPED),
]


@pytest.mark.parametrize(("mode", "law"), SERVO)
@pytest.mark.parametrize("rate_hz", [10, 100, 1000])
def test_no_servo_session_goes_beyond_a_step_that_stands_still(
    rig: Rig, mode: ServoMode, law: tuple[float, float], rate_hz: int
) -> None:
    random = np.random.default_rng(rate_hz)
    targets = steps(rate_hz, random)
    times_s = arrivals(targets, rate_hz, random.uniform(), random)
    require_no_way_beyond_steps(followed_points(rig, mode, law, rate_hz, targets, times_s), targets)


@pytest.mark.parametrize(("mode", "law"), SERVO)
@pytest.mark.parametrize("make", [ramp, walk, noise])
@pytest.mark.parametrize("rate_hz", [10, 100, 1000])
def test_no_servo_session_goes_beyond_the_range_of_its_points_by_more_than_the_stated_share(
    rig: Rig,
    mode: ServoMode,
    law: tuple[float, float],
    make: Callable[[int, np.random.Generator], Array],
    rate_hz: int,
) -> None:
    random = np.random.default_rng([rate_hz, len(make.__name__)])
    targets = make(rate_hz, random)
    times_s = arrivals(targets, rate_hz, random.uniform(), random)
    too_far, extent = beyond(followed_points(rig, mode, law, rate_hz, targets, times_s), targets)
    assert too_far <= SHARE * extent + ROUNDING_RAD


def stopping_way_m(rig: Rig) -> float:
    """Of the TCP from its velocity limit: with the acceleration that the jerk lets it reach."""
    limits = rig.settings.streaming
    velocity, acceleration = limits.linear_velocity, limits.linear_acceleration
    return velocity**2 / (2.0 * acceleration) + velocity * acceleration / (2.0 * limits.linear_jerk)


@pytest.mark.parametrize("kind", Interpolation)
@pytest.mark.parametrize("make", [steps, ramp, walk, noise])
@pytest.mark.parametrize("rate_hz", [10, 100])
def test_no_stream_of_poses_goes_further_beyond_them_than_the_tcp_needs_to_stop(
    rig: Rig, kind: Interpolation, make: Callable[[int, np.random.Generator], Array], rate_hz: int
) -> None:
    """Half as far and fast as joints, along y."""
    random = np.random.default_rng([rate_hz, len(make.__name__)])
    targets = 0.5 * make(rate_hz, random)
    times_s = arrivals(targets, rate_hz, random.uniform(), random)
    begin = rig.robot.model.chain.poses(rig.home[None])[0]
    assert rig.stream(Stream.CARTESIAN, interpolation=kind, decimation=max(1, 1000 // rate_hz)) == ""
    sent, begun = 0, len(rig.commanded)
    for cycle in range(round((times_s[-1] + 2.0) * 1000)):
        arrived = np.searchsorted(times_s, cycle * 1e-3 + 1e-9, side="right")
        if arrived > sent:
            rig.aim(pose=begin + np.array([0.0, targets[arrived - 1], 0.0, 0.0, 0.0, 0.0, 0.0]))
            sent = arrived
        rig.step()
    way = rig.robot.model.chain.poses(np.array(rig.commanded[begun:]))[:, 1] - begin[1]
    assert beyond(way, targets)[0] <= stopping_way_m(rig)
    assert np.ptp(way[-50:]) < 1e-6, "it comes to rest"
