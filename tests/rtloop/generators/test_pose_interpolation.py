"""Poses between streamed poses, and the minimum-jerk move.

Oracles: scipy's Slerp and Rotation, numpy's finite differences, the closed form of the minimum-jerk
polynomial. The comments name the cases of libpyflexiv's test_trajectory.cpp and test_interpolation_sim.py.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from cobot.ipc.layout import Interpolation
from cobot.types import Array
from rtloop.generators.pose_interpolation import MinJerkMove, PoseInterpolator

PERIOD_S = 1e-3
LIMITS = (1.0, 5.0, 100.0, 3.0, 15.0, 300.0)
START = np.array([0.4, 0.1, 0.5, 1.0, 0.0, 0.0, 0.0])
SMOOTH = [Interpolation.QUINTIC, Interpolation.RUCKIG]


def pose(position: Array, rotation: Rotation, sign: float = 1.0) -> Array:
    return np.array([*position, *sign * rotation.as_quat(scalar_first=True)])


def rotations(poses: Array) -> Rotation:
    return Rotation.from_quat(poses[:, 3:], scalar_first=True)


def differences(poses: Array) -> Array:
    """Mean twists between poses, shape (k - 1, 6), in the base frame."""
    turns = rotations(poses)
    linear, angular = np.diff(poses[:, :3], axis=0), (turns[1:] * turns[:-1].inv()).as_rotvec()
    return np.hstack([linear, angular]) / PERIOD_S


class Outputs:
    """All that came out of an interpolator or a move, from the start on."""

    def __init__(self, source: PoseInterpolator | MinJerkMove) -> None:
        self._source = source
        self._outputs = [(source.pose.copy(), source.twist.copy(), source.acceleration.copy())]

    def advance(self, cycles: int) -> None:
        for _ in range(cycles):
            self._source.advance()
            source = self._source
            self._outputs.append((source.pose.copy(), source.twist.copy(), source.acceleration.copy()))

    @property
    def poses(self) -> Array:
        return np.array([pose for pose, _, _ in self._outputs])

    @property
    def twists(self) -> Array:
        return np.array([twist for _, twist, _ in self._outputs])

    @property
    def accelerations(self) -> Array:
        return np.array([acceleration for _, _, acceleration in self._outputs])

    def check(self, jerk: float, angular_tolerance: float) -> None:
        """Twist and acceleration are derivatives, no quaternion changes its sign or norm, nothing jumps."""
        poses, twists, accelerations = self.poses, self.twists, self.accelerations
        np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1.0, atol=1e-12)
        assert (np.sum(poses[1:, 3:] * poses[:-1, 3:], axis=1) > 0.9).all()
        mean = 0.5 * (twists[1:] + twists[:-1])
        np.testing.assert_allclose(differences(poses), mean, atol=jerk * PERIOD_S**2)
        change, mean = np.diff(twists, axis=0) / PERIOD_S, 0.5 * (accelerations[1:] + accelerations[:-1])
        np.testing.assert_allclose(change[:, :3], mean[:, :3], atol=jerk * PERIOD_S)
        np.testing.assert_allclose(change[:, 3:], mean[:, 3:], atol=jerk * PERIOD_S + angular_tolerance)
        assert np.abs(np.diff(accelerations, axis=0)).max() <= jerk * PERIOD_S + angular_tolerance


def streamed(
    kind: Interpolation, path: Callable[[float], Array], duration_s: float, commands: int
) -> Outputs:
    """A punctual stream of a path, begun at its start at rest."""
    interpolator = PoseInterpolator(kind, PERIOD_S, *LIMITS)
    interpolator.begin(path(0.0))
    outputs = Outputs(interpolator)
    for k in range(1, commands + 1):
        interpolator.aim(path(k * duration_s), None, duration_s)
        outputs.advance(round(duration_s / PERIOD_S))
    return outputs


def steady(t: float) -> Array:
    """Straight on and about one axis at constant speeds; the quaternion's sign is of no account."""
    turn = Rotation.from_rotvec(0.8 * t * np.array([0.6, 0.0, 0.8]))
    return pose(
        START[:3] + 0.2 * t * np.array([1.0, -2.0, 2.0]) / 3.0, turn, -1.0 if int(10 * t) % 2 else 1.0
    )


