"""Action chunks: waypoints with times, replaced again and again.

Oracles: scipy's CubicSpline, closed forms of the paths that the chunks sample, numpy's finite differences.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits
from rtloop.generators.chunks import ChunkInterpolator, spline
from rtloop.results import ACCEPTED, Accepted, Rejected

PERIOD_S = 1e-3
STEP_S = 0.033
"""Between waypoints: a policy at 30 Hz."""


class Player:
    """A chunk interpolator on the robot's clock, and all that came out of it."""

    def __init__(self, limits: JointLimits, start: Array | None = None) -> None:
        self.limits = limits
        bounds = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        self.chunks = ChunkInterpolator(limits.dof, PERIOD_S, *bounds)
        self.chunks.begin(np.zeros((3, limits.dof)) if start is None else start)
        self.cycle = 0
        self.references = [self.chunks.reference.copy()]

    @property
    def now_s(self) -> float:
        return self.cycle * PERIOD_S

    def take(self, path: Callable[[float], Array], first_s: float, count: int) -> Accepted | Rejected:
        times = first_s + STEP_S * np.arange(count)
        return self.chunks.take(times, np.array([path(t) for t in times]), self.now_s)

    def advance(self, until_s: float) -> Array:
        """The references of the cycles up to a time."""
        begin = len(self.references)
        for _ in range(round(until_s / PERIOD_S) - self.cycle):
            self.cycle += 1
            self.chunks.advance(self.now_s)
            self.references.append(self.chunks.reference.copy())
        return np.array(self.references[begin:])

    def check(self) -> None:
        """Nothing jumps: the jerk keeps its limit, and each row is the next one's integral."""
        position, velocity, acceleration = np.moveaxis(np.array(self.references), 1, 0)
        jerk = self.limits.max_jerk * (1.0 + 1e-6)
        assert (np.abs(np.diff(acceleration, axis=0)) <= jerk * PERIOD_S).all()
        for upper, lower, bound in (
            (position, velocity, jerk * PERIOD_S**3 / 6.0),
            (velocity, acceleration, jerk * PERIOD_S**2 / 2.0),
        ):
            mean = 0.5 * PERIOD_S * (lower[1:] + lower[:-1])
            assert (np.abs(np.diff(upper, axis=0) - mean) <= bound + 1e-12).all()

    def off(self, path: Callable[[float], Array], since_s: float) -> float:
        """How far the reference has been from a path at the most, since then."""
        first = round(since_s / PERIOD_S)
        wanted = np.array([path(cycle * PERIOD_S) for cycle in range(first, self.cycle + 1)])
        return float(np.abs(np.array(self.references)[first:, 0] - wanted).max())


@pytest.fixture(scope="module")
def limits(robot: RobotDescription) -> JointLimits:
    return robot.limits


@pytest.fixture
def player(limits: JointLimits) -> Player:
    return Player(limits)


def ramp(limits: JointLimits) -> Callable[[float], Array]:
    velocity = 0.3 * limits.max_velocity * np.resize([1.0, -1.0], limits.dof)
    return lambda t: velocity * t


def wave(limits: JointLimits) -> Callable[[float], Array]:
    """Begins at rest."""
    return lambda t: 0.25 * limits.max_velocity * (1.0 - np.cos(2.0 * t)) ** 2 / 2.6


# The path through the waypoints


def test_the_spline_is_that_of_scipy(limits: JointLimits) -> None:
    rng = np.random.default_rng(8)
    for count in (3, 4, 16, 64):
        times, points = np.cumsum(rng.uniform(0.02, 0.05, count)), rng.normal(size=(count, limits.dof))
        velocity, acceleration = spline(times, points)
        # A first piece without third derivative ends with the same acceleration as it begins.
        ends = [(1, velocity[0]), (1, velocity[-1])]
        wanted = CubicSpline(times, points, bc_type=ends)
        np.testing.assert_allclose(velocity, wanted(times, 1), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(acceleration, wanted(times, 2), rtol=1e-7, atol=1e-6)
        np.testing.assert_allclose(wanted.c[0][[0, -1]], 0.0, atol=1e-6)


def test_the_spline_of_two_points_is_a_line_and_that_of_one_a_place_to_rest() -> None:
    velocity, acceleration = spline(np.array([1.0, 3.0]), np.array([[1.0], [2.0]]))
    np.testing.assert_allclose(velocity, 0.5)
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-15)
    np.testing.assert_array_equal(spline(np.array([1.0]), np.array([[1.0]])), 0.0)


