"""The compiled search and what makes its paths shorter. Oracle: the properties that a path must have."""

from __future__ import annotations

import time
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from cobot_run import WAIT_S
from sample_counts import samples
from scipy.sparse.csgraph import dijkstra
from thorough import few

from benchmarks.planning import scenes
from cobot.motions.requests import MotionRequest
from cobot.planners.roadmap import shortest
from cobot.planners.rrt_connect import connect
from cobot.planners.search import sampling
from cobot.planners.search.detours import length, without_detours
from cobot.planners.search.sampling import find_path, room
from cobot.planners.shortcut import draw_in, shorten
from cobot.robot.clearance import INSTRUCTIONS, Clearance
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
        short = shorten(clearance, corners, number)
        assert np.array_equal(short[[0, -1]], np.array([problem.start, problem.goal]))
        before, after = (np.linalg.norm(np.diff(way, axis=0), axis=1) for way in (corners, short))
        assert after.sum() < 0.9 * before.sum()
        assert before.max() <= 0.5 + 1e-9, "no node is further away than that"
        assert all(clearance.is_edge_free(*pair) for pair in pairwise(short))


def test_corners_are_drawn_in_as_far_as_the_way_stays_free(robot: RobotDescription) -> None:
    saved = []
    for number, problem in enumerate(scenes.problems(robot, "shelf", 4, SEED)):
        clearance = problem.robot.collision.clearance
        bounds = robot.limits.min_position, robot.limits.max_position
        corners = connect(clearance, problem.start, problem.goal[None], *bounds, number, WAIT_S, 2.0)
        assert corners is not None
        drawn = draw_in(clearance, corners)
        assert np.array_equal(drawn[[0, -1]], np.array([problem.start, problem.goal]))
        assert all(clearance.is_edge_free(*pair) for pair in pairwise(drawn))
        saved.append(1.0 - length(drawn) / length(corners))
    assert min(saved) >= 0.0
    assert max(saved) > 0.05


def test_no_motion_is_checked_for_a_shorter_path_when_the_time_is_over(robot: RobotDescription) -> None:
    problem = next(scenes.problems(robot, "shelf", 1, SEED))
    clearance = problem.robot.collision.clearance
    bounds = robot.limits.min_position, robot.limits.max_position
    corners = connect(clearance, problem.start, problem.goal[None], *bounds, 0, WAIT_S, 0.5)
    assert corners is not None
    clearance.enclose()
    before, end_s = clearance.evaluations, time.monotonic()
    for same in (
        shorten(clearance, corners, 0, end_s),
        draw_in(clearance, corners, end_s),
        without_detours(clearance, [corners], problem.goal[None], bounds, 0, end_s),
    ):
        np.testing.assert_array_equal(same, corners)
    assert clearance.evaluations == before