def swinging(t: float) -> Array:
    """A pose that swings smoothly in all six directions, without one axis of rotation."""
    swing = (1.0 - np.cos(1.5 * t)) ** 2
    turn = Rotation.from_rotvec([0.2 * swing, 0.3 * np.sin(1.1 * t) * swing, -0.1 * swing])
    return pose(START[:3] + np.array([0.05, -0.03, 0.02]) * swing, turn)


# LinearTrajectory: constant velocity, SLERP constant angular velocity, VLA streaming simulation
# test_interpolation_sim: Cartesian linear constant velocity, multiple policy frequencies


@pytest.mark.parametrize("rate_hz", [10, 20, 30, 50, 100, 200, 500])
def test_a_linear_stream_has_constant_speeds_at_every_rate_of_commands(rate_hz: int) -> None:
    outputs = streamed(Interpolation.LINEAR, steady, round(1000 / rate_hz) * PERIOD_S, 12)
    wanted = np.array([*(0.2 * np.array([1.0, -2.0, 2.0]) / 3.0), *(0.8 * np.array([0.6, 0.0, 0.8]))])
    twists = outputs.twists[1:]
    np.testing.assert_allclose(twists, np.broadcast_to(wanted, twists.shape), atol=1e-10)
    found = differences(outputs.poses)
    np.testing.assert_allclose(found[:, :3], np.broadcast_to(wanted[:3], found[:, :3].shape), atol=1e-10)
    np.testing.assert_allclose(found[:, 3:], np.broadcast_to(wanted[3:], found[:, 3:].shape), atol=1e-9)
    np.testing.assert_allclose(outputs.accelerations, 0.0, atol=1e-15)


def test_a_linear_segment_is_the_straight_line_and_the_slerp_of_scipy() -> None:
    # LinearTrajectory: linear position, halfway angle, combined translation and rotation, monotonic progress
    rng = np.random.default_rng(2)
    for _ in range(10):
        first, second = Rotation.random(2, rng=rng)
        goal, sign = rng.uniform(-1.0, 1.0, 3), rng.choice([-1.0, 1.0])
        interpolator = PoseInterpolator(Interpolation.LINEAR, PERIOD_S, *LIMITS)
        interpolator.begin(pose(START[:3], first, sign))
        interpolator.aim(pose(goal, second), None, 0.05)
        outputs = Outputs(interpolator)
        outputs.advance(50)
        shares = np.linspace(0.0, 1.0, 51)
        wanted = Slerp([0.0, 1.0], Rotation.concatenate([first, second]))(shares)
        assert (rotations(outputs.poses).inv() * wanted).magnitude().max() < 1e-10
        line = START[:3] + shares[:, None] * (goal - START[:3])
        np.testing.assert_allclose(outputs.poses[:, :3], line, atol=1e-12)
        whole = (second * first.inv()).magnitude()
        assert (rotations(outputs.poses)[25] * first.inv()).magnitude() == pytest.approx(whole / 2, abs=1e-10)
        assert (np.diff((rotations(outputs.poses) * first.inv()).magnitude()) > 0.0).all()


def test_a_pure_rotation_leaves_the_position_alone() -> None:
    # test_interpolation_sim: rotation SLERP
    turning = [pose(START[:3], Rotation.from_euler("z", 0.02 * k)) for k in range(31)]
    outputs = streamed(Interpolation.LINEAR, lambda t: turning[round(t / 0.033)], 0.033, 30)
    np.testing.assert_array_equal(outputs.poses[:, :3], np.broadcast_to(START[:3], (991, 3)))
    rates = np.linalg.norm(outputs.twists[1:, 3:], axis=1)
    np.testing.assert_allclose(rates, 0.02 / 0.033, atol=1e-10)


