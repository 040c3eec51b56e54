"""The TCP's limits: whatever is requested, velocity, acceleration and jerk keep them.

Oracles: numpy's norms and finite differences, scipy's rotations, closed forms. The comments name the suites
of libpyflexiv's test_rt_safety.cpp that the tests below them cover.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.robot import quaternion
from cobot.types import Array, CartesianLimits
from rtloop.generators.pose_limiter import PoseLimiter
from rtloop.sources.target_checks import angular_distance

PERIOD_S = 1e-3
LIMITS = CartesianLimits(0.5, 2.0, 20.0, 1.0, 5.0, 40.0)
HERE = np.array([0.4, -0.1, 0.6, 1.0, 0.0, 0.0, 0.0])


def pose(offset: tuple[float, float, float] = (0.0, 0.0, 0.0), angle: float = 0.0) -> Array:
    """Away from `HERE`, turned about z."""
    return np.array([*(HERE[:3] + offset), np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


class Followed:
    """What a limiter makes of requests, with the steps it took."""

    def __init__(self) -> None:
        self.limiter = PoseLimiter(PERIOD_S, LIMITS)
        self.limiter.begin(HERE)
        self.poses = [HERE.copy()] * 3

    def request(self, wanted: Array) -> None:
        self.limiter.step(wanted)
        self.poses.append(self.limiter.pose.copy())

    def rates(self) -> Array:
        """The norms of velocity, acceleration and jerk, as shares of the limits: linear, then angular."""
        poses = np.array(self.poses)
        turns = Rotation.from_quat(poses[:, 3:], scalar_first=True)
        linear = np.diff(poses[:, :3], axis=0) / PERIOD_S
        angular = (turns[1:] * turns[:-1].inv()).as_rotvec() / PERIOD_S
        most = np.array([[0.5, 2.0, 20.0], [1.0, 5.0, 40.0]])
        shares = [
            [np.linalg.norm(np.diff(v, k, axis=0), axis=1).max() / PERIOD_S**k / most[i, k] for k in range(3)]
            for i, v in enumerate((linear, angular))
        ]
        return np.array(shares)

    def check(self) -> None:
        shares = self.rates()
        assert shares[:, 0].max() <= 1.01
        assert shares[:, 1].max() <= 1.2
        assert shares[:, 2].max() <= 1.5  # an axis whose share shrinks is brought into it, not cut


# ClampCartesianPose


def test_a_pose_within_the_limits_is_not_touched() -> None:
    followed = Followed()
    near = pose((1e-9, 0.0, 0.0), 2e-9)
    followed.request(near)
    np.testing.assert_array_equal(followed.limiter.pose, near)
    assert not followed.limiter.limited


@pytest.mark.parametrize(
    "direction", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.6, 0.0, -0.8), (1 / 3, 2 / 3, 2 / 3)]
)
def test_a_position_too_far_is_approached_along_its_direction(direction: tuple[float, float, float]) -> None:
    followed = Followed()
    goal = pose(tuple(0.3 * np.array(direction)))
    for _ in range(2000):
        followed.request(goal)
    way = np.array(followed.poses)[:, :3] - HERE[:3]
    across = way - np.outer(way @ direction, direction)
    assert np.linalg.norm(across, axis=1).max() < 0.003
    np.testing.assert_array_equal(followed.limiter.pose, goal)
    assert 0.8 < followed.rates()[0, 0] <= 1.0
    followed.check()


def test_a_turn_too_far_is_made_on_the_shortest_way() -> None:
    followed = Followed()
    axis = np.array([0.48, 0.6, 0.64])
    goal = HERE.copy()
    goal[3:] = -Rotation.from_rotvec(2.5 * axis).as_quat(scalar_first=True)  # the other sign
    for _ in range(4000):
        followed.request(goal)
    turns = Rotation.from_quat(np.array(followed.poses)[:, 3:], scalar_first=True).as_rotvec()
    across = turns - np.outer(turns @ axis, axis)
    assert np.linalg.norm(across, axis=1).max() < 0.05
    assert turns[-1] @ axis == pytest.approx(2.5, abs=1e-9)
    followed.check()


# ClampCartesianVelocity


@pytest.mark.parametrize("kind", [0, 1])
def test_from_rest_velocity_grows_by_no_more_than_acceleration_and_jerk(kind: int) -> None:
    followed = Followed()
    goal = pose((0.6, 0.0, 0.8)) if kind == 0 else pose(angle=2.0)
    for _ in range(300):
        followed.request(goal)
    shares = followed.rates()[kind]
    assert (shares <= 1.001).all()
    assert shares[1] > 0.7
    assert shares[2] > 0.8


# The limiter as a whole


@pytest.mark.parametrize("seed", range(6))
def test_a_pose_that_stays_is_reached_and_never_overshot(seed: int) -> None:
    rng = np.random.default_rng(seed)
    offset, turn = rng.uniform(-0.3, 0.3, 3), rng.uniform(-1.5, 1.5, 3)
    followed = Followed()
    goal = np.array([*(HERE[:3] + offset), *Rotation.from_rotvec(turn).as_quat(scalar_first=True)])
    ways, angles = [np.linalg.norm(offset)], [np.linalg.norm(turn)]
    for _ in range(5500):
        followed.request(goal)
        ways.append(float(np.linalg.norm(goal[:3] - followed.limiter.pose[:3])))
        angles.append(angular_distance(followed.limiter.pose[3:], goal[3:]))
        if not followed.limiter.limited:
            break
    np.testing.assert_array_equal(followed.limiter.pose, goal)
    for _ in range(3):
        followed.request(goal)
    np.testing.assert_array_equal(followed.limiter.pose, goal)
    assert np.diff(ways).max() < 1e-4
    assert np.diff(angles).max() < 5e-4
    followed.check()


SPEEDS = [0.15, 0.3, 0.45]
BESIDE = np.arange(8) * np.pi / 4


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("angle", BESIDE)
@pytest.mark.parametrize("drift", [0.0, 0.1])
def test_a_pose_beside_the_way_is_reached_and_not_circled(speed: float, angle: float, drift: float) -> None:
    """The TCP comes by at a speed, 0.1 m beside a pose that stands still or drifts.

    The axes of the pursuit once turned with the way that was left. The TCP circled the pose in 15 of the 24
    cases in which it stands still, and in all but one where it drifts.

    Oracle: the time in which a TCP with these limits brakes and then goes all the way back, from rest to
    rest, and half as much again.
    """
    followed, passing = Followed(), speed * np.array([0.8, 0.48, 0.36])
    followed.limiter.begin(HERE, [*passing, 0.0, 0.0, 0.0])
    followed.poses = [HERE - PERIOD_S * back * np.array([*passing, 0, 0, 0, 0]) for back in (2, 1, 0)]
    acceleration, ramp_s = 2.0, 2.0 / 20.0
    stop_s = speed / acceleration + ramp_s
    way = 0.1 + drift + 0.5 * speed * stop_s
    cycles = round(1500 * (stop_s + 2.0 * np.sqrt(way / acceleration) + ramp_s))
    x, y = 0.1 * np.cos(angle), 0.1 * np.sin(angle)
    ways, goal = [], HERE
    for cycle in range(cycles):
        goal = pose((x + drift * cycle * PERIOD_S, y, 0.0))
        followed.request(goal)
        ways.append(np.linalg.norm(followed.limiter.pose[:3] - goal[:3]))
    np.testing.assert_array_equal(followed.limiter.pose, goal)
    np.testing.assert_allclose(followed.limiter.twist[:3], [drift, 0.0, 0.0], atol=1e-9)
    coming = np.diff(ways)[np.abs(np.diff(ways)) > 1e-7] < 0.0
    assert np.count_nonzero(np.diff(coming)) <= 3, "it comes back, and does not go round"
    followed.check()


def test_a_request_within_the_limits_passes_bit_for_bit() -> None:
    followed = Followed()
    for cycle in range(3000):
        phase = 1.5 * cycle * PERIOD_S
        smooth = phase - np.sin(phase)  # from rest, without a step of the acceleration
        wanted = pose((0.08 * smooth, 0.0, 0.0), 0.2 * smooth)
        followed.request(wanted)
        assert not followed.limiter.limited
        np.testing.assert_array_equal(followed.limiter.pose, wanted)


def test_a_moving_request_is_caught_up_with() -> None:
    followed = Followed()
    for cycle in range(3000):
        followed.request(pose((0.05 + 0.0003 * cycle, 0.0, 0.0), 0.2 + 0.0004 * cycle))
    followed.check()
    np.testing.assert_allclose(
        followed.limiter.pose[:3], [HERE[0] + 0.05 + 0.0003 * 2999, *HERE[1:3]], atol=1e-12
    )
    assert not followed.limiter.limited


@pytest.mark.parametrize("acceleration", [0.4, 1.0, 1.6, 1.9])
def test_a_pursuit_that_begins_while_the_request_accelerates_keeps_the_jerk(acceleration: float) -> None:
    """The request starts smoothly, accelerates until it is beyond the velocity limit, and stops at once.

    The limiter once took a step of the request for its velocity at the end of that step. That lost half a
    period of acceleration in the first cycle of the pursuit: a jerk of 10 to 47 times the limit.
    """
    followed = Followed()
    jerk, way, speed, rate = 10.0, 0.0, 0.0, 0.0
    for cycle in range(2500):
        if cycle < 1500 and speed < 0.6:
            rate = min(rate + jerk * PERIOD_S, acceleration)
            speed += rate * PERIOD_S
            way += speed * PERIOD_S
        followed.request(pose((way, 0.0, 0.0)))
    assert followed.rates()[0, 2] <= 1.1


@pytest.mark.parametrize("seed", range(12))
def test_no_sequence_of_requests_leaves_the_limits(seed: int) -> None:
    rng, followed = np.random.default_rng(seed), Followed()
    wanted, drift, spin = HERE.copy(), np.zeros(3), np.zeros(3)
    for cycle in range(400):
        if cycle % 50 == 0:
            drift, spin = (
                rng.normal(size=3) * rng.choice([0, 3e-4, 1e-2]),
                rng.normal(size=3) * rng.choice([0, 1e-3]),
            )
            if rng.random() < 0.5:
                wanted = np.array([*rng.normal(size=3), *rng.normal(size=4)])
                wanted[3:] /= np.linalg.norm(wanted[3:])
        wanted[:3] += drift
        wanted[3:] = quaternion.normalised(quaternion.product(quaternion.exp(spin), wanted[3:]))
        followed.request(wanted)
    followed.check()