def test_a_feasible_chunk_is_run_through_at_its_times(player: Player, limits: JointLimits) -> None:
    path = wave(limits)
    assert player.take(path, STEP_S, 60) == ACCEPTED
    player.advance(1.9)
    player.check()
    waypoints = [round(k * STEP_S / PERIOD_S) for k in range(10, 57)]
    found = np.array(player.references)[waypoints, 0]
    wanted = np.array([path(cycle * PERIOD_S) for cycle in waypoints])
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert player.off(path, 0.0) < 1e-4


def test_a_path_too_steep_to_join_at_once_is_joined_within_the_limits(
    player: Player, limits: JointLimits
) -> None:
    path = ramp(limits)
    player.take(path, STEP_S, 30)
    player.advance(0.95)
    player.check()
    _, velocity, acceleration = np.moveaxis(np.array(player.references), 1, 0)
    assert (np.abs(velocity) <= limits.max_velocity).all()
    assert (np.abs(acceleration) <= limits.max_acceleration).all()
    assert player.off(path, 0.6) < 1e-9


# Chunk after chunk


@pytest.mark.parametrize("count", [4, 8, 16, 50])
@pytest.mark.parametrize("advance", [1, 3, 4])
def test_overlapping_chunks_of_one_path_are_followed_as_if_they_were_one(
    count: int, advance: int, limits: JointLimits
) -> None:
    path, player = wave(limits), Player(limits)
    for k in range(0, 60, advance):
        assert player.take(path, (k + 1) * STEP_S, count) == ACCEPTED
        player.advance((k + advance) * STEP_S)
    player.check()
    assert player.off(path, 0.0) < 1e-3
    assert (player.chunks.late, player.chunks.starved) == (0, 0)


@pytest.mark.parametrize("early_s", [0.0, 0.001, 0.05])
def test_there_is_no_stop_where_one_chunk_ends_and_the_next_begins(
    early_s: float, limits: JointLimits
) -> None:
    path, player = ramp(limits), Player(limits, np.array([ramp(limits)(t) for t in (0.0, 1.0, 0.0)]))
    for k in range(0, 60, 10):
        player.advance(max(0.0, k * STEP_S - early_s))
        assert player.take(path, (k + 1) * STEP_S, 10) == ACCEPTED  # the last one came just in time at 0 s
    player.advance(60 * STEP_S)
    np.testing.assert_allclose(
        np.array(player.references)[:, 1], np.broadcast_to(path(1.0), (1981, limits.dof)), atol=1e-9
    )
    assert player.chunks.starved == 0


def test_what_lies_before_a_chunk_that_begins_later_remains(player: Player, limits: JointLimits) -> None:
    path = wave(limits)
    player.take(path, STEP_S, 40)
    player.advance(0.3)
    assert player.take(lambda t: path(t) + 0.1 * max(t - 29 * STEP_S, 0.0) ** 2, 30 * STEP_S, 20) == ACCEPTED
    player.advance(29 * STEP_S - 0.1)
    assert player.off(path, 0.0) < 1e-3
    player.advance(45 * STEP_S)
    player.check()
    at = np.array(player.references)[45 * 33, 0]
    np.testing.assert_allclose(at, path(45 * STEP_S) + 0.1 * (16 * STEP_S) ** 2, atol=1e-9)


def test_a_new_plan_that_disagrees_is_blended_into(player: Player, limits: JointLimits) -> None:
    path = wave(limits)
    player.take(path, STEP_S, 50)
    player.advance(0.5)
    player.take(lambda t: path(t) + 0.02, 0.5 + 0.4 * STEP_S, 50)
    player.advance(1.5)
    player.check()
    assert player.off(lambda t: path(t) + 0.02, 1.2) < 1e-4


# Late, missing, refused


def test_late_waypoints_are_dropped_and_counted(player: Player, limits: JointLimits) -> None:
    path = wave(limits)
    player.take(path, STEP_S, 20)
    player.advance(0.4)
    assert player.take(path, 0.4 - 4.5 * STEP_S, 20) == ACCEPTED
    assert player.chunks.late == 5
    player.advance(0.8)
    player.check()
    assert player.off(path, 0.0) < 1e-3


def test_a_chunk_that_is_all_past_is_refused_and_changes_nothing(player: Player, limits: JointLimits) -> None:
    path = wave(limits)
    twin = Player(limits)
    for each in (player, twin):
        each.take(path, STEP_S, 40)
        each.advance(0.7)
    assert player.take(lambda t: path(t) + 1.0, 0.1, 10) == Rejected(
        "all 10 waypoints are in the past, the last one by 0.303 s"
    )
    assert player.chunks.late == 10
    np.testing.assert_array_equal(player.advance(1.2), twin.advance(1.2))


