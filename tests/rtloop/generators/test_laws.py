"""The compiled generators compute what their laws say.

Oracles: the same laws in numpy, `tests/support/laws`, and Ruckig. Each test compares more than 100,000
coordinates of random commands. A law in numpy takes thousands of coordinates at once, a compiled generator
has 16.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from laws import chunks as chunk_law
from laws import interpolation as law
from laws import pose_interpolation as pose_law
from laws import smooth_interpolation as smooth_law
from laws.comparison import EXACT, close
from laws.pose_limiter import PoseLimiter as PoseLimiterLaw
from laws.target_estimate import Estimate as EstimateLaw
from laws.target_estimate import fit
from sample_counts import samples

from cobot.errors import InputError
from cobot.ipc.layout import Interpolation
from cobot.robot import quaternion
from cobot.types import Array, CartesianLimits
from rtloop.generators.brake import Brake
from rtloop.generators.chunks import ChunkInterpolator, spline
from rtloop.generators.interpolation import Hold, Linear
from rtloop.generators.online_trajectory import OnlineTrajectory
from rtloop.generators.pose_interpolation import MinJerkMove, PoseInterpolator
from rtloop.generators.pose_limiter import PoseLimiter
from rtloop.generators.quintic import Quintic
from rtloop.generators.target_estimate import FITS, Estimate

PERIOD_S = 1e-3
WIDTH = 16
"""Coordinates of a compiled generator."""
COUNT = samples(128)
"""Compiled generators beside one law."""
RUCKIG = 1e-9
"""How exactly Ruckig itself meets its targets."""


def limits(n: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Of velocity, acceleration and jerk, different for each of 16 coordinates."""
    rng = np.random.default_rng(seed)
    rows = [rng.uniform(low, 3.0 * low, WIDTH) for low in (1.0, 4.0, 60.0)]
    return tuple(np.tile(row, n // WIDTH) for row in rows)  # type: ignore[return-value]


class Many:
    """Compiled generators side by side, as if they were one of all coordinates."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self.all = [make() for _ in range(COUNT)]

    def call(self, name: str, *arguments: Any) -> None:
        """Arrays are dealt out along their last axis."""
        for k, each in enumerate(self.all):
            columns = slice(k * WIDTH, (k + 1) * WIDTH)
            getattr(each, name)(*(a[..., columns] if isinstance(a, np.ndarray) else a for a in arguments))

    def __getattr__(self, name: str) -> Array:
        return np.concatenate([getattr(each, name) for each in self.all], axis=-1)


class Stream:
    """Random commands: walks that pause, of changing periods, some with a stated velocity."""

    def __init__(self, seed: int, n: int, speed: float = 1.0) -> None:
        self.rng, self.speed = np.random.default_rng(seed), speed
        self.target = self.rng.uniform(-1.0, 1.0, n)
        self.state = np.array([self.target, self.rng.normal(size=n), self.rng.normal(size=n)])
        self.drift = self.rng.normal(size=n)

    def next(self) -> tuple[Array, Array | None, float]:
        rng, n = self.rng, len(self.target)
        duration_s = float(rng.choice([1e-3, 0.004, 0.0123, 1 / 30, 0.1]) * rng.uniform(0.9, 1.1))
        self.drift = np.where(rng.random(n) < 0.1, rng.normal(size=n), self.drift)
        moving = rng.random(n) < 0.9
        self.target = self.target + moving * (self.speed * self.drift * duration_s)
        velocity = rng.normal(size=n) if rng.random() < 0.2 else None
        return self.target.copy(), velocity, duration_s


def test_the_weights_of_each_fit_are_those_of_numpy() -> None:
    for count in range(1, len(FITS)):
        np.testing.assert_array_equal(FITS[count, :, :count], fit(count))
        assert not FITS[count, :, count:].any()


def test_estimates_of_random_streams() -> None:
    n, rounds = COUNT * WIDTH, 60
    bounds = limits(n)[:2]
    plain, stream = EstimateLaw(*bounds, 0.1), Stream(1, n)
    compiled = Many(lambda: Estimate(*limits(WIDTH)[:2], 0.1))
    for _ in range(rounds):
        target, velocity, duration_s = stream.next()
        if stream.rng.random() < 0.05:
            plain.forget()
            compiled.call("forget")
        if stream.rng.random() < 0.1:
            stream.target = stream.rng.uniform(-1.0, 1.0, n)
            plain.rebase(stream.target)
            compiled.call("rebase", stream.target)
            continue
        plain.update(target, velocity, duration_s)
        compiled.call("update", target, velocity, duration_s)
        scale = 1.0 + np.abs(target).max()
        close(compiled.target, plain.target, scale)
        close(compiled.velocity, plain.velocity, scale / duration_s)
        close(compiled.acceleration, plain.acceleration, scale / duration_s**2)
        ahead_s = float(stream.rng.uniform(0.0, 0.2))
        found, expected = np.zeros((3, n)), np.zeros((3, n))
        plain.extrapolate(ahead_s, expected)
        for k, each in enumerate(compiled.all):
            part = np.zeros((3, WIDTH))
            each.extrapolate(ahead_s, part)
            found[:, k * WIDTH : (k + 1) * WIDTH] = part
        close(found, expected, scale * (1.0 + 1.0 / duration_s) ** 2)


@pytest.mark.parametrize(
    ("compiled", "plain", "limited"),
    [(Hold, law.Hold, False), (Linear, law.Linear, False), (Quintic, smooth_law.Quintic, True)],
)
def test_references_of_random_streams(compiled: Any, plain: Any, limited: bool) -> None:
    n, rounds = COUNT * WIDTH, 50
    one = plain(n, PERIOD_S, *(limits(n) if limited else ()))
    many = Many(lambda: compiled(WIDTH, PERIOD_S, *(limits(WIDTH) if limited else ())))
    stream = Stream(2, n)
    one.begin(stream.state)
    many.call("begin", stream.state)
    for _ in range(rounds):
        target, velocity, duration_s = stream.next()
        one.aim(target, velocity, duration_s)
        many.call("aim", target, velocity, duration_s)
        late = 0.0 if limited else 3.0  # how a quintic settles, Ruckig decides: see the test with Ruckig
        for _ in range(min(int(duration_s / PERIOD_S + stream.rng.uniform(-1.0, late)) + 1, 12)):
            one.advance()
            many.call("advance")
        scale = 1.0 + np.abs(one.reference).max()
        close(many.reference, one.reference, scale * (1.0 + 1.0 / duration_s))


@pytest.mark.parametrize("kind", ["online", "quintic"])
def test_references_of_random_streams_that_ruckig_brings_to_rest(kind: str) -> None:
    compiled: Any = OnlineTrajectory if kind == "online" else Quintic
    plain: Any = smooth_law.OnlineTrajectory if kind == "online" else smooth_law.Quintic
    compared = 0
    for seed in range(samples(25)):
        bounds = limits(WIDTH, seed)
        one, other = plain(WIDTH, PERIOD_S, *bounds), compiled(WIDTH, PERIOD_S, *bounds)
        stream = Stream(seed, WIDTH, speed=0.3)
        for each in (one, other):
            each.begin(stream.state)
        for _ in range(20):
            target, velocity, duration_s = stream.next()
            # Each command begins where the law is: what is compared does not add up.
            other.rebase(one.reference, one._estimate.target)
            one.aim(target, velocity, duration_s)
            other.aim(target, velocity, duration_s)
            cycles = int(duration_s / PERIOD_S * stream.rng.choice([0.5, 1.0, 1.0, 3.0])) + 1
            for _ in range(min(cycles, 40)):
                one.advance()
                other.advance()
                compared += WIDTH
                scale = 1.0 + np.abs(one.reference).max()
                close(other.reference, one.reference, scale * np.array([[1.0], [10.0], [100.0]]), RUCKIG)
    assert compared > samples(100_000)


def test_brakes_from_random_states() -> None:
    bounds, rng = limits(WIDTH)[1:], np.random.default_rng(4)
    one, other = smooth_law.Brake(PERIOD_S, *bounds), Brake(PERIOD_S, *bounds)
    compared = 0
    while compared < samples(100_000):
        start = rng.normal(size=(3, WIDTH)) * [[1.0], [1.0], [4.0]] * (rng.random(WIDTH) < 0.9)
        expected, found = start.copy(), start.copy()
        one.begin(expected)
        other.begin(found)
        for _ in range(60):
            assert one.advance(expected) == other.advance(found)
            close(found, expected, np.array([[1.0], [10.0], [100.0]]), RUCKIG)
        compared += 60 * WIDTH


def test_splines_through_random_points() -> None:
    rng, compared = np.random.default_rng(5), 0
    while compared < samples(100_000):
        k = int(rng.integers(1, 132))
        times, points = np.cumsum(rng.uniform(5e-4, 0.1, k)), rng.normal(size=(k, WIDTH))
        shortest = np.diff(times).min(initial=1.0)
        for found, expected, order in zip(
            spline(times, points), chunk_law.spline(times, points), (1, 2), strict=True
        ):
            close(found, expected, 10.0 / shortest**order)
        compared += points.size


def test_references_of_random_chunks() -> None:
    compared = 0
    for seed in range(samples(40)):
        rng, bounds = np.random.default_rng(seed), limits(WIDTH, seed)
        one, other = (
            chunk_law.ChunkInterpolator(WIDTH, PERIOD_S, *bounds),
            ChunkInterpolator(WIDTH, PERIOD_S, *bounds),
        )
        one.reference[:] = rng.normal(size=(3, WIDTH)) * 0.1
        now_s = 0.0
        for _ in range(8):
            if one._braking:  # which is Ruckig's: what follows begins where the law is
                here = one.reference.copy()
                one.begin(here)
                other.begin(here)
            count = int(rng.integers(1, 65))
            times = now_s + rng.uniform(-0.1, 0.3) + np.cumsum(rng.uniform(4e-4, 0.05, count))
            points = one.reference[0] + np.cumsum(rng.normal(size=(count, WIDTH)) * 0.01, axis=0)
            assert other.take(times, points, now_s) == one.take(times, points, now_s)
            for _ in range(int(rng.integers(1, 60))):
                now_s += PERIOD_S
                one.advance(now_s)
                other.advance(now_s)
                compared += WIDTH
                scale = 1.0 + np.abs(one.reference).max()
                rates, tolerance = np.array([[1.0], [10.0], [100.0]]), RUCKIG
                if not one._braking:
                    rates, tolerance = np.diff(one._knots_s).min() ** -np.arange(3.0)[:, None], 10.0 * EXACT
                close(other.reference, one.reference, scale * rates, tolerance)
            assert (other.late, other.starved) == (one.late, one.starved)
    assert compared > samples(100_000)


def random_poses(rng: np.random.Generator, count: int) -> Array:
    turns = rng.normal(size=(4, count))
    return np.vstack([rng.uniform(-0.5, 0.5, (3, count)), turns / np.linalg.norm(turns, axis=0)])


@pytest.mark.parametrize(
    ("kind", "chart"),
    [
        (Interpolation.NONE, law.Hold),
        (Interpolation.LINEAR, law.Linear),
        (Interpolation.QUINTIC, smooth_law.Quintic),
    ],
)
def test_poses_between_random_poses(kind: Interpolation, chart: Any) -> None:
    count, rounds, cycles = samples(700), 12, 4
    rng, rates = np.random.default_rng(6), (1.0, 5.0, 100.0, 3.0, 15.0, 300.0)
    each_limit = [np.repeat([rates[k], rates[k + 3]], 3 * count) for k in range(3)]
    smooth = kind is Interpolation.QUINTIC
    one = pose_law.PoseInterpolator(chart(6 * count, PERIOD_S, *(each_limit if smooth else ())), count)
    all_ = [PoseInterpolator(kind, PERIOD_S, *rates) for _ in range(count)]
    start, twist, acceleration = random_poses(rng, count), rng.normal(size=(6, count)), np.zeros((6, count))
    one.begin(start, twist, acceleration)
    for k, each in enumerate(all_):
        each.begin(start[:, k], twist[:, k], acceleration[:, k])
    if smooth:  # at rest first: how the start is brought to rest, Ruckig decides
        one.begin(start, 0.0 * twist, acceleration)
        for k, each in enumerate(all_):
            each.begin(start[:, k])
    for _ in range(rounds):
        goal = random_poses(rng, count)
        stated = rng.normal(size=(6, count)) if rng.random() < 0.5 else None
        one.aim(goal, stated, 0.02)
        for k, each in enumerate(all_):
            each.aim(goal[:, k], None if stated is None else stated[:, k], 0.02)
        for _ in range(cycles):
            one.advance()
            for each in all_:
                each.advance()
        close(np.array([each.pose for each in all_]).T, one.pose, 10.0)
        close(np.array([each.twist for each in all_]).T, one.twist, 1e3 + np.abs(one.twist).max())
        found = np.array([each.acceleration for each in all_]).T
        close(found, one.acceleration, 1e5 + np.abs(one.acceleration).max())


def test_moves_between_random_poses() -> None:
    count, cycles = samples(2000), 60
    rng = np.random.default_rng(7)
    start, goal, durations = random_poses(rng, count), random_poses(rng, count), rng.uniform(0.08, 3.0, count)
    moves = [MinJerkMove(start[:, k], goal[:, k], durations[k], PERIOD_S) for k in range(count)]
    for cycle in range(1, cycles + 1):
        for move in moves:
            move.advance()
        if cycle % 10 == 0:
            found = [
                np.array([getattr(move, name) for move in moves]).T
                for name in ("pose", "twist", "acceleration")
            ]
            expected = pose_law.min_jerk(start, goal, cycle * PERIOD_S / durations, durations)
            for one, other, scale in zip(found, expected, (10.0, 1e3, 1e5), strict=True):
                close(one, other, scale)


def test_poses_within_the_limits_of_the_tcp() -> None:
    within = CartesianLimits(0.5, 2.0, 20.0, 1.0, 5.0, 40.0)
    compared = 0
    for seed in range(samples(110)):
        rng = np.random.default_rng(seed)
        one, other = PoseLimiterLaw(PERIOD_S, within), PoseLimiter(PERIOD_S, within)
        start, twist = random_poses(rng, 1)[:, 0], rng.normal(size=6) * rng.choice([0.0, 0.1])
        one.begin(start, twist)
        other.begin(start, twist)
        wanted = start.copy()
        drift = rng.normal(size=6) * rng.choice([0.0, 3e-4, 1e-3])
        for cycle in range(50):
            if cycle % 50 == 20:
                wanted = random_poses(rng, 1)[:, 0]
            wanted[:3] += drift[:3]
            wanted[3:] = quaternion.product(quaternion.exp(drift[3:].tolist()), wanted[3:].tolist())
            one.step(wanted)
            other.step(wanted)
            assert one.limited == other.limited
            close(other.pose, one.pose, 1.0)
            close(other.twist, one.twist, 1e3)
            # A rounding of a position is 1e-10 m/s² when it is divided by the square of the period.
            close(other.acceleration, one.acceleration, 1e6)
            # The fastest way to correct next to nothing takes the root of it: this must not add up.
            one.pose, one.twist, one.acceleration, one.speed = (
                other.pose.copy(),
                other.twist.copy(),
                other.acceleration.copy(),
                other.speed.copy(),
            )
            compared += 7 + 6 + 6
    assert compared > samples(100_000)


@pytest.mark.parametrize("make", [Hold, Linear])
def test_more_joints_than_there_is_room_for_are_refused(make: Any) -> None:
    with pytest.raises(InputError, match="17 joints, allowed: up to 16"):
        make(17, PERIOD_S)
    for kind in (Quintic, OnlineTrajectory, ChunkInterpolator):
        with pytest.raises(InputError, match="17 joints, allowed: up to 16"):
            kind(17, PERIOD_S, *np.ones((3, 17)))
