"""Faster motions within planning time.

Oracles: Ruckig's time for each joint alone as the lower bound; the checks of all plans, and distances of
dense samples by the exact collision checker; equal numbers of tries for equal results.
"""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import ruckig

from cobot.motions.constraints import Constraints
from cobot.motions.improving import Improving, Planned, PlanQuality
from cobot.motions.requests import MotionRequest
from cobot.planners import plan, validated
from cobot.planners.search.improve import begin, improve
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject
from cobot.types import Array, PlannerName, Scaling

TRIES = 60
SCALING = Scaling(0.7)


@pytest.fixture(scope="module")
def walled(robot: RobotDescription) -> RobotDescription:
    """The arm with a wall between start and goal."""
    wall = SceneObject("box", (0.6, 0.04, 0.85), (0.55, 0.0, 0.425, 1.0, 0.0, 0.0, 0.0))
    scene = Scene(version=1, objects={"wall": wall})
    return replace(robot, collision=robot.collision.among(scene))


def asked(robot: RobotDescription, planner: PlannerName = PlannerName.OMPL) -> MotionRequest:
    start = np.array(robot.positions["home"].joints)
    start[:2] = -0.8, 0.5
    goal = start + 1.6 * np.eye(7)[0]
    return MotionRequest(start, goal, planner, SCALING)


def slowest_alone_s(robot: RobotDescription, start: Array, goal: Array) -> float:
    limits, times = robot.limits.scaled(*SCALING.shares), []
    for joint in range(limits.dof):
        problem, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
        problem.current_position, problem.target_position = [start[joint]], [goal[joint]]
        problem.max_velocity = [limits.max_velocity[joint]]
        problem.max_acceleration = [limits.max_acceleration[joint]]
        problem.max_jerk = [limits.max_jerk[joint]]
        ruckig.Ruckig(1).calculate(problem, found)
        times.append(found.duration)
    return float(max(times))


@pytest.fixture(scope="module")
def improved(walled: RobotDescription) -> tuple[MotionRequest, Improving, Improving]:
    request = asked(walled)
    first = plan(walled, request)
    assert first is not None
    state = begin(walled, request, first)
    return request, state, improve(walled, request, state, np.inf, TRIES)


def test_the_motion_gets_faster_and_stays_checked(
    walled: RobotDescription, improved: tuple[MotionRequest, Improving, Improving]
) -> None:
    request, before, after = improved
    assert before.quality is PlanQuality.FIRST
    assert after.best.duration_s < 0.97 * before.first_duration_s == 0.97 * before.best.duration_s
    assert 0 < after.improvements <= after.tries <= TRIES
    validated(walled, request, after.best)
    np.testing.assert_allclose([after.best.start, after.best.end], [request.start, request.goal], atol=1e-9)
    rows = after.best.sample(np.linspace(0.0, after.best.duration_s, 2000))
    assert walled.collision.clearance.distances(rows, 0.1).min() >= walled.collision.margin_m - 5.1e-4


def test_the_lower_bound_is_that_of_the_slowest_joint(
    walled: RobotDescription, improved: tuple[MotionRequest, Improving, Improving]
) -> None:
    request, _, after = improved
    assert isinstance(request.goal, np.ndarray)
    bound_s = slowest_alone_s(walled, request.start, request.goal)
    assert after.lower_bound_s == pytest.approx(bound_s, rel=1e-6)
    assert after.best.duration_s >= bound_s
    assert (after.quality is PlanQuality.FINAL) == (after.best.duration_s <= 1.01 * bound_s)


def test_the_same_number_of_tries_gives_the_same_motion_however_it_is_divided(
    walled: RobotDescription, improved: tuple[MotionRequest, Improving, Improving]
) -> None:
    request, state, whole = improved
    while state.tries < TRIES and not state.done:
        state = improve(walled, request, pickle.loads(pickle.dumps(state)), np.inf, 7 if state.tries else 4)
    assert state.tries == whole.tries
    assert (state.best.coefficients == whole.best.coefficients).all()


def test_time_ends_the_search_not_tries(
    walled: RobotDescription, improved: tuple[MotionRequest, Improving, Improving]
) -> None:
    """Each look at the clock takes 10 ms here."""
    request, state, _ = improved
    ticks = itertools.count()
    clock: Callable[[], float] = lambda: 0.01 * next(ticks)  # noqa: E731
    after = improve(walled, request, state, 0.05, clock=clock)
    assert after.tries == 5
    assert after.spent_s == pytest.approx(0.05)
    assert improve(walled, request, state, 0.0) is state


def test_auto_takes_a_direct_motion_to_a_faster_position_of_the_goal(robot: RobotDescription) -> None:
    request = asked(robot, PlannerName.AUTO)
    slow = plan(robot, replace(request, scaling=Scaling(0.2)))
    assert slow is not None
    after = improve(robot, request, begin(robot, request, slow), np.inf, 1)
    direct = plan(robot, replace(request, planner=PlannerName.PTP))
    assert direct is not None
    assert after.quality is PlanQuality.FINAL
    assert after.best.duration_s == pytest.approx(direct.duration_s, rel=1e-9)
    assert after.best.note == "auto used ptp: the direct joint motion is free"


def test_constraints_are_kept(walled: RobotDescription) -> None:
    request = asked(walled)
    held = replace(request, constraints=Constraints(joints=((3, -1.75, -1.1),)))
    first = plan(walled, held)
    assert first is not None
    after = improve(walled, held, begin(walled, held, first), np.inf, 30)
    places = after.best.sample(np.linspace(0.0, after.best.duration_s, 500))[:, 3]
    assert -1.75 - 1e-4 <= places.min() <= places.max() <= -1.1 + 1e-4


def test_a_motion_that_leaves_a_collision_is_not_improved(robot: RobotDescription) -> None:
    request = asked(robot)
    place = robot.model.forward(request.start).position
    ball = SceneObject("sphere", (0.05,), (*place, 1.0, 0.0, 0.0, 0.0))
    there = replace(robot, collision=robot.collision.among(Scene(version=1, objects={"ball": ball})))
    first = plan(there, request)
    assert first is not None
    assert "first takes the shortest way out" in first.note
    state = begin(there, request, first)
    assert state.done
    assert improve(there, request, state, 1.0) is state


def test_planners_without_a_choice_are_final(robot: RobotDescription) -> None:
    for planner, quality in (
        (PlannerName.PTP, PlanQuality.FINAL),
        (PlannerName.OMPL, PlanQuality.FIRST),
        (PlannerName.AUTO, PlanQuality.FIRST),
    ):
        request = asked(robot, planner)
        assert Planned.of(request, plan(robot, request)).quality is quality
    assert Planned.of(asked(robot), None).quality is PlanQuality.FINAL