@pytest.mark.parametrize("kind", list(Interpolation))
def test_the_last_pose_of_a_random_stream_is_met(kind: Interpolation) -> None:
    # test_interpolation_sim: end position accuracy, after 50 random waypoints
    rng = np.random.default_rng(4)
    interpolator = PoseInterpolator(kind, PERIOD_S, *LIMITS)
    interpolator.begin(START)
    for _ in range(50):
        goal = pose(rng.uniform(-0.5, 0.5, 3), Rotation.random(rng=rng))
        interpolator.aim(goal, None, 0.033)
        for _ in range(33):
            interpolator.advance()
    if kind in SMOOTH:  # the goals are beyond their limits: they take their time
        for _ in range(4000):
            interpolator.advance()
    np.testing.assert_allclose(interpolator.pose[:3], goal[:3], atol=1e-10)
    off = rotations(np.array([interpolator.pose]))[0] * rotations(np.array([goal]))[0].inv()
    assert off.magnitude() < 1e-10


@pytest.mark.parametrize("kind", list(Interpolation))
def test_a_pose_that_stays_is_held(kind: Interpolation) -> None:
    # LinearTrajectory: zero motion, inactive before init
    outputs = streamed(kind, lambda _: START, 0.033, 3)
    np.testing.assert_array_equal(outputs.poses, np.broadcast_to(START, outputs.poses.shape))
    np.testing.assert_array_equal(outputs.twists, 0.0)


@pytest.mark.parametrize("kind", list(Interpolation))
def test_beginning_anew_forgets_the_command(kind: Interpolation) -> None:
    # LinearTrajectory: cancel
    outputs = streamed(kind, steady, 0.05, 4)
    here = outputs.poses[-1]
    interpolator = outputs._source
    assert isinstance(interpolator, PoseInterpolator)
    interpolator.begin(here)
    outputs.advance(100)
    np.testing.assert_allclose(outputs.poses[-100:], np.broadcast_to(here, (100, 7)), atol=1e-15)


@pytest.mark.parametrize("kind", list(Interpolation))
def test_no_period_is_too_short(kind: Interpolation) -> None:
    # LinearTrajectory: min duration
    interpolator = PoseInterpolator(kind, PERIOD_S, *LIMITS)
    interpolator.begin(START)
    interpolator.aim(START + 1e-9 * np.array([1.0, 0, 0, 0, 0, 0, 0]), None, 0.0)
    outputs = Outputs(interpolator)
    outputs.advance(100)
    assert np.isfinite(outputs.poses).all()
    assert outputs.poses[-1, 0] == pytest.approx(START[0] + 1e-9, abs=1e-15)


@pytest.mark.parametrize("kind", SMOOTH)
@pytest.mark.parametrize("rate_hz", [10, 50, 100])
def test_a_smooth_stream_is_followed_across_the_changes_of_chart(kind: Interpolation, rate_hz: int) -> None:
    outputs = streamed(kind, swinging, 1 / rate_hz, 2 * rate_hz)
    outputs.check(jerk=310.0, angular_tolerance=2e-3)
    wanted = np.array([swinging(k * PERIOD_S) for k in range(2001)])
    off = 0.01 if rate_hz == 10 else 0.004
    assert np.abs(outputs.poses[:, :3] - wanted[:, :3]).max() < off
    assert (rotations(outputs.poses) * rotations(wanted).inv()).magnitude().max() < 2 * off


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_stream_at_constant_speeds_does_not_stop_at_commands(kind: Interpolation) -> None:
    outputs = streamed(kind, steady, 0.04, 60)
    late = outputs.twists[1600:]
    assert np.linalg.norm(late[:, :3] - 0.2 * np.array([1.0, -2.0, 2.0]) / 3.0, axis=1).max() < 1e-8
    assert np.linalg.norm(late[:, 3:] - 0.8 * np.array([0.6, 0.0, 0.8]), axis=1).max() < 1e-8


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_stated_twist_is_that_at_the_pose(kind: Interpolation) -> None:
    interpolator = PoseInterpolator(kind, PERIOD_S, *LIMITS)
    interpolator.begin(START)
    twist = np.array([0.05, 0.0, -0.02, 0.1, 0.05, -0.1])
    turn = Rotation.from_rotvec(0.15 * twist[3:] + [0.02, -0.03, 0.01])
    interpolator.aim(pose(START[:3] + 0.15 * twist[:3], turn), twist, 0.3)
    for _ in range(300):
        interpolator.advance()
    np.testing.assert_allclose(interpolator.twist, twist, atol=1e-6)


# MinJerkMove


