"""Motions that are joined to one which is under way.

Oracle: rtloop's own check of what may replace a motion; the same motions joined before the arm moves, and
with stops; pinocchio for where the TCP is; differences of samples for what each joint does.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest
from independent_models import changed_world, robot_in, second_robot

from cobot.errors import InputError
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.motions.requests import Envelope, MotionRequest, RatedMove
from cobot.motions.stretches import Leg, Stretch, single_leg
from cobot.planners.blending.going_over import JERK
from cobot.planners.blending.joined import joined
from cobot.planners.blending.prolonged import begin_stretch, extend_stretch
from cobot.planners.rated import plan_rated
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling
from rtloop.planned.path import Path

FULL = Scaling(1.0)

START = np.array([0.0, 0.5, 0.0, -1.3, 0.0, 1.34, 0.0])
RADIUS_M = 0.05
LEAD_S = 0.2
ROUNDING = 1.0 + 1e-6


def leg(robot: RobotDescription, start: Array, goal: Array | Pose, v: float, a: float) -> Leg:
    planner = PlannerName.LIN if isinstance(goal, Pose) else PlannerName.PTP
    envelope = Envelope(robot.limits, robot.cartesian_limits)
    found = plan_rated(robot, RatedMove(MotionRequest(start, goal, planner, FULL), v, a, envelope))
    assert found is not None
    return found


def off(robot: RobotDescription, x: float, y: float, z: float) -> Pose:
    here = robot.model.forward(START)
    return Pose(here.position + np.array([x, y, z]), here.quaternion)


def lines(robot: RobotDescription, v: float = 0.2) -> list[Leg]:
    made, start = [], START
    for way in ((0.05, 0.2, 0.0), (0.05, 0.2, -0.2), (0.05, -0.2, -0.2)):
        made.append(leg(robot, start, off(robot, *way), v, 1.2))
        start = made[-1].motion.end
    return made


def mixed(robot: RobotDescription) -> list[Leg]:
    first = leg(robot, START, START + np.array([0.6, 0.2, 0.0, 0.2, 0.0, -0.3, 0.0]), 0.5, 2.0)
    second = leg(robot, first.motion.end, off(robot, 0.05, 0.2, -0.1), 0.2, 1.2)
    third = leg(robot, second.motion.end, START, 0.4, 1.5)
    return [first, second, third]


def taken_by_rtloop(before: Trajectory, after: Stretch, now_s: float, until_s: float) -> bool:
    """What rtloop says at a path time, while a change of the rate relies on the path until another."""
    paths = []
    for trajectory in (before, after.trajectory):
        path = Path(trajectory.segments, trajectory.dof)
        path.breakpoints_s[:] = trajectory.breakpoints_s
        path.coefficients[:] = trajectory.coefficients
        path.begin(trajectory.segments)
        paths.append(path)
    here_s = now_s - after.offset_s
    return bool(paths[1].continues(paths[0], after.offset_s, here_s, until_s - after.offset_s))


def one_by_one(
    robot: RobotDescription, legs: list[Leg], radii_m: list[float]
) -> tuple[Stretch, list[Stretch], Trajectory]:
    """Each leg comes while the arm moves along the one before: the last stretch, all, what was followed."""
    stretch = begin_stretch(robot, legs[:1], radii_m[:1])
    every, followed, passed_s = [stretch], stretch.trajectory, 0.0
    for each, radius in zip(legs[1:], radii_m[1:], strict=True):
        now_s = stretch.valid_s + 0.01
        longer = extend_stretch(robot, stretch, [each], [radius], now_s, now_s + LEAD_S)
        assert taken_by_rtloop(stretch.trajectory, longer, now_s, now_s + LEAD_S - 0.02)
        passed_s += longer.offset_s
        index = int(np.argmin(np.abs(followed.breakpoints_s - passed_s)))
        assert abs(followed.breakpoints_s[index] - passed_s) < 1e-9
        followed = Trajectory(
            np.concatenate([followed.breakpoints_s[:index], passed_s + longer.trajectory.breakpoints_s]),
            np.concatenate([followed.coefficients[:index], longer.trajectory.coefficients]),
        )
        stretch = longer
        every.append(stretch)
    return stretch, every, followed


def require_limits(robot: RobotDescription, legs: list[Leg], motion: Trajectory) -> None:
    """The largest of all legs: joints by differences, the TCP by pinocchio."""
    step_s = 2e-4
    rows = motion.sample(np.arange(0.0, motion.duration_s, step_s))
    names = ("max_velocity", "max_acceleration", "max_jerk")
    bounds = [np.max([getattr(each.limits, name) for each in legs], axis=0) for name in names]
    for order, bound in enumerate((*bounds[:2], JERK * bounds[2]), start=1):
        rate = np.abs(np.diff(rows, order, axis=0)) / step_s**order
        assert (rate / bound).max() <= ROUNDING + 1e-5
    assert (bounds[2] * JERK < robot.limits.max_jerk).all()
    if all(each.tcp for each in legs):
        speed = np.linalg.norm(np.diff(second_robot().path(rows)[0], axis=0), axis=1) / step_s
        assert speed.max() <= max(each.tcp.max_linear_velocity for each in legs if each.tcp) * (1.0 + 2e-3)


def require_corners(legs: list[Leg], motion: Trajectory) -> None:
    times = np.linspace(0.0, motion.duration_s, 3000)
    places = second_robot().path(motion.sample(times))[0]
    for each in legs[:-1]:
        corner = second_robot().path(each.motion.end[None])[0][0]
        assert 1e-3 < np.linalg.norm(places - corner, axis=1).min() < RADIUS_M


@pytest.mark.parametrize("make", [lines, mixed])
def test_motions_that_come_while_the_arm_moves_are_joined_without_a_stop(
    robot: RobotDescription, make: object
) -> None:
    legs = make(robot)  # type: ignore[operator]
    radii = [*[RADIUS_M] * (len(legs) - 1), 0.0]
    last, every, followed = one_by_one(robot, legs, radii)
    for stretch in every[1:]:
        assert stretch.used_m[0] > 0.9 * RADIUS_M
    at_once = joined(robot, legs, radii[:-1]).trajectory.duration_s
    assert followed.duration_s < min(1.03 * at_once, 0.97 * sum(each.motion.duration_s for each in legs))
    np.testing.assert_allclose(followed.end, legs[-1].motion.end, atol=1e-9)
    require_limits(robot, legs, followed)
    require_corners(legs, followed)
    assert list(last.ends_s) == sorted(last.ends_s)
    assert last.ends_s[-1] == pytest.approx(last.trajectory.duration_s)
    assert len(last.ends_s) == len(legs)


def test_several_motions_may_come_at_once_with_stops_among_them(robot: RobotDescription) -> None:
    legs = lines(robot)
    first = begin_stretch(robot, legs[:1], [RADIUS_M])
    longer = extend_stretch(robot, first, legs[1:], [0.0, 0.0], 0.01, 0.2)
    assert longer.used_m[0] > 0.9 * RADIUS_M
    assert longer.used_m[1] == 0.0
    corner_s = longer.ends_s[1]
    np.testing.assert_allclose(longer.trajectory.sample([corner_s], 1), 0.0, atol=1e-9)
    np.testing.assert_allclose(longer.trajectory.sample([corner_s])[0], legs[1].motion.end, atol=1e-9)
    np.testing.assert_allclose(longer.trajectory.end, legs[2].motion.end, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_random_chains_of_joint_moves_keep_all_limits_and_what_has_been_handed_over(
    robot: RobotDescription, seed: int
) -> None:
    random = np.random.default_rng(seed)
    legs, here = [], START
    for _ in range(4):
        goal = START + random.uniform(-0.4, 0.4, 7)
        legs.append(leg(robot, here, goal, random.uniform(0.2, 1.5), random.uniform(0.5, 8.0)))
        here = goal
    radii = [float(random.choice([0.0, 0.05, 0.2])) for _ in range(3)]
    _, every, followed = one_by_one(robot, legs, [*radii, 0.0])
    for stretch, radius in zip(every[1:], radii, strict=True):
        assert 0.0 <= stretch.used_m[0] <= radius
    require_limits(robot, legs, followed)
    np.testing.assert_allclose(followed.end, here, atol=1e-9)


def test_one_that_comes_late_follows_after_a_stop_that_takes_no_time(robot: RobotDescription) -> None:
    legs = lines(robot)[:2]
    first = begin_stretch(robot, legs[:1], [RADIUS_M])
    late_s = first.trajectory.duration_s - 0.1
    longer = extend_stretch(robot, first, legs[1:], [0.0], late_s, late_s + 0.05)
    assert longer.used_m == (0.0,)
    assert longer.trajectory.duration_s == pytest.approx(
        first.trajectory.duration_s + legs[1].motion.duration_s - longer.offset_s
    )
    assert taken_by_rtloop(first.trajectory, longer, late_s, first.trajectory.duration_s)
    np.testing.assert_allclose(longer.trajectory.sample([longer.ends_s[0]], 1), 0.0, atol=1e-9)


def test_a_single_motion_without_a_radius_is_what_was_planned(robot: RobotDescription) -> None:
    only = lines(robot)[0]
    assert single_leg(only).trajectory is only.motion
    np.testing.assert_array_equal(
        begin_stretch(robot, [only], [0.0]).trajectory.coefficients, single_leg(only).trajectory.coefficients
    )
    after = extend_stretch(robot, single_leg(only), lines(robot)[1:2], [0.0], 0.0, 0.2)
    assert after.ends_s[0] == only.motion.duration_s


def test_a_motion_with_a_duration_takes_it_also_between_others(robot: RobotDescription) -> None:
    legs = lines(robot)
    envelope = Envelope(robot.limits, robot.cartesian_limits)
    goal = off(robot, 0.05, 0.2, -0.2)
    slow = plan_rated(
        robot,
        RatedMove(
            MotionRequest(legs[0].motion.end, goal, PlannerName.LIN, FULL),
            -1.0,
            -1.0,
            envelope,
            duration_s=6.0,
        ),
    )
    assert slow is not None
    assert slow.motion.duration_s == pytest.approx(6.0)
    stretch = begin_stretch(robot, [legs[0], slow, legs[2]], [RADIUS_M, RADIUS_M, 0.0])
    assert min(stretch.used_m[1:]) > 0.9 * RADIUS_M
    assert 4.5 < stretch.ends_s[1] - stretch.ends_s[0] < 6.3


def test_where_the_way_through_the_corner_touches_something_it_is_rounded_less_or_stops(
    robot: RobotDescription, tmp_path: File
) -> None:
    legs = [leg(robot, START, off(robot, 0.0, 0.3, 0.0), 0.2, 1.2)]
    legs.append(leg(robot, legs[0].motion.end, off(robot, 0.0, 0.3, -0.3), 0.2, 1.2))

    def motion(world: RobotDescription) -> Stretch:
        return extend_stretch(world, begin_stretch(world, legs[:1], [0.15]), legs[1:], [0.0], 0.0, 0.1)

    free = motion(robot)
    inside = second_robot().path(free.trajectory.sample([free.ends_s[0]]))[0][0]
    world = changed_world(tmp_path, post=(*inside, 0.005, 0.005, 0.005))
    careful = motion(robot_in(world, robot))
    assert careful.used_m[0] < 0.9 * free.used_m[0]


def test_a_corner_keeps_the_constraints_of_both_motions_each_up_to_its_middle(
    robot: RobotDescription,
) -> None:
    """The motion under way must not go down, where the one that follows leads, with its tool upright."""
    place = robot.model.forward(START).position

    def not_below(height_m: float) -> Constraints:
        return Constraints(box=Box(np.array([-2.0, -2.0, height_m]), np.full(3, 2.0)))

    lowest_m, upright = place[2] - 0.003, Constraints(Cone(np.array([0.0, 0.0, 1.0]), 1e-3))
    kept = not_below(lowest_m), upright, None
    legs = [replace(each, constraints=keeps) for each, keeps in zip(lines(robot), kept, strict=True)]
    last, every, followed = one_by_one(robot, legs, [RADIUS_M, RADIUS_M, 0.0])
    assert 0.01 < every[1].used_m[0] < 0.03
    assert every[2].used_m[0] > 0.9 * RADIUS_M
    ends = followed.duration_s - last.trajectory.duration_s + np.array(last.ends_s)
    times = np.linspace(0.0, followed.duration_s, 4000)
    positions, turns = second_robot().path(followed.sample(times))
    assert positions[times < ends[0], 2].min() >= lowest_m - 1e-4
    assert positions[:, 2].min() < place[2] - 0.1
    axes = turns[(times >= ends[0]) & (times < ends[1])].apply([0.0, 0.0, 1.0])
    before = second_robot().path(legs[1].motion.start[None])[1].apply([0.0, 0.0, 1.0])[0]
    assert np.arccos(np.clip(axes @ before, -1.0, 1.0)).max() <= 1e-3 + 1e-4
    level = replace(legs[0], constraints=not_below(place[2] - 0.0002))
    assert extend_stretch(
        robot, begin_stretch(robot, [level], [RADIUS_M]), legs[1:2], [0.0], 0.0, 0.2
    ).used_m == (0.0,)


def test_radii_that_do_not_fit_the_motions_are_refused(robot: RobotDescription) -> None:
    legs = lines(robot)
    with pytest.raises(InputError, match="radii: 3 motions have 2 corners, got 1 radii"):
        begin_stretch(robot, legs, [RADIUS_M, 0.0])
    with pytest.raises(InputError, match=r"radii\[0\]: is -0.1 m"):
        extend_stretch(robot, begin_stretch(robot, legs[:1], [0.0]), legs[1:], [-0.1, 0.0], 0.0, 0.1)
