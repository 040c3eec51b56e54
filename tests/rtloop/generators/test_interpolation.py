"""References between streamed commands.

Oracles: closed forms (straight lines, parabolas), numpy's finite differences of what comes out, and the
limits of joint_limits.yaml. The comments name the cases of libpyflexiv's test_trajectory.cpp and
test_interpolation_sim.py that are covered here for joints; test_pose_interpolation.py has those of poses.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cobot.ipc.layout import Interpolation
from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits
from rtloop.generators.factory import make_interpolator
from rtloop.generators.interpolation import Interpolator

PERIOD_S = 1e-3
KINDS = list(Interpolation)
SMOOTH = [Interpolation.QUINTIC, Interpolation.RUCKIG]
RIPPLE = {Interpolation.QUINTIC: 4.0, Interpolation.RUCKIG: 1.0}
"""Of the jerk limits, on streams that keep them: a quintic knows no limits, and has to guess what comes."""
ROUNDING = 1.0 + 1e-9


class Stream:
    """An interpolator and all that comes out of it, the reference at the start first."""

    def __init__(self, kind: Interpolation, limits: JointLimits, start: Array | None = None) -> None:
        self.limits = limits
        bounds = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        self.interpolator: Interpolator = make_interpolator(kind, limits.dof, PERIOD_S, *bounds)
        self.interpolator.begin(np.zeros((3, limits.dof)) if start is None else start)
        self.references = [self.interpolator.reference.copy()]

    def aim(self, target: Array, duration_s: float, velocity: Array | None = None) -> None:
        self.interpolator.aim(target, velocity, duration_s)

    def advance(self, cycles: int) -> Array:
        """The references of so many cycles, shape (cycles, 3, dof)."""
        for _ in range(cycles):
            self.interpolator.advance()
            self.references.append(self.interpolator.reference.copy())
        return np.array(self.references[-cycles:])

    def follow(self, path: Callable[[float], Array], duration_s: float, commands: int) -> Array:
        """A punctual stream of a path that is at its start now."""
        cycles = round(duration_s / PERIOD_S)
        for k in range(1, commands + 1):
            self.aim(path(k * duration_s), duration_s)
            self.advance(cycles)
        return np.array(self.references[-commands * cycles :])

    def check_smooth(self, share: float = 1.0) -> None:
        """Velocity and acceleration are derivatives of what is above them, and nothing jumps: the jerk is
        below this share of its limit. Taylor's theorem bounds the error of the trapezoidal rule."""
        position, velocity, acceleration = np.moveaxis(np.array(self.references), 1, 0)
        jerk = share * self.limits.max_jerk
        assert (np.abs(np.diff(acceleration, axis=0)) <= ROUNDING * jerk * PERIOD_S).all()
        for upper, lower, bound in (
            (position, velocity, jerk * PERIOD_S**3 / 6.0),
            (velocity, acceleration, jerk * PERIOD_S**2 / 2.0),
        ):
            mean = 0.5 * PERIOD_S * (lower[1:] + lower[:-1])
            assert (np.abs(np.diff(upper, axis=0) - mean) <= bound + 1e-12).all()

    def check_limits(self) -> None:
        """Velocity and acceleration keep their limits in every cycle."""
        _, velocity, acceleration = np.moveaxis(np.array(self.references), 1, 0)
        assert (np.abs(velocity) <= ROUNDING * self.limits.max_velocity).all()
        assert (np.abs(acceleration) <= ROUNDING * self.limits.max_acceleration).all()


@pytest.fixture(scope="module")
def limits(robot: RobotDescription) -> JointLimits:
    return robot.limits


def ramp(limits: JointLimits, share: float = 0.3) -> Callable[[float], Array]:
    """A path at a constant share of the velocity limits, joints in turn up and down."""
    velocity = share * limits.max_velocity * np.resize([1.0, -1.0], limits.dof)
    return lambda t: velocity * t


def wave(limits: JointLimits, share: float = 0.5, rate_hz: float = 0.25) -> Callable[[float], Array]:
    """To and fro at up to a share of the velocity limits; the first three derivatives begin at zero."""
    omega = 2.0 * np.pi * rate_hz
    return lambda t: share * limits.max_velocity / (2.6 * omega) * (1.0 - np.cos(omega * t)) ** 2


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_moves_before_the_first_command(kind: Interpolation, limits: JointLimits) -> None:
    # LinearTrajectory: inactive before init
    start = np.zeros((3, limits.dof))
    start[0] = np.linspace(-1.0, 1.0, limits.dof)
    np.testing.assert_array_equal(
        Stream(kind, limits, start).advance(50), np.broadcast_to(start, (50, 3, limits.dof))
    )


