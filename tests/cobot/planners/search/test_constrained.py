"""Motions that keep a tool upright, the TCP in a box, joints in ranges. Oracle: pinocchio's TCP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cobot_run import WAIT_S
from independent_models import largest_rates, rate_limits, second_robot
from scipy.spatial.transform import Rotation
from thorough import few

from benchmarks.planning.scenes import problems
from cobot.errors import InputError, PlanningError, PlanningTimeout
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.planners import MotionRequest, plan
from cobot.planners.held import ALLOWANCE, Held
from cobot.planners.projection import Projection
from cobot.planners.search.constrained import _Steps
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse_all
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

FULL = Scaling(1.0)
Z = np.array([0.0, 0.0, 1.0])


def asked(
    robot: RobotDescription, goal: Array | Pose, constraints: Constraints, **more: object
) -> MotionRequest:
    named = {
        "start": np.array(robot.positions["work"].joints),
        "planner": PlannerName.OMPL,
        "timeout_s": WAIT_S,
    }
    named |= more
    return MotionRequest(goal=goal, scaling=FULL, constraints=constraints, **named)  # type: ignore[arg-type]


def tilts(motion: Trajectory, direction: Array) -> Array:
    """Of the TCP's z from a direction, rad."""
    _, turns = second_robot().path(motion.sample(np.linspace(0.0, motion.duration_s, 2000)))
    return np.asarray(np.arccos(np.clip(turns.apply(Z) @ direction, -1.0, 1.0)))


def work(robot: RobotDescription) -> Pose:
    return robot.model.forward(np.array(robot.positions["work"].joints))


@pytest.mark.parametrize(("kind", "within_rad"), few([("table", 0.1), ("shelf", 0.02), ("bin", 0.1)]))
def test_a_glass_of_water_is_carried_through_clutter(
    robot: RobotDescription, kind: str, within_rad: float
) -> None:
    spilt = []
    for problem in problems(robot, kind, 2, seed=7):
        there = problem.robot
        goal = Pose(problem.pose.position, there.model.forward(problem.start).quaternion)
        request = asked(there, goal, Constraints(Cone(Z, within_rad)), start=problem.start, seed=3)
        motion, free = plan(there, request), plan(there, replace(request, constraints=None))
        assert motion is not None
        assert free is not None
        direction = second_robot().path(problem.start[None])[1].apply(Z)[0]
        assert tilts(motion, direction).max() <= within_rad + ALLOWANCE
        assert (largest_rates(motion) / rate_limits(there.limits)).max() <= 1.0 + 1e-6
        assert second_robot().path(motion.end[None])[0][0] == pytest.approx(goal.position, abs=1e-6)
        if not spilt:
            again = plan(there, request)
            assert again is not None
            assert again.coefficients.tobytes() == motion.coefficients.tobytes()
        spilt.append(tilts(free, direction).max() > within_rad)
    assert any(spilt), "or nothing had to be kept upright"


def test_a_glass_of_water_gets_out_of_a_shelf_that_leaves_little_room(robot: RobotDescription) -> None:
    # The start's tree had 26 places after 2,000 attempts, when both grew in turn towards any configuration.
    problem = list(problems(robot, "shelf", 2))[1]
    there, start = problem.robot, problem.start
    goal = Pose(problem.pose.position, there.model.forward(start).quaternion)
    motion = plan(there, asked(there, goal, Constraints(Cone(Z, 0.1)), start=start))
    assert motion is not None
    assert tilts(motion, second_robot().path(start[None])[1].apply(Z)[0]).max() <= 0.1 + ALLOWANCE


def test_a_box_and_ranges_of_joints_are_kept_too(robot: RobotDescription) -> None:
    here = work(robot)
    low, high = here.position - [0.05, 0.6, 0.02], here.position + np.array([0.2, 0.6, 0.25])
    goal = Pose(here.position + np.array([0.0, 0.4, 0.05]), here.quaternion)
    constraints = Constraints(box=Box(low, high), joints=((2, -0.3, 0.3), (6, -0.5, 0.6)))
    motion = plan(robot, asked(robot, goal, constraints))
    assert motion is not None
    rows = motion.sample(np.linspace(0.0, motion.duration_s, 2000))
    places, _ = second_robot().path(rows)
    assert (places >= low - ALLOWANCE).all()
    assert (places <= high + ALLOWANCE).all()
    assert np.abs(rows[:, 2]).max() <= 0.3 + ALLOWANCE
    assert rows[:, 6].min() >= -0.5 - ALLOWANCE
    assert rows[:, 6].max() <= 0.6 + ALLOWANCE


def swing(robot: RobotDescription, planner: str) -> MotionRequest:
    """From the right to the left, for which the TCP may not go as far ahead as a swing would."""
    start, goal = np.array([robot.positions["work"].joints] * 2)
    start[0], goal[0] = -0.9, 0.9
    most = work(robot).position[0] - 0.02
    box = Box(np.array([-1.0, -1.0, 0.0]), np.array([most, 1.0, 1.5]))
    return asked(robot, goal, Constraints(box=box), start=start, planner=PlannerName(planner))