def test_when_the_waypoints_run_out_it_brakes_within_the_limits_and_stays(
    player: Player, limits: JointLimits
) -> None:
    path = wave(limits)
    player.take(path, STEP_S, 25)
    player.advance(25 * STEP_S)
    last = len(player.references) - 1
    player.advance(3.0)
    player.check()
    references = np.array(player.references)
    assert player.chunks.starved == 1
    np.testing.assert_array_equal(references[-1, 1:], 0.0)
    assert (np.diff(references[last:, 0], axis=0) >= -1e-12).all(), "it does not turn back"
    assert (np.abs(references[-1, 0] - path(25 * STEP_S)) < limits.max_velocity * 0.3).all()


def test_a_chunk_that_comes_while_it_brakes_is_joined_smoothly(player: Player, limits: JointLimits) -> None:
    path = wave(limits)
    player.take(path, STEP_S, 25)
    player.advance(25 * STEP_S + 0.04)
    assert player.take(path, 26 * STEP_S, 40) == ACCEPTED
    player.advance(50 * STEP_S)
    player.check()
    assert player.off(path, 1.5) < 1e-6
    assert (player.chunks.late, player.chunks.starved) == (1, 1)


def test_without_a_chunk_nothing_moves(player: Player) -> None:
    np.testing.assert_array_equal(player.advance(0.1), 0.0)
    assert player.chunks.starved == 0


def test_a_moving_start_is_braked(limits: JointLimits) -> None:
    player = Player(limits, np.array([np.zeros(7), 0.5 * limits.max_velocity, np.zeros(7)]))
    np.testing.assert_array_equal(player.advance(1.5)[-1, 1:], 0.0)
    player.check()


@pytest.mark.parametrize(
    ("times", "shape", "reason"),
    [
        ([0.1, 0.1], (2, 7), "times must increase by at least half a cycle"),
        ([0.2, 0.1], (2, 7), "times must increase by at least half a cycle"),
        ([0.1, np.nan], (2, 7), "times and positions must be finite"),
        ([0.1, 0.2], (2, 6), "times and positions must be shape (k,) and (k, 7), k from 1 to 64"),
        ([0.1, 0.2], (3, 7), "times and positions must be shape (k,) and (k, 7), k from 1 to 64"),
        ([], (0, 7), "times and positions must be shape (k,) and (k, 7), k from 1 to 64"),
        (
            list(np.arange(1, 66) / 10),
            (65, 7),
            "times and positions must be shape (k,) and (k, 7), k from 1 to 64",
        ),
    ],
)
def test_a_chunk_that_makes_no_sense_is_refused(
    player: Player, times: list[float], shape: tuple[int, int], reason: str
) -> None:
    assert player.chunks.take(np.array(times), np.zeros(shape), 0.0) == Rejected(reason)
    result = player.chunks.take(np.array([0.1]), np.full((1, 7), np.inf), 0.0)
    assert result == Rejected("times and positions must be finite")
    np.testing.assert_array_equal(player.advance(0.1), 0.0)


def test_no_more_waypoints_are_kept_than_there_is_time_for(player: Player) -> None:
    times = np.arange(1, 65) * 0.05
    assert player.chunks.take(times, np.zeros((64, 7)), 0.0) == ACCEPTED
    assert player.chunks.take(times + 3.2, np.zeros((64, 7)), 0.0) == ACCEPTED
    assert player.chunks.take(times + 6.4, np.zeros((64, 7)), 0.0) == Rejected(
        "128 waypoints are still ahead, up to 64 are kept"
    )


@hypothesis_settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_no_sequence_of_chunks_makes_the_reference_jump(limits: JointLimits, seed: int) -> None:
    rng, player = np.random.default_rng(seed), Player(limits)
    for _ in range(12):
        count = int(rng.integers(1, 30))
        times = player.now_s + rng.uniform(-0.3, 0.3) + np.cumsum(rng.uniform(0.02, 0.08, count))
        drift = np.cumsum(rng.normal(size=(count, limits.dof)) * 0.005, axis=0)
        player.chunks.take(times, player.chunks.reference[0] + drift, player.now_s)
        player.advance(player.now_s + rng.uniform(0.0, 0.5))
    references = np.array(player.references)
    assert np.isfinite(references).all()
    # Whatever the waypoints ask for, positions follow the velocity: Taylor's theorem.
    mean = 0.5 * PERIOD_S * (references[1:, 1] + references[:-1, 1])
    largest = np.abs(np.diff(references[:, 2], axis=0)).max() / PERIOD_S
    assert np.abs(np.diff(references[:, 0], axis=0) - mean).max() <= largest * PERIOD_S**3 / 6.0 + 1e-12