@pytest.mark.parametrize("kind", KINDS)
def test_beginning_anew_forgets_the_command(kind: Interpolation, limits: JointLimits) -> None:
    # LinearTrajectory: cancel
    stream = Stream(kind, limits)
    stream.aim(np.full(limits.dof, 0.01), 0.1)
    stream.advance(40)
    here = stream.interpolator.reference.copy()
    here[1:] = 0.0
    stream.interpolator.begin(here)
    np.testing.assert_array_equal(stream.advance(200), np.broadcast_to(here, (200, 3, limits.dof)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("duration_s", [0.0, -1.0, 1e-9])
def test_a_period_shorter_than_a_cycle_counts_as_one(
    kind: Interpolation, duration_s: float, limits: JointLimits
) -> None:
    # LinearTrajectory: min duration
    stream = Stream(kind, limits)
    target = np.full(limits.dof, 1e-9)
    stream.aim(target, duration_s)
    references = stream.advance(100)
    assert np.isfinite(references).all()
    np.testing.assert_allclose(references[-1, 0], target, atol=1e-15)


def test_without_interpolation_the_reference_is_the_target_and_the_stated_velocity(
    limits: JointLimits,
) -> None:
    stream = Stream(Interpolation.NONE, limits)
    target, velocity = np.full(limits.dof, 0.3), np.full(limits.dof, 0.2)
    stream.aim(target, 0.01, velocity)
    references = stream.advance(11)
    np.testing.assert_array_equal(references[:, 0], np.broadcast_to(target, (11, limits.dof)))
    np.testing.assert_array_equal(references[:10, 1], np.broadcast_to(velocity, (10, limits.dof)))
    np.testing.assert_array_equal(references[10, 1], 0.0), "whoever has fallen silent does not move"


# LinearTrajectory: constant velocity, linear position, monotonic progress
# test_interpolation_sim: joint linear


@pytest.mark.parametrize("rate_hz", [10, 20, 30, 50, 100, 200, 500])
def test_a_linear_reference_has_constant_velocity_at_every_rate_of_commands(
    rate_hz: int, limits: JointLimits
) -> None:
    # test_interpolation_sim: multiple policy frequencies
    stream, path = Stream(Interpolation.LINEAR, limits), ramp(limits)
    duration_s = round(1000 / rate_hz) * PERIOD_S
    references = stream.follow(path, duration_s, 12)
    speed = path(1.0)
    np.testing.assert_allclose(references[:, 1], np.broadcast_to(speed, references[:, 1].shape), atol=1e-10)
    steps = np.diff(references[:, 0], axis=0) / PERIOD_S
    np.testing.assert_allclose(steps, np.broadcast_to(speed, steps.shape), atol=1e-10)
    np.testing.assert_array_equal(references[-1, 0], path(12 * duration_s))


def test_a_linear_reference_is_on_the_straight_line_and_lands_bit_for_bit(limits: JointLimits) -> None:
    # LinearTrajectory: zero motion afterwards; test_interpolation_sim: end position accuracy
    stream, rng = Stream(Interpolation.LINEAR, limits), np.random.default_rng(5)
    start = np.zeros(limits.dof)
    for target in rng.uniform(-1.0, 1.0, (50, limits.dof)):
        stream.aim(target, 0.033)
        references = stream.advance(33)
        line = np.linspace(start, target, 34)[1:]
        np.testing.assert_allclose(references[:, 0], line, atol=1e-14)
        assert (np.sign(np.diff(references[:, 0], axis=0)) == np.sign(target - start)).all()
        np.testing.assert_array_equal(references[-1, 0], target)
        start = target
    rest = stream.advance(5)
    np.testing.assert_array_equal(rest[:, 0], np.broadcast_to(start, (5, limits.dof)))
    np.testing.assert_array_equal(rest[:, 1:], 0.0)


def test_a_linear_period_that_is_no_multiple_of_the_cycle_is_kept_on_average(limits: JointLimits) -> None:
    stream, path = Stream(Interpolation.LINEAR, limits), ramp(limits)
    for k in range(1, 61):
        stream.aim(path(k / 30), 1 / 30)
        stream.advance(round(k * 1000 / 30) - round((k - 1) * 1000 / 30))
    references = np.array(stream.references)[100:]
    assert (np.abs(references[:, 1]) > 0.97 * np.abs(path(1.0))).all(), "no stop at a command"
    np.testing.assert_allclose(references[-1, 0], path(2.0), atol=1e-3)


def test_no_motion_is_commanded_towards_where_the_reference_is(limits: JointLimits) -> None:
    # LinearTrajectory: zero motion
    for kind in KINDS:
        stream = Stream(kind, limits)
        for _ in range(3):
            stream.aim(np.zeros(limits.dof), 0.033)
            np.testing.assert_array_equal(stream.advance(33), 0.0)


# The smooth kinds


@pytest.mark.parametrize("kind", SMOOTH)
@pytest.mark.parametrize("rate_hz", [10, 50, 100, 500])
def test_a_stream_at_constant_speed_goes_on_at_constant_speed(
    kind: Interpolation, rate_hz: int, limits: JointLimits
) -> None:
    path = ramp(limits)
    stream = Stream(kind, limits, np.array([path(0.0), path(1.0), path(0.0)]))
    late = stream.follow(path, 1 / rate_hz, 3 * rate_hz)[2000:]
    np.testing.assert_allclose(late[:, 1], np.broadcast_to(path(1.0), late[:, 1].shape), atol=1e-10)
    np.testing.assert_allclose(late[:, 2], 0.0, atol=1e-6)
    np.testing.assert_allclose(late[-1, 0], path(3.0), atol=1e-12)


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_stream_at_constant_acceleration_is_followed_without_ripple(
    kind: Interpolation, limits: JointLimits
) -> None:
    acceleration = 0.1 * limits.max_acceleration
    stream = Stream(kind, limits)
    late = stream.follow(lambda t: 0.5 * acceleration * t * t, 0.02, 50)[600:]
    np.testing.assert_allclose(late[:, 2], np.broadcast_to(acceleration, late[:, 2].shape), rtol=2e-3)


@pytest.mark.parametrize("kind", SMOOTH)
@pytest.mark.parametrize("rate_hz", [10, 20, 100])
def test_a_stream_that_changes_smoothly_is_followed(
    kind: Interpolation, rate_hz: int, limits: JointLimits
) -> None:
    path, stream = wave(limits), Stream(kind, limits)
    stream.follow(path, 1 / rate_hz, 4 * rate_hz)
    wanted = np.array([path(k * PERIOD_S) for k in range(4001)])
    off = np.abs(np.array(stream.references)[:, 0] - wanted)
    assert off.max() < {10: 0.01, 20: 4e-3, 100: 4e-3}[rate_hz]
    stream.check_limits()
    stream.check_smooth(RIPPLE[kind])


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_single_command_is_a_move_to_rest_at_the_target(kind: Interpolation, limits: JointLimits) -> None:
    stream, target = Stream(kind, limits), np.resize([0.02, -0.01, 0.0], limits.dof)
    stream.aim(target, 0.4)
    references = stream.advance(1000)
    np.testing.assert_allclose(references[-1, 0], target, atol=1e-9)
    np.testing.assert_array_equal(references[-1, 1:], 0.0)
    assert (np.abs(references[:, 0]) <= np.abs(target) + 1e-9).all(), "it does not overshoot"
    stream.check_smooth()


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_stream_that_ends_in_motion_comes_to_rest_without_a_jump(
    kind: Interpolation, limits: JointLimits
) -> None:
    stream, path = Stream(kind, limits), wave(limits)
    stream.follow(path, 0.01, 150)
    rest = stream.advance(1500)
    np.testing.assert_array_equal(rest[-1, 1:], 0.0)
    stream.check_limits()
    stream.check_smooth(RIPPLE[kind])
    np.testing.assert_array_equal(rest[-1, 0], path(1.5), "it settles on the target")


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_moving_start_is_braked_and_not_stopped_dead(kind: Interpolation, limits: JointLimits) -> None:
    start = np.zeros((3, limits.dof))
    start[1] = 0.5 * limits.max_velocity
    stream = Stream(kind, limits, start)
    np.testing.assert_array_equal(stream.advance(1000)[-1, 1:], 0.0)
    stream.check_smooth()
    stream.check_limits()


@pytest.mark.parametrize("kind", SMOOTH)
def test_a_stated_velocity_is_the_velocity_at_the_target(kind: Interpolation, limits: JointLimits) -> None:
    stream, velocity = Stream(kind, limits), 0.05 * limits.max_velocity
    stream.aim(0.5 * 0.3 * velocity, 0.3, velocity)  # at half the way of that velocity: a steady start
    np.testing.assert_allclose(stream.advance(300)[-1, 1], velocity, atol=1e-7)
    wild = Stream(kind, limits)
    wild.aim(np.zeros(limits.dof), 0.3, 10.0 * limits.max_velocity)
    assert (np.abs(wild.advance(300)[-1, 1]) <= limits.max_velocity).all()


@pytest.mark.parametrize("kind", SMOOTH)
def test_an_unpunctual_stream_is_followed_without_a_jump_or_a_stop(
    kind: Interpolation, limits: JointLimits
) -> None:
    stream, path, rng = Stream(kind, limits), ramp(limits), np.random.default_rng(11)
    cycle = 0
    for k in range(1, 80):
        stream.aim(path(k * 0.033), 0.033)
        arrival = round(33 * k + rng.uniform(-6.0, 6.0))  # of the next command: early or late
        stream.advance(arrival - cycle)
        cycle = arrival
    if kind is Interpolation.RUCKIG:
        stream.check_smooth()
    speeds = np.array(stream.references)[1000:, 1] / path(1.0)
    assert speeds.min() > 0.4
    np.testing.assert_allclose(stream.interpolator.reference[0], path(cycle * PERIOD_S), atol=0.03)


@pytest.mark.parametrize("kind", SMOOTH)
def test_after_a_pause_a_stream_begins_anew(kind: Interpolation, limits: JointLimits) -> None:
    stream, path = Stream(kind, limits), ramp(limits)
    stream.follow(path, 0.02, 40)
    rest = stream.advance(1500)[-1, 0].copy()
    stream.aim(rest + 1e-3, 0.2)
    references = stream.advance(800)
    np.testing.assert_allclose(references[-1, 0], rest + 1e-3, atol=1e-9)
    assert (references[:, 0] <= rest + 1e-3 + 1e-9).all(), "the old velocity is forgotten"


@hypothesis_settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.001, 0.002, 0.01, 1 / 30, 0.1]),
    st.sampled_from(["anywhere", "too fast", "steady", "stop and go"]),
)
def test_no_stream_takes_an_online_reference_beyond_its_limits(
    limits: JointLimits, seed: int, duration_s: float, style: str
) -> None:
    rng, stream = np.random.default_rng(seed), Stream(Interpolation.RUCKIG, limits)
    dof, speed = limits.dof, limits.max_velocity
    target, velocity = np.zeros(dof), np.zeros(dof)
    for _ in range(30):
        if style == "anywhere":
            target = rng.uniform(-2.0, 2.0, dof)
        elif style == "too fast":
            target = target + rng.uniform(-1.5, 1.5, dof) * speed * duration_s
        elif style == "steady":
            change = rng.uniform(-1.0, 1.0, dof) * limits.max_acceleration * duration_s
            velocity = np.clip(velocity + change, -speed, speed)
            target = target + velocity * duration_s
        else:
            target = np.where(rng.random(dof) < 0.3, target, target + speed * duration_s)
        stated = rng.uniform(-2.0, 2.0, dof) * speed if rng.random() < 0.3 else None
        if rng.random() < 0.9:  # some commands are lost
            stream.aim(target, duration_s, stated)
        stream.advance(max(1, int(duration_s / PERIOD_S * rng.choice([0.5, 1.0, 1.3]))))
    stream.check_limits()
    stream.check_smooth()


@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e300])
def test_no_error_of_ruckig_escapes(poison: float, limits: JointLimits) -> None:
    stream = Stream(Interpolation.RUCKIG, limits)
    stream.follow(ramp(limits), 0.02, 20)
    before = stream.interpolator.reference.copy()
    stream.aim(np.full(limits.dof, poison), 0.02)
    after = stream.advance(1)[0]
    assert np.isfinite(after).all()
    np.testing.assert_allclose(after[0], before[0] + PERIOD_S * before[1], atol=1e-5)