@pytest.mark.parametrize("planner", ["ptp", "chomp"])
def test_motions_of_others_are_refused_where_they_break_it(robot: RobotDescription, planner: str) -> None:
    message = (
        r"^(ptp|chomp): the motion violates constraints from [34]\d % of its time on; the largest violation "
        r"is after 5\d % "
        r"\([\d.]+ s\): constraints\.box: the TCP's x is 0\.6\d+ m, allowed: -1 to 0\.5\d+ m$"
    )
    with pytest.raises(PlanningError, match=message):
        plan(robot, swing(robot, planner))


def test_auto_takes_ompl_where_ptp_breaks_it(robot: RobotDescription) -> None:
    request = swing(robot, "auto")
    motion = plan(robot, request)
    assert motion is not None
    assert motion.note.startswith("auto used ompl")
    places, _ = second_robot().path(motion.sample(np.linspace(0.0, motion.duration_s, 2000)))
    assert request.constraints is not None
    assert request.constraints.box is not None
    assert places[:, 0].max() <= request.constraints.box.high[0] + ALLOWANCE


def test_lin_turns_the_tool_no_further_than_it_may(robot: RobotDescription) -> None:
    here = work(robot)
    tilted = Rotation.from_quat(here.quaternion, scalar_first=True) * Rotation.from_rotvec([0.2, 0.0, 0.0])
    goal = Pose(here.position + np.array([0.0, 0.1, 0.0]), tilted.as_quat(scalar_first=True))
    for within_rad, kept in ((0.25, True), (0.15, False)):
        request = asked(robot, goal, Constraints(Cone(Z, within_rad)), planner=PlannerName.LIN)
        if kept:
            assert plan(robot, request) is not None
        else:
            with pytest.raises(PlanningError, match=r"is 0\.2 rad from its direction, allowed: 0\.15 rad"):
                plan(robot, request)