def test_a_found_path_is_shortened_until_the_time_of_the_request(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends_s: list[float] = []

    def note(clearance: Clearance, corners: Array, *rest: float) -> Array:
        ends_s.append(rest[-1])
        return corners

    for name in ("shorten", "draw_in"):
        monkeypatch.setattr(f"cobot.planners.search.sampling.{name}", note)
    problem = next(scenes.problems(robot, "shelf", 1, SEED))
    request = MotionRequest(problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=WAIT_S)
    begun_s = time.monotonic()
    find_path(problem.robot, request, problem.goal[None])
    assert len(ends_s) >= 2
    assert begun_s + WAIT_S <= min(ends_s) <= max(ends_s) <= time.monotonic() + WAIT_S


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


@pytest.mark.parametrize("share", [np.inf, 4.0, 1.2])
def test_a_search_that_finds_nothing_ends_when_its_time_is_over(
    robot: RobotDescription, share: float
) -> None:
    """Oracle: the goal, which is in the floor."""
    problem = next(scenes.problems(robot, "table", 1, SEED))
    limits, clearance = robot.limits, problem.robot.collision.clearance
    longest = share * float(np.linalg.norm(IN_THE_FLOOR - problem.start))
    args = (problem.start, IN_THE_FLOOR[None], limits.min_position, limits.max_position)
    begun_s = time.monotonic()
    assert connect(clearance, *args, 1, 0.1, 2.0, longest) is None
    assert 0.1 < time.monotonic() - begun_s < WAIT_S


@pytest.mark.parametrize("kind", few(scenes.KINDS))
def test_a_path_makes_no_detour(robot: RobotDescription, kind: str) -> None:
    limits = robot.limits
    for problem in scenes.problems(robot, kind, 2, SEED):
        request = MotionRequest(problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=WAIT_S)
        planned = find_path(problem.robot, request, problem.goal[None])
        ends = np.array([problem.start, problem.goal])
        best = np.inf
        with problem.robot.collision.keeping(room(problem.robot, ends)) as clearance:
            for seed in range(samples(24)):
                bounds, paths = (limits.min_position, limits.max_position), []
                for number in range(3):
                    corners = connect(clearance, ends[0], ends[1:], *bounds, 3 * seed + number, WAIT_S, 2.0)
                    assert corners is not None
                    paths.append(shorten(clearance, corners, seed))
                best = min(best, length(without_detours(clearance, paths, ends[1:], bounds, seed)))
        assert length(planned) <= 1.3 * best, problem.name


BEST_RAD = {"cage": {4: 4.92, 16: 9.11, 54: 5.58}, "bin": {41: 1.17, 47: 1.33}}
"""Of some motions that are found by long ways at first: the best of many searches of 10 s."""


@pytest.mark.parametrize("kind", few(BEST_RAD))
def test_ways_out_of_narrow_places_are_not_much_longer_than_the_best_and_the_same_again(
    robot: RobotDescription, kind: str
) -> None:
    for number, problem in enumerate(scenes.problems(robot, kind, 1 + max(BEST_RAD[kind]))):
        if number in BEST_RAD[kind]:
            request = MotionRequest(
                problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=WAIT_S
            )
            planned = find_path(problem.robot, request, problem.goal[None])
            assert length(planned) <= 1.3 * BEST_RAD[kind][number], problem.name
    assert np.array_equal(planned, find_path(problem.robot, request, problem.goal[None]))


def test_a_search_may_be_confined_to_what_a_short_path_passes(robot: RobotDescription) -> None:
    """Where it has little room it finds the way there: between two walls, and no other is as short."""
    limits = robot.limits
    problem = list(scenes.problems(robot, "bin", 42))[-1]
    ends = np.array([problem.start, problem.goal])
    longest = 1.3 * float(np.linalg.norm(ends[1] - ends[0]))
    with problem.robot.collision.keeping(room(problem.robot, ends)) as clearance:
        args = (clearance, ends[0], ends[1:], limits.min_position, limits.max_position)
        paths = [connect(*args, seed, WAIT_S, 2.0, longest, 600) for seed in range(20)]
    found = [path for path in paths if path is not None]
    assert len(found) > 10
    for path in found:
        away = np.linalg.norm(path[:, None] - ends, axis=2).sum(axis=1)
        assert away.max() <= longest * (1.0 + 1e-12)


def test_a_search_looks_at_configurations_together_and_finds_the_path_of_exact_distances(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The oracle is the search with exact distances alone, which looks at one edge after the other."""
    limits, attempts = robot.limits, 600
    problem = list(scenes.problems(robot, "bin", 42))[-1]
    longest = 1.2 * float(np.linalg.norm(problem.goal - problem.start))
    args = (problem.start, problem.goal[None], limits.min_position, limits.max_position)
    found: dict[str, list[Array | None]] = {}
    for instructions in ("", "exact"):
        monkeypatch.setenv(INSTRUCTIONS, instructions)
        clearance = problem.robot.collision.twin().clearance
        paths = found[instructions] = []
        for seed in range(8):
            before = clearance.evaluations
            paths.append(connect(clearance, *args, seed, WAIT_S, 2.0, longest, attempts))
            if paths[-1] is None and not instructions:
                looks = 4 * attempts
                assert clearance.evaluations - before < looks, "less than a look for each attempt"
    for path, expected in zip(*found.values(), strict=True):
        assert (path is None) == (expected is None)
        assert path is None or expected is None or np.array_equal(path, expected)
    assert any(path is None for path in found[""])
    assert any(path is not None for path in found[""])


def test_earlier_searches_change_neither_the_path_nor_the_work_of_a_search(robot: RobotDescription) -> None:
    """Oracle: the same search with a memory of its own. Work is what limits further searches."""
    limits = robot.limits
    random = np.random.default_rng(SEED)
    problem = list(scenes.problems(robot, "cage", 6))[-1]
    args = (problem.start, problem.goal[None], limits.min_position, limits.max_position)
    used = problem.robot.collision.twin().clearance
    for seed in range(samples(8)):
        for ends in pairwise(random.uniform(limits.min_position, limits.max_position, (40, limits.dof))):
            used.is_edge_free(*ends)
        new = problem.robot.collision.twin().clearance
        before = used.evaluations, new.evaluations
        found = [connect(each, *args, seed, WAIT_S, 2.0, attempts=2000) for each in (used, new)]
        assert used.evaluations - before[0] == new.evaluations - before[1], seed
        assert (found[0] is None) == (found[1] is None)
        assert found[0] is None or np.array_equal(*found)


def test_a_round_of_searches_without_a_path_is_the_last_one(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    confined = []

    def only_the_first(*args: Any) -> Array | None:
        if np.isinf(args[8]):
            return connect(*args)
        confined.append(args[8])
        return None

    monkeypatch.setattr(sampling, "connect", only_the_first)
    problem = list(scenes.problems(robot, "cage", 17))[-1]
    request = MotionRequest(problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=WAIT_S)
    find_path(problem.robot, request, problem.goal[None])
    assert len(confined) == len(sampling.FIRST_SHARES) + len(sampling.LATER_SHARES)


def test_detours_are_taken_out_and_what_is_left_is_free(robot: RobotDescription) -> None:
    limits = robot.limits
    bounds = limits.min_position, limits.max_position
    for problem in scenes.problems(robot, "shelf", 3, SEED):
        ends = np.array([problem.start, problem.goal])
        with problem.robot.collision.keeping(room(problem.robot, ends)) as clearance:
            paths = []
            for seed in range(3):
                corners = connect(clearance, ends[0], ends[1:], *bounds, seed, WAIT_S, 2.0)
                assert corners is not None
                paths.append(corners)
            way = without_detours(clearance, paths, ends[1:], bounds, 1)
            assert np.array_equal(way[[0, -1]], ends)
            assert length(way) < 0.95 * min(map(length, paths))
            assert all(clearance.is_edge_free(*pair) for pair in pairwise(way))
            assert ((way >= limits.min_position) & (way <= limits.max_position)).all()


def test_the_shortest_way_of_a_roadmap_is_that_of_the_graph_of_all_its_free_edges(
    robot: RobotDescription,
) -> None:
    random, found = np.random.default_rng(SEED), 0
    for problem in scenes.problems(robot, "table", 6, SEED):
        clearance = problem.robot.collision.clearance
        ends = np.array([problem.start, problem.goal])
        drawn = ends[random.integers(2, size=40)] + random.normal(size=(40, robot.limits.dof))
        goals = np.array([problem.goal, problem.goal + 0.1 * random.normal(size=robot.limits.dof)])
        nodes = np.vstack([ends[:1], drawn[clearance.are_free(drawn)], goals])
        graph = np.linalg.norm(nodes[:, None] - nodes, axis=2)
        for one, other in combinations(range(len(nodes)), 2):
            if not clearance.is_edge_free(nodes[one], nodes[other]):
                graph[one, other] = graph[other, one] = 0.0
        wanted = float(dijkstra(graph, indices=0)[-2:].min())
        way = shortest(clearance, nodes, 2, np.inf, 10**6)
        if not np.isfinite(wanted):
            assert way is None
            continue
        found += 1
        assert way is not None
        assert length(way) == pytest.approx(wanted)
        assert np.array_equal(way[0], problem.start)
        assert (way[-1] == goals).all(axis=1).any()
        assert all(clearance.is_edge_free(*pair) for pair in pairwise(way))
        assert shortest(clearance, nodes, 2, 0.999 * wanted, 10**6) is None
        assert shortest(clearance, nodes, 2, np.inf, -1) is None, "no work, no way"
    assert found > 3


def test_what_is_not_finite_is_refused(robot: RobotDescription) -> None:
    clearance, bounds = robot.collision.clearance, (robot.limits.min_position, robot.limits.max_position)
    with pytest.raises(ValueError, match="not finite"):
        connect(clearance, np.full(7, np.nan), np.zeros((1, 7)), *bounds, 1, 1.0, 2.0)
    for nodes, goals in ((np.full((3, 7), np.inf), 1), (np.zeros((1, 7)), 1), (np.zeros((2, 7)), 0)):
        with pytest.raises(ValueError, match="a start and goals are needed"):
            shortest(clearance, nodes, goals, np.inf, 1000)
    with pytest.raises(ValueError, match="finite corners, at least two"):
        shorten(clearance, np.zeros((1, 7)), 1)
