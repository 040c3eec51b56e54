"""Motions through round corners without a stop.

Oracle: pinocchio for where the TCP is and how fast; the motions with stops, for path and duration;
differences of samples for what each joint does.
"""

from __future__ import annotations

from itertools import zip_longest

import numpy as np
import pytest
from independent_models import changed_world, robot_in, second_robot
from scipy.spatial import cKDTree

from cobot.errors import InputError
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.motions.requests import Blended
from cobot.planners import MotionRequest, plan
from cobot.planners.blending.joined import Leg, _between, _breaks, joined, leg_of
from cobot.robot.description import RobotDescription
from cobot.types import Array, PlannerName, Pose, Scaling

START = np.array([0.0, 0.5, 0.0, -1.3, 0.0, 1.34, 0.0])
LIN, PTP, CIRC = PlannerName.LIN, PlannerName.PTP, PlannerName.CIRC
RADIUS_M = 0.05
Step = tuple[PlannerName, Array | Pose, float]
LEG_SAMPLES = 8000


def off(robot: RobotDescription, x: float, y: float, z: float) -> Pose:
    here = robot.model.forward(START)
    return Pose(here.position + np.array([x, y, z]), here.quaternion)


def legs(
    robot: RobotDescription, steps: list[Step], constraints: tuple[Constraints | None, ...] = ()
) -> list[Leg]:
    made, start = [], START
    for (planner, goal, speed), held in zip_longest(steps, constraints):
        via = off(robot, 0.08, 0.0, 0.1).position if planner is CIRC else None
        request = MotionRequest(start, goal, planner, Scaling(speed), via, constraints=held)
        motion = plan(robot, request)
        assert motion is not None
        made.append(leg_of(robot, request, motion))
        start = motion.end
    return made


def stopping_s(motions: list[Leg]) -> float:
    return sum(leg.motion.duration_s for leg in motions)


def square(
    robot: RobotDescription, speed: float = 1.0, constraints: tuple[Constraints | None, ...] = ()
) -> list[Leg]:
    ways = [(0.05, 0.2, 0.0), (0.05, 0.2, -0.2), (0.05, -0.2, -0.2)]
    return legs(robot, [(LIN, off(robot, *way), speed) for way in ways], constraints)


def mixed(robot: RobotDescription) -> list[Leg]:
    there = START + np.array([0.5, 0.3, 0.0, 0.2, 0.0, -0.3, 0.0])
    return legs(
        robot,
        [
            (PTP, there, 1.0),
            (LIN, off(robot, 0.05, 0.2, -0.1), 0.2),
            (PTP, START, 1.0),
            (LIN, off(robot, 0.05, 0.2, 0.0), 0.5),
            (CIRC, off(robot, 0.05, -0.2, 0.0), 0.5),
        ],
    )


def require_smooth(motion: Blended) -> None:
    whole = motion.trajectory
    widths, pieces = np.diff(whole.breakpoints_s), whole.coefficients
    for order in range(3):
        powers = np.arange(6 - order)
        factors = [np.prod(np.arange(p + 1, p + order + 1)) for p in powers]
        ends = (pieces[:, :, order:] * factors * widths[:, None, None] ** powers).sum(axis=2)
        begins = pieces[:, :, order] * factors[0]
        assert np.abs(ends[:-1] - begins[1:]).max() < 1e-6


def require_limits(motions: list[Leg], motion: Blended) -> None:
    """Each motion's own, until the next begins: joints by differences, the TCP by pinocchio."""
    step_s = 2e-4
    times = np.arange(0.0, motion.trajectory.duration_s, step_s)
    rows = motion.trajectory.sample(times)
    rates = [np.diff(rows, order, axis=0) / step_s**order for order in (1, 2, 3)]
    speeds = np.linalg.norm(np.diff(second_robot().path(rows)[0], axis=0), axis=1) / step_s
    for leg, begin, end in zip(motions, [0.0, *motion.ends_s[:-1]], motion.ends_s, strict=True):
        inside = (times >= begin) & (times <= end - 4 * step_s)
        bounds = leg.limits.max_velocity, leg.limits.max_acceleration, leg.limits.max_jerk
        for rate, bound in zip(rates, bounds, strict=True):
            assert (np.abs(rate[inside[: len(rate)]]) / bound).max() <= 1.0 + 1e-6
        if leg.tcp is not None:
            assert speeds[inside[: len(speeds)]].max() <= leg.tcp.max_linear_velocity * (1.0 + 2e-3)