def test_the_way_out_of_a_collision_keeps_the_constraints_of_the_start_or_is_refused(
    robot: RobotDescription,
) -> None:
    start = np.array([0.0, 1.9, 0.0, -0.2, 0.0, 0.0, 0.0])  # in the floor
    goal = start + np.array([0.5, -0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    here = robot.model.forward(start).position
    narrow = Constraints(box=Box(here - np.array([2.0, 2.0, 0.02]), here + np.array([2.0, 2.0, 0.02])))
    request = MotionRequest(start, goal, PlannerName.OMPL, Scaling(1.0), constraints=narrow)
    with pytest.raises(
        PlanningError, match=r"the TCP's z is .*; the escape from the start: the start is in coll"
    ):
        plan(robot, request)
    cone = Constraints(Cone(np.array([0.0, 0.0, 1.0]), 0.8))
    motion = plan(robot, replace(request, constraints=cone))
    assert motion is not None
    axes = (
        second_robot().path(motion.sample(np.linspace(0.0, motion.duration_s, 200)))[1].apply([0.0, 0.0, 1.0])
    )
    assert np.arccos(np.clip(axes @ axes[0], -1.0, 1.0)).max() <= 0.8 + 1e-3


def test_a_start_or_goal_that_breaks_it_and_what_cannot_be_kept_are_said(robot: RobotDescription) -> None:
    joints = np.array(robot.positions["work"].joints)
    away = joints + np.eye(7)[0] * 0.5
    for constraints, message in (
        (
            Constraints(Cone(Z, 0.1, Z)),
            "the start violates constraints.orientation: the tool's axis is 3.142 rad",
        ),
        (
            Constraints(joints=((0, -0.1, 0.4),)),
            "the goal, .*joint1 is at 0.5 rad, allowed: -0.1 to 0.4 rad",
        ),
    ):
        with pytest.raises(PlanningError, match=message):
            plan(robot, asked(robot, away, constraints))
    wall = Constraints(joints=((0, -0.1, 0.6), (1, joints[1] - 1e-3, joints[1] + 1e-3)))
    goal = away.copy()
    goal[3] += 0.5
    assert plan(robot, asked(robot, goal, wall)) is not None
    narrow = Constraints(Cone(Z, 0.05), Box(work(robot).position - 0.02, work(robot).position + 0.02))
    found = inverse_all(robot.model, work(robot), joints, spread=8)
    other_wrist = next(each for each in found if each[5] < -0.3)  # between them the tool leans
    with pytest.raises(
        PlanningTimeout, match=r"no free path that keeps the constraints within 0.3 s \(\d+ and"
    ):
        plan(robot, asked(robot, other_wrist, narrow, timeout_s=0.3))
    with pytest.raises(InputError, match="constraints: PRM does not support them; use algorithm RRTConnect"):
        plan(robot, asked(robot, away, wall, algorithm="PRM"))


def test_a_projected_configuration_keeps_all_or_there_is_none(robot: RobotDescription) -> None:
    """Property: over random configurations, boxes and cones."""
    random, limits = np.random.default_rng(5), robot.limits
    found = 0
    for _ in range(300):
        start = random.uniform(limits.min_position, limits.max_position)
        place = robot.model.forward(start).position
        size = random.uniform(0.01, 0.5, 3)
        constraints = Constraints(
            Cone(Z, random.uniform(0.01, 1.0)),
            Box(place - size, place + size),
            ((3, *sorted(random.uniform(-2, 2, 2))),),
        )
        held = Held(robot, constraints, start)
        joints = held.project(random.uniform(limits.min_position, limits.max_position))
        if joints is not None:
            found += 1
            assert held.excess(joints[None]).max() <= 0.0
            assert held.keeps(joints)
    assert found > 100


def test_a_projection_without_constraints_brings_the_joints_into_their_ranges(
    robot: RobotDescription,
) -> None:
    """Oracle: numpy's clip. NaN is in no range."""
    limits = robot.limits
    low, high = 0.5 * limits.min_position, 0.5 * limits.max_position
    projection = Projection(robot.model.chain, low, high, None, None, 0.0, 0.0)
    given = np.random.default_rng(6).uniform(limits.min_position, limits.max_position)
    assert not projection.keeps(given)
    assert not projection.keeps(np.full(limits.dof, np.nan))
    np.testing.assert_array_equal(projection.project(given), given.clip(low, high))


def test_a_tool_that_points_the_opposite_way_is_turned_into_its_cone(robot: RobotDescription) -> None:
    """Newton's method has no direction of its own there. The oracle is the angle from the poses."""
    start = np.array([0.3, 0.7, 0.1, -1.2, 0.2, 0.9, 0.0])
    axis = robot.model.chain.solve(start)[1] @ Z
    held = Held(robot, Constraints(Cone(Z, 0.3, -axis)), start)
    assert not held.keeps(start)
    joints = held.project(start)
    assert joints is not None
    assert held.keeps(joints)
    assert held.excess(joints[None]).max() <= 0.0
    assert not held.keeps(robot.limits.max_position + 0.1)


def test_steps_towards_a_target_follow_their_law(robot: RobotDescription) -> None:
    """Oracle: the law in Python, with the single projections and the single edges."""
    random, limits, step_rad = np.random.default_rng(7), robot.limits, 0.15
    start = np.array(robot.positions["work"].joints)
    clearance = robot.collision.clearance
    held = Held(robot, Constraints(Cone(Z, 0.2)), start)

    def is_step(begin: Array, end: Array) -> bool:
        short, middle = np.linalg.norm(end - begin) <= 3.0 * step_rad, 0.5 * (begin + end)
        return bool(short) and held.keeps(middle) and clearance.is_edge_free(begin, end)

    def law(here: Array, target: Array) -> tuple[list[Array], bool]:
        places: list[Array] = []
        while (left := np.linalg.norm(target - here)) > step_rad:
            place = held.project(here + (target - here) * (step_rad / left))
            if place is None or np.linalg.norm(target - place) > left - 0.2 * step_rad:
                return places, False
            if not is_step(here, place):
                return places, False
            here = place
            places.append(here)
        arrives = held.keeps(target) and is_step(here, target)
        return ([*places, target] if arrives else places), arrives

    lengths, arrivals = set(), []
    for number in range(200):
        target = random.uniform(limits.min_position, limits.max_position)
        near = held.project(start + 0.3 * random.normal(size=limits.dof)) if number % 2 else None
        target = target if near is None else near
        places, arrived = held.projection.steps_toward(clearance, start, target, step_rad)
        expected, arrives = law(start, target)
        assert arrived == arrives
        np.testing.assert_allclose(np.array(places), np.array(expected), rtol=0.0, atol=1e-9)
        lengths.add(len(places))
        arrivals.append(arrived)
    assert len(lengths) > 4
    assert 10 < sum(arrivals) < 190
    assert held.projection.steps_toward(clearance, start, start, step_rad) == ([], True)


def test_a_found_path_is_not_shortened_or_evened_out_after_the_time_of_the_request(
    robot: RobotDescription,
) -> None:
    start, goal = (np.array(robot.positions[name].joints) for name in ("work", "home"))
    request = asked(robot, goal, Constraints(Cone(Z, np.pi)), timeout_s=0.0)
    assert request.constraints is not None
    clearance = robot.collision.clearance
    steps = _Steps(Held(robot, request.constraints, start), clearance, request)
    way = [start, 0.5 * (start + goal) + 0.1, goal]
    before = clearance.evaluations
    assert steps._shorten(list(way)) == way
    assert clearance.evaluations == before
    steps.even_out(way)
    without_time = clearance.evaluations - before
    _Steps(Held(robot, request.constraints, start), clearance, replace(request, timeout_s=WAIT_S)).even_out(
        way
    )
    assert clearance.evaluations - before > 5 * without_time
