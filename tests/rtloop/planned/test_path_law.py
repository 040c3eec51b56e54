"""The compiled path and path clock against their laws in numpy and Ruckig: `laws.path`, `laws.path_clock`."""

from __future__ import annotations

import numpy as np
import pytest
from laws.path import Path as PlainPath
from laws.path_clock import PathClock as PlainPathClock
from sample_counts import samples

from cobot.errors import InputError
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory, from_hermite
from rtloop.planned.path import Path
from rtloop.planned.path_clock import PathClock

PERIOD_S = 1e-3
INPUTS = samples(100_000)
DOF = 7


def curve(random: np.random.Generator, segments: int, scale: float = 1.0) -> Trajectory:
    """Through random points, with random velocities and accelerations there."""
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.02, 0.4, segments))])
    points = random.uniform(-1.0, 1.0, (segments + 1, 3, DOF)) * scale * np.array([[0.2], [0.5], [1.0]])
    points[0, 1:] = points[-1, 1:] = 0.0
    return from_hermite(times, *points.transpose(1, 0, 2))


def loaded(trajectory: Trajectory) -> Path:
    path = Path(2 * trajectory.segments, trajectory.dof)
    path.breakpoints_s[: trajectory.segments + 1] = trajectory.breakpoints_s
    path.coefficients[: trajectory.segments] = trajectory.coefficients
    path.begin(trajectory.segments)
    return path


def test_a_path_is_evaluated_as_the_law_says() -> None:
    random = np.random.default_rng(21)
    trajectory = curve(random, 500)
    times = np.sort(random.uniform(0.0, trajectory.duration_s, INPUTS))
    times[::50] = random.choice(trajectory.breakpoints_s, len(times[::50]))
    times.sort()
    rates, slopes = random.uniform(0.0, 1.0, INPUTS), random.uniform(-5.0, 5.0, INPUTS)
    wanted = PlainPath(trajectory).evaluate(times, rates, slopes)
    found, path = np.zeros((INPUTS, 3, DOF)), loaded(trajectory)
    for k, row in enumerate(found):
        path.evaluate(times[k], rates[k], slopes[k], row)
    assert (np.abs(found - wanted) <= 1e-12 * np.abs(wanted).max(axis=(0, 2))[:, None]).all()


def test_a_path_is_sampled_as_the_law_says_beyond_its_end_too() -> None:
    random = np.random.default_rng(22)
    trajectory = curve(random, 500)
    times = random.uniform(0.0, 1.01 * trajectory.duration_s, INPUTS)
    times[::50] = random.choice(trajectory.breakpoints_s, len(times[::50]))
    found, wanted = loaded(trajectory).sample(times), PlainPath(trajectory).sample(times)
    for row, plain in zip(found, wanted, strict=True):
        assert (np.abs(row - plain) <= 1e-12 * np.abs(plain).max()).all()


def test_the_breakpoints_between_two_times_are_those_of_the_law() -> None:
    random = np.random.default_rng(23)
    trajectory = curve(random, 500)
    path, plain = loaded(trajectory), PlainPath(trajectory)
    for _ in range(samples(10_000)):
        begin, end = np.sort(random.uniform(0.0, trajectory.duration_s, 2))
        end = random.choice([end, begin, begin + 1.0, trajectory.duration_s])
        np.testing.assert_array_equal(path.breakpoints(begin, end), plain.breakpoints(begin, end))


def test_the_rate_changes_as_the_law_says(robot: RobotDescription) -> None:
    """Which profile is taken, and when, on paths from slow ones to some beyond the limits. Each profile is
    judged at a hundred places of seven joints."""
    random = np.random.default_rng(24)
    changed = 0
    for scale in (0.05, 0.1, 0.2, 0.3, 0.5, 3.0) * 2:
        trajectory = curve(random, 30, scale)
        path, plain_path = loaded(trajectory), PlainPath(trajectory)
        clock, plain = PathClock(robot.limits, PERIOD_S), PlainPathClock(robot.limits, PERIOD_S)
        for cycle in range(2000):
            if cycle % 300 == 20:
                rate = random.choice([0.0, 0.2, 0.7, 1.0])
                clock.request(rate)
                plain.request(rate)
            clock.advance(path)
            plain.advance(plain_path)
            changed += plain.slowing
            assert (clock.at_rest, clock.slowing, clock.stuck) == (plain.at_rest, plain.slowing, plain.stuck)
            found = clock.path_time_s, clock.rate, clock.rate_slope, clock.target_rate
            wanted = plain.path_time_s, plain.rate, plain.rate_slope, plain.target_rate
            assert np.abs(np.subtract(found, wanted)).max() <= 1e-9, cycle
    assert changed > 1000


def test_the_pieces_of_a_path_are_checked_as_they_are_loaded() -> None:
    random = np.random.default_rng(25)
    trajectory = curve(random, 40)
    path = loaded(trajectory)
    places = [
        np.polynomial.polynomial.polyval(u, trajectory.coefficients[k].T)
        for k, length in enumerate(np.diff(trajectory.breakpoints_s))
        for u in np.linspace(0.0, length, 9)
    ]
    low, high = np.min(places, axis=0) - 1e-12, np.max(places, axis=0) + 1e-12
    assert path.stays_within(0, 40, low, high)
    for joint in range(DOF):
        for bound, by in ((low, 1e-6), (high, -1e-6)):
            bound[joint] += by
            assert not path.stays_within(0, 40, low, high)
            bound[joint] -= by
    assert path.increases(0, 41)
    assert path.is_finite(0, 40)
    path.coefficients[17, 3, 5] = np.inf
    assert not path.is_finite(0, 40)
    assert path.is_finite(18, 40)
    for wrong in (np.nan, np.inf, path.breakpoints_s[19]):
        path.breakpoints_s[20] = wrong
        assert not path.increases(10, 41)
        assert not path.increases(20, 41)
    with pytest.raises(ValueError, match="has none from 40 to 81"):
        path.is_finite(40, 81)


def test_more_joints_than_there_is_room_for_are_refused() -> None:
    with pytest.raises(InputError, match="17 joints, allowed: up to 16"):
        Path(10, 17)
