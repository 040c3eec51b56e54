"""Motions at rates in units.

Oracle: pinocchio for where the TCP is; differences of samples for velocities, accelerations and jerks.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from independent_models import (
    MJCF,
    largest_rates,
    rate_limits,
    second_robot,
)
from scipy.spatial.transform import Rotation

from cobot.errors import InputError, LimitError
from cobot.motions.requests import Envelope, MotionRequest, RatedMove
from cobot.planners.rated import plan_rated
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

FULL = Scaling(1.0)

ROUNDING = 1.0 + 1e-6


@pytest.fixture(scope="module")
def envelope(robot: RobotDescription) -> Envelope:
    return Envelope(robot.limits, robot.cartesian_limits)


@pytest.fixture(scope="module")
def home(robot: RobotDescription) -> Array:
    return np.array(robot.positions["home"].joints)


def planned(robot: RobotDescription, move: RatedMove) -> Trajectory:
    leg = plan_rated(robot, move)
    assert leg is not None
    return leg.motion


def ptp(
    robot: RobotDescription, envelope: Envelope, start: Array, goal: Array, v: float = 0.5, a: float = 1.0
) -> Trajectory:
    return planned(robot, RatedMove(MotionRequest(start, goal, PlannerName.PTP, FULL), v, a, envelope))


def line(
    robot: RobotDescription, envelope: Envelope, start: Array, by: list[float], **change: object
) -> Trajectory:
    """A straight line by so many metres, orientation kept."""
    place, turn = second_robot().forward(start)
    goal = Pose(place + by, Rotation.from_matrix(turn).as_quat(scalar_first=True))
    move = RatedMove(MotionRequest(start, goal, PlannerName.LIN, FULL), 0.25, 1.2, envelope)
    return planned(robot, replace(move, **change))  # type: ignore[arg-type]


def at(trajectory: Trajectory, count: int = 400) -> Array:
    """Places of the TCP, shape (count, 3)."""
    return second_robot().path(trajectory.sample(np.linspace(0.0, trajectory.duration_s, count)))[0]


@pytest.mark.parametrize("seed", range(10))
def test_no_joint_is_faster_than_asked_or_than_it_may_be(
    robot: RobotDescription, envelope: Envelope, seed: int
) -> None:
    random = np.random.default_rng(seed)
    start = np.array(robot.positions["home"].joints)
    velocity, acceleration = random.uniform(0.05, 3.0), random.uniform(0.1, 20.0)
    motion = ptp(robot, envelope, start, start + random.uniform(-0.4, 0.4, 7), velocity, acceleration)
    rates, limits = largest_rates(motion), rate_limits(robot.limits)
    assert (rates <= limits * ROUNDING).all()
    assert rates[0].max() <= velocity * ROUNDING
    assert rates[1].max() <= acceleration * ROUNDING
    assert max((rates / limits).max(), rates[0].max() / velocity, rates[1].max() / acceleration) > 0.7


def test_the_tool_is_as_fast_as_asked_along_a_line(
    robot: RobotDescription, envelope: Envelope, home: Array
) -> None:
    motion = line(robot, envelope, home, [0.0, 0.2, 0.0], velocity=0.1, acceleration=0.5)
    step_s = motion.duration_s / 2000
    speeds = np.linalg.norm(np.diff(at(motion, 2001), axis=0), axis=1) / step_s
    assert speeds.max() == pytest.approx(0.1, rel=1e-3)
    assert (np.diff(speeds) / step_s).max() == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize("planner", [PlannerName.PTP, PlannerName.LIN])
def test_a_duration_is_kept_exactly_and_counts_instead_of_the_rates(
    robot: RobotDescription, envelope: Envelope, home: Array, planner: PlannerName
) -> None:
    place, turn = second_robot().forward(home)
    pose = Pose(place + np.array([0.0, 0.1, 0.0]), Rotation.from_matrix(turn).as_quat(scalar_first=True))
    goal = home + 0.2 if planner is PlannerName.PTP else pose
    slow = RatedMove(
        MotionRequest(home, goal, planner, FULL), -1.0, 0.0, envelope, duration_s=3.0
    )  # rates that would be refused
    assert planned(robot, slow).duration_s == pytest.approx(3.0, abs=1e-9)
    with pytest.raises(InputError) as refused:
        plan_rated(robot, replace(slow, duration_s=0.05))
    shortest = re.search(
        r"duration is 0.05 s; the shortest possible duration is ([\d.]+) s", str(refused.value)
    )
    assert shortest
    with pytest.raises(LimitError, match="duration is 1e\\+300 s, allowed: up to 86400 s"):
        plan_rated(robot, replace(slow, duration_s=1e300))
    fastest = planned(robot, replace(slow, duration_s=float(shortest[1]) + 1e-3))
    share = (largest_rates(fastest) / rate_limits(robot.limits)).max()
    assert share <= ROUNDING
    if planner is PlannerName.PTP:
        assert share > 0.75  # of the jerk planned motions use 0.8


@pytest.mark.parametrize("rates", [(0.0, 1.0), (-0.1, 1.0), (1.0, 0.0)])
def test_rates_that_are_not_above_zero_are_refused(
    robot: RobotDescription, envelope: Envelope, home: Array, rates: tuple[float, float]
) -> None:
    with pytest.raises(InputError, match=r"^[va] must be above 0, got"):
        plan_rated(robot, RatedMove(MotionRequest(home, home + 0.1, PlannerName.PTP, FULL), *rates, envelope))


def test_an_arm_that_is_there_has_nothing_to_do(
    robot: RobotDescription, envelope: Envelope, home: Array
) -> None:
    assert (
        plan_rated(robot, RatedMove(MotionRequest(home, home, PlannerName.PTP, FULL), 1.0, 1.0, envelope))
        is None
    )


def test_tighter_limits_hold(robot: RobotDescription, envelope: Envelope, home: Array) -> None:
    tight = replace(robot.limits, max_velocity=np.full(7, 0.1), max_position=home + 0.3)
    motion = ptp(robot, replace(envelope, limits=tight), home, home + 0.2, 2.0, 5.0)
    assert largest_rates(motion)[0].max() <= 0.1 * ROUNDING
    with pytest.raises(LimitError):
        ptp(robot, replace(envelope, limits=tight), home, home + 0.31)


def test_a_tool_goes_along_the_line_and_not_the_tcp(
    robot: RobotDescription, envelope: Envelope, home: Array
) -> None:
    offset, tilt = np.array([0.05, 0.0, 0.12]), Rotation.from_rotvec([0.0, 0.2, 0.0])
    tool = (*offset, *tilt.as_quat(scalar_first=True))
    place, turn = second_robot().forward(home)
    tip = place + turn @ offset
    goal = Rotation.from_rotvec([0.4, 0.0, 0.0]) * Rotation.from_matrix(turn) * tilt
    pose = Pose(tip + np.array([0.0, 0.1, 0.0]), goal.as_quat(scalar_first=True))
    model = RobotModel.load(MJCF, robot.limits)
    model.carry(Tool(tcp=(tool[0], tool[1], tool[2], *map(float, tool[3:]))))
    held = replace(robot, model=model)
    motion = planned(held, RatedMove(MotionRequest(home, pose, PlannerName.LIN, FULL), 0.2, 1.0, envelope))
    places, turns = second_robot().path(motion.sample(np.linspace(0.0, motion.duration_s, 100)))
    tips = places + turns.apply(offset)
    assert np.abs(tips[:, [0, 2]] - tip[[0, 2]]).max() < 2e-4
    np.testing.assert_allclose(tips[-1], pose.position, atol=1e-6)
    assert ((turns[-1] * tilt).inv() * goal).magnitude() < 1e-6
    assert np.abs(places[:, 2] - place[2]).max() > 1e-3  # the model's TCP does not go straight
