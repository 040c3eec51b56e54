"""The safety layer alone: whatever is requested, the output keeps the limits.

Oracle: numpy's finite differences of the output, against the numbers of joint_limits.yaml.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cobot.ipc.layout import Intervention
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.safety.limiter import Safety

PERIOD_S = 1e-3
EXCESS = 1.011
"""What the layer tolerates on the rates, plus rounding."""


class Output:
    """What a safety layer has let through."""

    def __init__(self, robot: RobotDescription, start: Array) -> None:
        self.limits = robot.limits
        self.safety = Safety(robot.limits, PERIOD_S)
        self.safety.reset(start)
        self.positions = [start.copy(), start.copy(), start.copy()]

    def apply(self, position: Array, velocity: Array | None = None) -> bool:
        zeros = np.zeros_like(position)
        accepted = self.safety.apply(np.array([position, zeros if velocity is None else velocity, zeros]))
        self.positions.append(self.safety.position.copy())
        return accepted

    def check(self) -> None:
        positions = np.array(self.positions)
        velocity = np.diff(positions, axis=0) / PERIOD_S
        acceleration = np.diff(positions, 2, axis=0) / PERIOD_S**2
        assert np.isfinite(positions).all()
        assert (positions >= self.limits.min_position - 1.1e-5).all()
        assert (positions <= self.limits.max_position + 1.1e-5).all()
        assert (np.abs(velocity) <= EXCESS * self.limits.max_velocity).all()
        assert (np.abs(acceleration) <= EXCESS * self.limits.max_acceleration + 1e-6).all()
        jerk = np.diff(positions, 3, axis=0) / PERIOD_S**3
        assert (np.abs(jerk) <= EXCESS * self.limits.max_jerk + 1e-4).all()


@pytest.fixture
def output(robot: RobotDescription) -> Output:
    return Output(robot, np.array(robot.positions["home"].joints))


def counted(output: Output) -> dict[str, int]:
    return {kind.name: int(n) for kind, n in zip(Intervention, output.safety.interventions, strict=True) if n}


def test_a_jump_becomes_a_jerk_limited_move(output: Output) -> None:
    goal = output.positions[0] + np.array([0.5, -0.3, 0.2, 0.4, -0.8, 0.1, 1.0])
    for _ in range(3000):
        assert output.apply(goal)
    output.check()
    np.testing.assert_array_equal(output.positions[-1], goal)
    assert counted(output) == {"VELOCITY": 1, "ACCELERATION": 1, "JERK": 1}
    assert not output.safety.pursuing


# libpyflexiv's suites ClampJointPosition and ClampJointVelocity


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("joint", range(7))
def test_each_joint_is_limited_for_itself_in_both_directions(output: Output, sign: float, joint: int) -> None:
    goal = output.positions[0].copy()
    goal[joint] += 0.5 * sign
    for _ in range(60):
        output.apply(goal)
    moved = np.abs(np.array(output.positions) - output.positions[0])
    assert np.flatnonzero(moved.max(axis=0)).tolist() == [joint]
    assert (sign * (output.positions[-1] - output.positions[0]))[joint] > 0.0
    output.check()


def test_a_joint_within_its_limits_is_not_touched_while_another_is_limited(output: Output) -> None:
    goal = output.positions[0].copy()
    goal[0] += 0.5
    output.apply(goal)
    np.testing.assert_array_equal(output.positions[-1][1:], output.positions[0][1:])
    assert output.positions[-1][0] < output.positions[0][0] + 1e-4


def test_a_request_beyond_a_joint_stop_ends_at_the_stop(output: Output) -> None:
    for cycle in range(6000):
        ramp = output.positions[0].copy()
        ramp[1] += min(cycle * 0.0005, 2.5)  # 0.5 rad/s towards 2.5 rad, the limit is 2.1
        output.apply(ramp)
    output.check()
    assert output.positions[-1][1] == pytest.approx(2.1, abs=1e-5)
    assert "POSITION" in counted(output)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("beyond_rad", [0.0, 0.02])
def test_motions_that_begin_at_a_joint_stop_take_no_joint_further(
    robot: RobotDescription, side: float, beyond_rad: float
) -> None:
    """Each is told to go on, and ends where the first one did, but for a rounding."""
    limits = robot.limits
    stop = limits.max_position if side > 0.0 else limits.min_position
    here = stop + side * beyond_rad
    for _ in range(30):
        output = Output(robot, here)
        for _ in range(300):
            output.apply(here + side * 0.01)
        here = output.positions[-1]
        assert np.ptp(np.array(output.positions[-100:]), axis=0).max() < 1e-9
    assert np.all(side * (here - stop) <= max(beyond_rad, 1e-5) + 1e-7)
    output.apply(here - side * 1e-6)  # back it may
    assert np.all(side * (output.positions[-1] - here) <= 0.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_has_come_back_within_a_limit_does_not_go_beyond_it_again(
    robot: RobotDescription, side: float
) -> None:
    limits = robot.limits
    stop = limits.max_position if side > 0.0 else limits.min_position
    output = Output(robot, stop + side * 0.05)
    for _ in range(1500):
        output.apply(stop - side * 0.1)
    np.testing.assert_allclose(output.positions[-1], stop - side * 0.1, atol=1e-9)
    for _ in range(1500):
        output.apply(stop + side * 0.05)
    np.testing.assert_allclose(output.positions[-1], stop, atol=1.1e-5)
    assert np.all(side * (np.array(output.positions[1500:]) - stop) <= 1.1e-5)


def test_a_stated_velocity_beyond_the_limit_is_not_passed_on(output: Output, robot: RobotDescription) -> None:
    wild = robot.limits.max_velocity * 3.0
    output.apply(output.positions[0], wild)
    assert (np.abs(output.safety.velocity) <= robot.limits.max_velocity).all()
    assert counted(output) == {"VELOCITY": 1}


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf, 1e308])
@pytest.mark.parametrize("joint", [0, 6])
def test_a_number_that_is_none_is_never_passed_on(output: Output, poison: float, joint: int) -> None:
    bad = output.positions[0].copy()
    bad[joint] = poison
    accepted = output.apply(bad)
    assert accepted == np.isfinite(poison)  # 1e308 is a number, though far beyond the joint's stop
    output.check()


def test_after_nan_in_full_motion_the_brake_ends_at_rest_within_the_limits(output: Output) -> None:
    start = output.positions[0]
    for cycle in range(300):  # a smooth start to 0.54 rad/s on the first joint, with a jerk of 12 rad/s³
        smooth = start.copy()
        smooth[0] += 2e-9 * cycle**3
        output.apply(smooth)
    assert output.safety.interventions.sum() == 0
    assert not output.apply(np.full(7, np.nan))
    for _ in range(2000):
        at_rest = output.safety.brake()
        output.positions.append(output.safety.position.copy())
    output.check()
    assert at_rest
    assert output.positions[-1][0] > smooth[0], "it did not stop dead"
    assert counted(output) == {"NOT_FINITE": 1}


def test_what_keeps_the_limits_passes_bit_for_bit(output: Output) -> None:
    start = output.positions[0]
    times = np.arange(4000) * PERIOD_S
    requests = start + 0.05 * (2.0 * times - np.sin(2.0 * times))[:, None]
    for request in requests:
        output.apply(request)
    np.testing.assert_array_equal(np.array(output.positions[3:]), requests)
    assert counted(output) == {}


@hypothesis_settings(max_examples=25)
@given(
    st.lists(
        st.tuples(
            st.integers(1, 250),
            st.lists(st.floats(-8.0, 8.0), min_size=7, max_size=7),
            st.sampled_from(["jump", "ramp", "nan"]),
        ),
        min_size=1,
        max_size=8,
    )
)
def test_no_sequence_of_requests_leaves_the_limits(
    robot: RobotDescription, episodes: list[tuple[int, list[float], str]]
) -> None:
    output = Output(robot, np.array(robot.positions["home"].joints))
    braking = False
    for cycles, values, kind in episodes:
        goal = np.array(values)
        begin = output.safety.position.copy()
        for cycle in range(cycles):
            request = goal if kind == "jump" else begin + (goal - begin) * (cycle / cycles)
            if kind == "nan" and cycle == cycles // 2:
                request = np.full(7, np.nan)
            braking |= not output.apply(request)
            if braking:
                braking = not output.safety.brake()
                output.positions.append(output.safety.position.copy())
    output.check()
