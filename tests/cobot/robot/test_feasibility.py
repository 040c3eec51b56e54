"""Trajectories against joint limits. Oracle: dense samples of scipy's polynomials, and hand-made motions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

from cobot.errors import LimitError
from cobot.robot.feasibility import check_limits, stretch_to_limits
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits

SEED = 20261121
NAMES = ("shoulder", "elbow")
LIMITS = JointLimits(
    NAMES, *map(np.array, ([-2.0, -1.0], [2.0, 1.0], [1.0, 1.5], [4.0, 5.0], [40.0, 50.0], [9.0, 9.0]))
)
QUANTITIES = ("position", "velocity", "acceleration", "jerk")


def rest_to_rest(first: Array | list[float], last: Array | list[float], duration_s: float) -> Trajectory:
    ends = np.array([first, last], dtype=float)
    still = np.zeros_like(ends)
    return from_hermite(np.array([0.0, duration_s]), ends, still, still)


def dense(trajectory: Trajectory, derivative: int) -> Array:
    """Values (many, dof) by scipy, which counts powers the other way round."""
    polynomials = PPoly(
        trajectory.coefficients.transpose(2, 0, 1)[::-1], trajectory.breakpoints_s, extrapolate=False
    )
    return np.asarray(polynomials.derivative(derivative)(np.linspace(0.0, trajectory.duration_s, 20001)[:-1]))


def wild(random: np.random.Generator) -> Trajectory:
    points = int(random.integers(2, 6))
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.3, 2.0, points - 1))])
    values = [random.normal(0.0, scale, (points, 2)) for scale in (0.4, 0.4, 1.0)]
    return from_hermite(times, *values)


def bounds(derivative: int) -> tuple[Array, Array]:
    high = (LIMITS.max_position, LIMITS.max_velocity, LIMITS.max_acceleration, LIMITS.max_jerk)[derivative]
    return (LIMITS.min_position if derivative == 0 else -high), high


def test_the_verdict_is_that_of_dense_samples() -> None:
    random = np.random.default_rng(SEED)
    verdicts = {True: 0, False: 0}
    for number in range(300):
        trajectory = wild(random).stretched(random.uniform(1.0, 3.0))
        excess = -np.inf
        for derivative in range(4):
            low, high = bounds(derivative)
            values = dense(trajectory, derivative)
            excess = max(excess, float((np.maximum(values - high, low - values) / (high - low)).max()))
        if abs(excess) < 1e-4:
            continue  # too near to the limit for samples to judge
        try:
            check_limits(trajectory, LIMITS)
            accepted = True
        except LimitError:
            accepted = False
        assert accepted == (excess < 0.0), f"motion {number} of seed {SEED}"
        verdicts[accepted] += 1
    assert min(verdicts.values()) > 10


def test_a_motion_exactly_at_its_limit_is_accepted_and_one_just_beyond_is_not() -> None:
    # The fastest moment of a quintic from rest to rest is 15/8 of its mean speed.
    at_the_limit = 15.0 / 8.0 * 1.0 / LIMITS.max_velocity[0]
    rates = LIMITS.scaled(1.0, 10.0, 10.0)
    check_limits(rest_to_rest([0.0, 0.0], [1.0, 0.0], at_the_limit), rates)
    with pytest.raises(LimitError, match=r"velocity of shoulder reaches 1\.0001"):
        check_limits(rest_to_rest([0.0, 0.0], [1.0, 0.0], at_the_limit * 0.9999), rates)


@pytest.mark.parametrize(
    ("goal", "duration_s", "message"),
    [
        (
            [0.0, 1.2],
            9.0,
            r"from 0\.000 s to 9\.000 s the position of elbow reaches 1\.2 rad, but its limit is 1 rad",
        ),
        ([-2.5, 0.0], 9.0, "the position of shoulder reaches -2.5 rad, but its limit is -2 rad"),
        ([0.0, 0.8], 0.75, "the velocity of elbow reaches 2 rad/s, but its limit is 1.5 rad/s"),
        ([0.0, -0.8], 0.75, "the velocity of elbow reaches -2 rad/s, but its limit is -1.5 rad/s"),
    ],
)
def test_the_message_names_joint_quantity_value_and_limit(
    goal: list[float], duration_s: float, message: str
) -> None:
    with pytest.raises(LimitError, match=message):
        check_limits(rest_to_rest([0.0, 0.0], goal, duration_s), LIMITS)


def test_acceleration_and_jerk_are_named_when_only_they_are_too_high() -> None:
    # 10/sqrt(3) d/T² and 60 d/T³ are the peaks of a quintic from rest to rest.
    motion = rest_to_rest([0.0, 0.0], [0.0, 0.1], 0.3)
    patient = LIMITS.scaled(1.0, 1.0, 10.0)
    peak, jerk = 10.0 / np.sqrt(3.0) * 0.1 / 0.3**2, 60.0 * 0.1 / 0.3**3
    with pytest.raises(
        LimitError, match=rf"acceleration of elbow reaches -?{peak:.6g} rad/s², but its limit is"
    ):
        check_limits(motion, patient)
    either = f"({jerk:.6g} rad/s³, but its limit is 50|-{jerk / 2:.6g} rad/s³, but its limit is -50) rad/s³"
    with pytest.raises(LimitError, match=f"jerk of elbow reaches {either}"):
        check_limits(motion, LIMITS.scaled(1.0, 10.0, 1.0))


def test_of_several_excesses_the_first_in_time_is_named() -> None:
    slow_then_fast = rest_to_rest([0.0, 0.0], [0.5, 0.0], 3.0).followed_by(
        rest_to_rest([0.5, 0.0], [0.5, 0.9], 0.5)
    )
    fast_then_slow = rest_to_rest([0.5, 0.9], [0.5, 0.0], 0.5).followed_by(
        rest_to_rest([0.5, 0.0], [2.5, 0.0], 9.0)
    )
    with pytest.raises(LimitError, match=r"from 3\.000 s to 3\.500 s the velocity of elbow"):
        check_limits(slow_then_fast, LIMITS)
    with pytest.raises(LimitError, match=r"from 0\.000 s to 0\.500 s the velocity of elbow"):
        check_limits(fast_then_slow, LIMITS)


def test_labels_name_the_points_between_which_it_happens() -> None:
    motion = rest_to_rest([0.0, 0.0], [0.5, 0.0], 3.0).followed_by(rest_to_rest([0.5, 0.0], [0.5, 0.9], 0.5))
    with pytest.raises(LimitError, match=r"^between row 2 and row 3 \(from 3\.000 s to 3\.500 s\) the vel"):
        check_limits(motion, LIMITS, ["row 1", "row 2", "row 3"])


def test_an_excess_between_the_ends_is_found_however_short() -> None:
    # At both ends well within; in between the elbow overshoots for some milliseconds.
    times = np.array([0.0, 1.0])
    motion = from_hermite(
        times, np.array([[0.0, 0.99], [0.0, 0.99]]), np.array([[0.0, 0.1], [0.0, -0.1]]), np.zeros((2, 2))
    )
    assert dense(motion, 0)[:, 1].max() > 1.0
    with pytest.raises(LimitError, match=r"position of elbow reaches 1\.0"):
        check_limits(motion, LIMITS)


def test_stretching_brings_every_rate_within_its_limit_and_the_worst_one_to_it() -> None:
    random = np.random.default_rng(SEED)
    stretched = 0
    for number in range(100):
        motion = wild(random)
        result = stretch_to_limits(motion, LIMITS)
        use = max(float((np.abs(dense(result, k)) / bounds(k)[1]).max()) for k in (1, 2, 3))
        assert use < 1.0 + 1e-9, f"motion {number} of seed {SEED}"
        if result is not motion:
            stretched += 1
            assert use > 0.99, f"motion {number} of seed {SEED}"
    assert stretched > 50


def test_a_motion_within_the_limits_is_not_stretched() -> None:
    motion = rest_to_rest([0.0, 0.0], [0.5, 0.5], 5.0)
    assert stretch_to_limits(motion, LIMITS) is motion
