"""Stop, pause, resume and override: never off the path, never beyond the limits.

Oracle: numpy's finite differences of the commanded positions, and `Trajectory.sample` for the path.
"""

from __future__ import annotations

import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Command, MotionResult
from cobot.motions.requests import MotionRequest
from cobot.planners import WaypointRequest, plan_waypoints
from cobot.planners.ptp import plan_ptp
from cobot.planners.timing.path import JointCurve as JointPath
from cobot.planners.timing.time_law import time_optimal
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import LoopMode, PlannerName, Scaling, Waypoint
from rtloop.planned.path import Path
from rtloop.planned.path_clock import PathClock

ROUNDING = 1.005
"""Finite differences of the third order at 1 kHz carry this much of rounding and sampling."""


def ptp(robot: RobotDescription, start: np.ndarray, goal: np.ndarray, speed: float) -> Trajectory:
    return plan_ptp(robot, MotionRequest(start, goal, PlannerName.PTP, Scaling(speed)), goal)


def curve(
    robot: RobotDescription, start: np.ndarray, random: np.random.Generator, speed: float
) -> Trajectory:
    """A smooth detour through four random points, timed at the limits: many true quintics."""
    scaling = Scaling(speed)
    limits = robot.limits.scaled(speed, speed, scaling.shares[2])
    while True:
        points = np.vstack([start, start + random.uniform(-0.4, 0.4, (4, len(start)))])
        path = JointPath.through(np.linspace(0.0, 1.0, 5), points)
        trajectory = time_optimal(robot, path, limits).trajectory
        low, high = trajectory.extrema(0)
        if (low >= robot.limits.min_position).all() and (high <= robot.limits.max_position).all():
            return trajectory


def check(rig: Rig, trajectory: Trajectory) -> None:
    velocity, acceleration, jerk = rig.rates()
    assert velocity.max() <= ROUNDING
    assert acceleration.max() <= ROUNDING
    assert jerk.max() <= ROUNDING
    on_path = trajectory.sample(rig.path_times)
    np.testing.assert_allclose(np.array(rig.commanded), on_path, atol=1e-12)
    assert np.diff(rig.path_times).min() >= -1e-7, "goes back"
    assert sum(rig.interventions) == 0


def test_a_motion_that_nobody_disturbs_passes_bit_for_bit(rig: Rig, robot: RobotDescription) -> None:
    goal = np.array([1.0, 0.5, 0.3, -1.0, 0.5, 1.0, 0.5])
    trajectory = ptp(robot, rig.home, goal, 1.0)
    assert rig.start(trajectory) == ""
    rig.commanded.clear()
    rig.path_times.clear()
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    check(rig, trajectory)
    np.testing.assert_allclose(rig.commanded[-1], goal, atol=1e-12)


@pytest.mark.parametrize("seed", range(40))
def test_a_stop_at_any_time_stays_on_the_path_and_within_the_limits(
    settings: Settings, robot: RobotDescription, seed: int
) -> None:
    random = np.random.default_rng(seed)
    rig = Rig(settings, robot)
    try:
        speed = float(random.choice([0.1, 0.3, 0.5, 0.8, 1.0]))
        if seed % 2:
            trajectory = curve(robot, rig.home, random, speed)
        else:
            goal = rig.home + random.uniform(-1.0, 1.0, 7)
            goal = goal.clip(robot.limits.min_position, robot.limits.max_position)
            trajectory = ptp(robot, rig.home, goal, speed)
        assert rig.start(trajectory) == ""
        rig.commanded.clear()
        rig.path_times.clear()
        rig.step(int(random.uniform(0.02, 0.98) * trajectory.duration_s * 1000))
        requested = len(rig.commanded)
        rig.request()
        rig.run()
        check(rig, trajectory)
        assert rig.mode is LoopMode.HOLD
        moving = np.flatnonzero(np.abs(np.diff(np.array(rig.commanded), axis=0)).max(axis=1))
        assert (moving[-1] - requested) * 1e-3 < 1.2, "at rest soon"
        assert rig.result in (MotionResult.STOPPED, MotionResult.ARRIVED)
    finally:
        rig.close()


@pytest.mark.parametrize("seed", range(15))
def test_overrides_pauses_and_a_stop_in_any_order_keep_the_limits(
    settings: Settings, robot: RobotDescription, seed: int
) -> None:
    random = np.random.default_rng(1000 + seed)
    rig = Rig(settings, robot)
    try:
        trajectory = curve(robot, rig.home, random, float(random.choice([0.3, 0.6, 1.0])))
        assert rig.start(trajectory) == ""
        rig.commanded.clear()
        rig.path_times.clear()
        for _ in range(6):
            rig.step(int(random.uniform(5, 250)))
            rig.send(Command.SET_RATE, value=float(random.choice([0.0, 0.2, 0.7, 1.0])))
        rig.step(50)
        if seed % 2:
            rig.request()
        else:
            rig.send(Command.SET_RATE, value=1.0)
        rig.run()
        check(rig, trajectory)
        if not seed % 2:
            assert rig.result is MotionResult.ARRIVED
    finally:
        rig.close()


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.5])
def test_a_stop_in_the_cruise_takes_effect_within_a_few_cycles(
    rig: Rig, robot: RobotDescription, speed: float
) -> None:
    trajectory = ptp(robot, rig.home, rig.home + np.array([2.0, 0.5, 0, 0.3, 0, 0, 0]), speed)
    assert rig.start(trajectory) == ""
    rig.step(int(trajectory.duration_s * 500))
    rig.request()
    cycles = 0
    while rig.loop.controller.clock.rate == 1.0:
        rig.step()
        cycles += 1
        assert cycles < 8
    rig.run()