def test_a_minimum_jerk_move_is_its_polynomial_along_line_and_slerp() -> None:
    rng = np.random.default_rng(6)
    for _ in range(5):
        first, second = Rotation.random(2, rng=rng)
        goal = pose(rng.uniform(-1.0, 1.0, 3), second, rng.choice([-1.0, 1.0]))
        move = MinJerkMove(pose(START[:3], first), goal, 2.0, PERIOD_S)
        outputs = Outputs(move)
        outputs.advance(1999)
        assert not move.done
        outputs.advance(1)
        assert move.done
        t = np.linspace(0.0, 1.0, 2001)
        share = 10 * t**3 - 15 * t**4 + 6 * t**5
        slerp = Slerp([0.0, 1.0], Rotation.concatenate([first, second]))
        assert (rotations(outputs.poses) * slerp(share).inv()).magnitude().max() < 1e-10
        np.testing.assert_allclose(
            outputs.poses[:, :3], START[:3] + share[:, None] * (goal[:3] - START[:3]), atol=1e-12
        )
        rate = (30 * t**2 - 60 * t**3 + 30 * t**4) / 2.0
        speed = np.linalg.norm(outputs.twists[:, 3:], axis=1)
        np.testing.assert_allclose(speed, rate * (second * first.inv()).magnitude(), atol=1e-10)
        np.testing.assert_allclose(outputs.twists[:, :3], rate[:, None] * (goal[:3] - START[:3]), atol=1e-10)
        outputs.check(jerk=60.0, angular_tolerance=0.0)


def test_linear_and_minimum_jerk_end_at_the_same_pose_and_only_one_has_constant_velocity() -> None:
    # TrajectoryComparison: constant against varying velocity; same end pose
    # test_interpolation_sim: joint min-jerk: velocity varies
    goal = steady(0.5)
    move = MinJerkMove(START, goal, 0.5, PERIOD_S)
    linear = PoseInterpolator(Interpolation.LINEAR, PERIOD_S, *LIMITS)
    linear.begin(START)
    linear.aim(goal, None, 0.5)
    both = Outputs(linear), Outputs(move)
    for outputs in both:
        outputs.advance(500)
    np.testing.assert_allclose(both[0].poses[-1], both[1].poses[-1], atol=1e-12)
    speeds = [np.linalg.norm(outputs.twists[1:500, :3], axis=1) for outputs in both]
    assert np.ptp(speeds[0]) < 1e-10
    assert np.ptp(speeds[1]) > 0.01
    assert speeds[1].max() / speeds[0].max() == pytest.approx(15.0 / 8.0, rel=1e-4)


def test_minimum_jerk_from_command_to_command_would_stop_at_each() -> None:
    # MinJerkTrajectory: stop and go; test_interpolation_sim: Cartesian min-jerk
    first_steps = []
    for k in range(5):
        outputs = Outputs(MinJerkMove(steady(0.033 * k), steady(0.033 * (k + 1)), 0.033, PERIOD_S))
        outputs.advance(33)
        first_steps.append(np.linalg.norm(outputs.twists[1]))
        np.testing.assert_array_equal(outputs.twists[-1], 0.0)
    assert max(first_steps) < 0.05 * 0.85


@pytest.mark.parametrize("duration_s", [0.0, -3.0, 1e-12, np.nan])
def test_a_move_takes_at_least_a_millisecond(duration_s: float) -> None:
    move = MinJerkMove(START, steady(0.1), duration_s, 0.25e-3)
    outputs = Outputs(move)
    outputs.advance(3)
    assert not move.done
    outputs.advance(2)
    assert move.done
    np.testing.assert_allclose(move.pose[:3], steady(0.1)[:3])


def test_a_finished_move_stays_at_the_goal_bit_for_bit() -> None:
    goal = steady(0.33)
    outputs = Outputs(MinJerkMove(START, goal, 0.1, PERIOD_S))
    outputs.advance(150)
    np.testing.assert_array_equal(outputs.poses[-50:, :3], np.broadcast_to(goal[:3], (50, 3)))
    np.testing.assert_array_equal(outputs.twists[-50:], 0.0)
    np.testing.assert_array_equal(outputs.accelerations[-50:], 0.0)
