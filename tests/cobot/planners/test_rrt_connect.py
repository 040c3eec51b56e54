"""The compiled search and what makes its paths shorter. Oracle: the properties that a path must have."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from running import WAIT_S
from samples import samples

from benchmarks import scenes
from cobot.motions.requests import MotionRequest
from cobot.planners.rrt_connect import connect
from cobot.planners.sampling import find_path, room
from cobot.planners.shortcut import shortened
from cobot.robot.description import RobotDescription
from cobot.types import Array, PlannerName, Scaling

SEED = 20261122
IN_THE_FLOOR = np.array([0.0, 1.9, 0.0, -0.2, 0.0, 0.0, 0.0])


def test_shortening_keeps_the_ends_gets_no_longer_and_stays_free(robot: RobotDescription) -> None:
    limits = robot.limits
    for number, problem in enumerate(scenes.problems(robot, "shelf", 3, SEED)):
        clearance = problem.robot.collision.clearance
        bounds = limits.min_position, limits.max_position
        corners = connect(clearance, problem.start, problem.goal[None], *bounds, number, WAIT_S, 0.5)
        assert corners is not None
        short = shortened(clearance, corners, number)
        assert np.array_equal(short[[0, -1]], np.array([problem.start, problem.goal]))
        before, after = (np.linalg.norm(np.diff(way, axis=0), axis=1) for way in (corners, short))
        assert after.sum() < 0.9 * before.sum()
        assert before.max() <= 0.5 + 1e-9, "no node is further away than that"
        assert all(clearance.is_edge_free(*pair) for pair in pairwise(short))


def test_a_path_is_found_to_the_goal_that_can_be_reached(robot: RobotDescription) -> None:
    problem = next(scenes.problems(robot, "table", 1, SEED))
    limits, clearance = robot.limits, problem.robot.collision.clearance
    inside = IN_THE_FLOOR
    assert not clearance.is_free(inside)
    bounds = limits.min_position, limits.max_position
    corners = connect(clearance, problem.start, np.array([inside, problem.goal]), *bounds, 1, WAIT_S, 2.0)
    assert corners is not None
    assert np.array_equal(corners[-1], problem.goal)
    assert connect(clearance, problem.start, inside[None], *bounds, 1, WAIT_S, 2.0, attempts=200) is None


@pytest.mark.parametrize("kind", scenes.KINDS)
def test_a_path_makes_no_detour(robot: RobotDescription, kind: str) -> None:
    limits = robot.limits
    for problem in scenes.problems(robot, kind, 2, SEED):
        request = MotionRequest(problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=WAIT_S)
        planned = find_path(problem.robot, request, problem.goal[None])
        ends = np.array([problem.start, problem.goal])
        best = np.inf
        with problem.robot.collision.keeping(room(problem.robot, ends)) as clearance:
            for seed in range(samples(60)):
                bounds = limits.min_position, limits.max_position
                corners = connect(clearance, ends[0], ends[1:], *bounds, seed, WAIT_S, 0.5)
                assert corners is not None
                best = min(best, length(shortened(clearance, corners, seed)))
        assert length(planned) <= 1.3 * best, problem.name


def length(corners: Array) -> float:
    return float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())


def test_what_is_not_finite_is_refused(robot: RobotDescription) -> None:
    clearance, bounds = robot.collision.clearance, (robot.limits.min_position, robot.limits.max_position)
    with pytest.raises(ValueError, match="not finite"):
        connect(clearance, np.full(7, np.nan), np.zeros((1, 7)), *bounds, 1, 1.0, 2.0)
    with pytest.raises(ValueError, match="finite corners, at least two"):
        shortened(clearance, np.zeros((1, 7)), 1)