def require_path(motions: list[Leg], motion: Blended, radius_m: float) -> None:
    """Where the TCP leaves the path of the motions that stop, it is within the radius of a corner."""
    times = np.linspace(0.0, motion.trajectory.duration_s, 2000)
    positions, _ = second_robot().path(motion.trajectory.sample(times))
    corners = second_robot().path(np.array([leg.motion.end for leg in motions[:-1]]))[0]
    away = np.linalg.norm(positions[:, None] - corners, axis=2)
    assert away.min(axis=0).max() < radius_m, "a corner is passed outside its radius"
    stopping = np.concatenate(
        [leg.motion.sample(np.linspace(0.0, leg.motion.duration_s, LEG_SAMPLES)) for leg in motions]
    )
    tree = cKDTree(second_robot().path(stopping)[0])
    outside = positions[(away > radius_m).all(axis=1)]
    assert len(outside) > 500
    assert tree.query(outside)[0].max() <= 1e-4


@pytest.mark.parametrize("make", [square, mixed])
def test_it_goes_through_within_the_radius_and_within_the_limits_of_each_motion(
    robot: RobotDescription, make: object
) -> None:
    motions = make(robot)  # type: ignore[operator]
    motion = joined(robot, motions, [RADIUS_M] * (len(motions) - 1))
    assert all(motion.blended)
    assert min(motion.used_m) >= 0.99 * RADIUS_M
    assert max(motion.used_m) <= RADIUS_M
    assert motion.trajectory.duration_s < 0.95 * stopping_s(motions)
    assert motion.ends_s[-1] == motion.trajectory.duration_s
    np.testing.assert_allclose(motion.trajectory.end, motions[-1].motion.end, atol=1e-9)
    require_smooth(motion)
    require_limits(motions, motion)
    require_path(motions, motion, RADIUS_M)
    inner = np.linspace(0.02, 0.98, 500) * motion.trajectory.duration_s
    assert np.abs(np.diff(motion.trajectory.sample(inner), axis=0)).max(axis=1).min() > 0.0


def test_a_larger_radius_is_never_slower(robot: RobotDescription) -> None:
    motions = square(robot, 0.5)
    durations = [
        joined(robot, motions, [radius] * 2).trajectory.duration_s for radius in (0.0, 0.02, 0.05, 0.1)
    ]
    assert durations[0] == pytest.approx(stopping_s(motions))
    assert (np.diff(durations) < 0.0).all()


def test_a_corner_without_a_radius_is_a_stop(robot: RobotDescription) -> None:
    motion = joined(robot, square(robot), [0.0, RADIUS_M])
    assert motion.blended == (False, True)
    corner_s = motion.ends_s[0]
    np.testing.assert_allclose(motion.trajectory.sample(np.array([corner_s]), 1), 0.0, atol=1e-9)


@pytest.mark.parametrize("radius_m", [5e-324, 1e-308, 1e-17, 1e-12, 1e-6])
def test_a_radius_is_as_good_as_none_where_it_is_smaller_than_rounding(
    robot: RobotDescription, radius_m: float
) -> None:
    motions = square(robot)[:2]
    motion = joined(robot, motions, [radius_m])
    assert motion.used_m[0] <= radius_m
    assert motion.trajectory.duration_s == pytest.approx(stopping_s(motions), rel=1e-3)


def test_neighbours_share_what_lies_between_them(robot: RobotDescription) -> None:
    motions = square(robot)
    motion = joined(robot, motions, [0.5, 0.5])
    assert motion.blended == (True, True)
    assert "of its radius of 500 mm" in motion.trajectory.note
    require_path_ends(motions, motion)