def test_a_paused_motion_waits_and_goes_on(rig: Rig, robot: RobotDescription) -> None:
    trajectory = ptp(robot, rig.home, rig.home + 0.4, 0.5)
    assert rig.start(trajectory) == ""
    rig.step(300)
    rig.send(Command.SET_RATE, value=0.0)
    rig.step(1500)
    assert rig.mode is LoopMode.TRAJECTORY
    here = rig.commanded[-1]
    rig.step(100)
    np.testing.assert_array_equal(rig.commanded[-1], here)
    rig.send(Command.SET_RATE, value=1.0)
    rig.run()
    assert rig.result is MotionResult.ARRIVED


@pytest.mark.parametrize("paused_after", range(1, 200, 6))
def test_a_motion_paused_where_the_path_leaves_no_room_goes_on(
    rig: Rig, robot: RobotDescription, paused_after: int
) -> None:
    """Near its start the path needs all the acceleration of a joint: no profile leads from rate 0 to 1."""
    goal = np.array([-0.78837122, 0.27312708, 0.20006086, -1.70469166, 0.0794025, 1.325601, -0.27884569])
    trajectory = ptp(robot, rig.home, goal, 0.9994684422938739)
    assert rig.start(trajectory) == ""
    rig.commanded.clear()
    rig.path_times.clear()
    rig.step(paused_after)
    rig.send(Command.SET_RATE, value=0.0)
    rig.step(1500)
    rig.send(Command.SET_RATE, value=1.0)
    rig.run(3000)
    assert rig.result is MotionResult.ARRIVED
    check(rig, trajectory)


def test_a_stop_ends_a_pause(rig: Rig, robot: RobotDescription) -> None:
    assert rig.start(ptp(robot, rig.home, rig.home + 0.4, 0.5)) == ""
    rig.step(300)
    rig.send(Command.SET_RATE, value=0.0)
    rig.step(1500)
    rig.request()
    rig.run()
    assert (rig.mode, rig.result) == (LoopMode.HOLD, MotionResult.STOPPED)


@pytest.mark.parametrize("rate", [-0.1, 1.1, float("nan")])
def test_a_rate_outside_its_range_is_refused(rig: Rig, robot: RobotDescription, rate: float) -> None:
    assert rig.start(ptp(robot, rig.home, rig.home + 0.4, 0.5)) == ""
    assert "from 0 to 1" in rig.answer(rig.send(Command.SET_RATE, value=rate))


def test_a_path_beyond_the_limits_can_be_stopped_too(rig: Rig, robot: RobotDescription) -> None:
    """validate_limits=false lets such a path through; the safety layer bounds what comes of it."""
    trajectory = curve(robot, rig.home, np.random.default_rng(5), 1.0).stretched(0.5)
    assert rig.start(trajectory) == ""
    rig.step(300)
    rig.request()
    rig.run()
    assert rig.mode is LoopMode.HOLD
    velocity, acceleration, jerk = rig.rates()
    assert velocity.max() <= 1.02
    assert acceleration.max() <= 1.02
    assert jerk.max() <= 1.02


@pytest.mark.parametrize("request_name", ["stops", "estops"])
@pytest.mark.parametrize(("amplitude_rad", "step_s"), [(0.003, 0.08), (0.01, 0.1), (0.05, 0.05), (0.3, 0.3)])
def test_a_zigzag_that_leaves_no_room_to_slow_down_is_stopped_beside_its_path(
    rig: Rig, robot: RobotDescription, amplitude_rad: float, step_s: float, request_name: str
) -> None:
    turns = [rig.home + amplitude_rad * (-1) ** i * (i > 0) for i in range(400)]
    points = [Waypoint(turn.tolist(), step_s * i, None, None, str(i)) for i, turn in enumerate(turns)]
    unchecked = WaypointRequest(rig.home, points, 0.01, check_limits=False, retime=False, approach=None)
    assert rig.start(plan_waypoints(robot, unchecked)) == ""
    rig.step(1503)
    rig.request(request_name)
    rig.run(3000)
    stopped = rig.mode is LoopMode.HOLD and rig.result is MotionResult.STOPPED_ASIDE
    assert (
        stopped
        if request_name == "stops"
        else (rig.mode is LoopMode.ESTOP and not rig.loop.controller.moving)
    )
    velocity, acceleration, jerk = rig.rates()
    assert velocity.max() <= 1.02
    assert acceleration.max() <= 1.02
    assert jerk.max() <= 1.02


@pytest.mark.parametrize("speed", [1e10, 1e30, 1e100, 1e300])
def test_a_path_for_which_there_is_no_profile_at_all_is_given_up_and_raises_nothing(
    robot: RobotDescription, speed: float
) -> None:
    """Ruckig raises errors of several classes on limits that are all but zero."""

    racing = Path(1, 7)
    racing.breakpoints_s[1] = 1e9
    racing.coefficients[0, :, 1:4] = speed * np.array([1.0, 1 / 2, 1 / 6])  # all derivatives are the speed
    racing.begin(1)
    clock = PathClock(robot.limits, 1e-3)
    clock.request(0.0)
    cycles = 0
    while not clock.stuck:
        clock.advance(racing)
        cycles += 1
    assert 300 < cycles < 600
    assert clock.rate == 1.0