def require_path_ends(motions: list[Leg], motion: Blended) -> None:
    assert max(motion.used_m) < 0.5
    np.testing.assert_allclose(motion.trajectory.start, motions[0].motion.start, atol=1e-12)
    np.testing.assert_allclose(motion.trajectory.end, motions[-1].motion.end, atol=1e-9)


def test_where_the_way_through_the_corner_touches_something_it_is_rounded_less_or_stops(
    robot: RobotDescription, tmp_path_factory: pytest.TempPathFactory
) -> None:
    motions = square(robot)
    free = joined(robot, motions[:2], [0.15])
    inside = second_robot().path(free.trajectory.sample(np.array([free.ends_s[0]])))[0][0]
    post = (*inside, 0.005, 0.005, 0.005)
    world = robot_in(changed_world(tmp_path_factory.mktemp("world"), post=post), robot)
    blocked = joined(world, motions[:2], [0.15])
    assert blocked.used_m[0] < 0.9 * free.used_m[0]
    assert "motion 1: " in blocked.trajectory.note


@pytest.mark.parametrize(
    ("radii", "message"),
    [
        ([0.05], r"radii: 3 motions have 2 corners, got 1 radii"),
        ([0.05, -0.1], r"radii\[1\]: is -0.1 m; it must be 0 or more"),
        ([float("nan"), 0.0], r"radii\[0\]: is nan m"),
    ],
)
def test_radii_that_make_no_sense_are_refused(
    robot: RobotDescription, radii: list[float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        joined(robot, square(robot), radii)


def test_nothing_lies_between_corners_that_are_as_near_as_looks(robot: RobotDescription) -> None:
    """Such a piece breaks no constraint."""
    box = Box(np.full(3, -2.0), np.full(3, 2.0))
    leg = square(robot, constraints=(Constraints(box=box), None, None))[0]
    first, between, last = _between(leg.motion, np.array([0.5, 0.5 + 1e-6]))
    assert (len(first) > 0, len(between), len(last) > 0) == (True, 0, True)
    assert not any(_breaks(robot, leg, rows) for rows in (first, between, last))


@pytest.mark.parametrize(
    ("below_m", "least_m", "most_m"), [(0.02, 0.0498, 0.05), (0.003, 0.01, 0.03), (0.0002, 0.0, 0.0)]
)
def test_a_corner_keeps_the_constraints_of_both_motions_each_up_to_its_middle(
    robot: RobotDescription, below_m: float, least_m: float, most_m: float
) -> None:
    """The first motion must not go down, where the second one leads."""
    place = robot.model.forward(START).position
    box = Box(place - np.array([0.3, 0.3, below_m]), place + 0.3)
    upright = Constraints(Cone(np.array([0.0, 0.0, 1.0]), 1e-3))
    motions = square(robot, constraints=(Constraints(box=box), upright, None))
    motion = joined(robot, motions, [RADIUS_M] * 2)
    assert least_m <= motion.used_m[0] <= most_m
    assert motion.used_m[1] > 0.0498
    told = "stops at its end" if most_m == 0.0 else "of its radius of 50 mm"
    assert (told in motion.trajectory.note) == (most_m < 0.05)
    times = np.linspace(0.0, motion.trajectory.duration_s, 4000)
    positions, turns = second_robot().path(motion.trajectory.sample(times))
    first = times < motion.ends_s[0]
    assert positions[first, 2].min() >= place[2] - below_m - 1e-4
    assert positions[:, 2].min() < place[2] - 0.1
    axes = turns[~first & (times < motion.ends_s[1])].apply([0.0, 0.0, 1.0])
    held = second_robot().path(motions[1].motion.start[None])[1].apply([0.0, 0.0, 1.0])
    assert np.arccos(np.clip(axes @ held[0], -1.0, 1.0)).max() <= 1e-3 + 1e-4
