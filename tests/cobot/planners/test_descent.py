"""The compiled steps of CHOMP."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.planning import scenes
from cobot.planners.descent import PathDescent
from cobot.planners.search.chomp import _pull, _spread
from cobot.robot.clearance import INSTRUCTIONS, Clearance
from cobot.robot.collision import RESOLUTION_M, geom_pairs
from cobot.robot.description import RobotDescription
from cobot.types import Array

SEED = 20261130
PUSHED_M, WIDTH_M = 0.009, 0.04


def descent(
    clearance: Clearance, points: Array, low: Array, high: Array, width_m: float = WIDTH_M
) -> PathDescent:
    spread = _spread(len(points))
    smoothest = -spread @ _pull(points[0], points[-1], len(points))
    return PathDescent(clearance, points, smoothest, spread, low, high, PUSHED_M, width_m)


def wandering(random: np.random.Generator, start: Array, count: int) -> Array:
    steps = random.normal(size=(count, len(start)))
    return np.asarray(start + 0.3 * np.cumsum(steps, axis=0) / np.sqrt(count))


def test_obstacles_push_a_path_as_without_spheres(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The oracle is the gradient of the exact distances of all pairs; the same bits are required."""
    random = np.random.default_rng(SEED)
    low, high = robot.limits.min_position, robot.limits.max_position
    pushed = 0
    for kind in scenes.KINDS:
        problem = next(scenes.problems(robot, kind, 1, SEED))
        mj = problem.robot.model.mj
        spheres = Clearance(mj, geom_pairs(mj), RESOLUTION_M)
        spheres.enclose()
        monkeypatch.setenv(INSTRUCTIONS, "exact")
        exact = Clearance(mj, geom_pairs(mj), RESOLUTION_M)
        exact.enclose()
        monkeypatch.delenv(INSTRUCTIONS)
        for count in (3, 18, 41):
            points = wandering(random, problem.start, count)
            found, expected = (descent(each, points, low, high) for each in (spheres, exact))
            assert found.push() == expected.push()
            assert np.array_equal(found.gradient, expected.gradient)
            pushed += int(np.abs(expected.gradient).max() > 0.0)
    assert pushed > 3


def test_the_push_is_the_gradient_of_the_obstacle_cost(robot: RobotDescription) -> None:
    """Oracle: equations 20 and 21 of the paper with the distances and gradients of single pairs."""
    random = np.random.default_rng(SEED + 1)
    low, high = robot.limits.min_position, robot.limits.max_position
    problem = next(scenes.problems(robot, "bin", 1, SEED))
    clearance = problem.robot.collision.clearance
    points = wandering(random, problem.start, 12)
    path = descent(clearance, points, low, high)
    nearest_m = path.push()
    distances = clearance.distances(points[1:-1], PUSHED_M + WIDTH_M)
    assert nearest_m == distances.min()
    expected = np.zeros((10, robot.limits.dof))
    speeds = np.linalg.norm(0.5 * (points[2:] - points[:-2]) * (len(points) - 1), axis=1)
    for row, pair in zip(*np.nonzero(distances < PUSHED_M + WIDTH_M), strict=True):
        strength = 1.0 - max(distances[row, pair] - PUSHED_M, 0.0) / WIDTH_M
        _, slope = clearance.gradient(points[row + 1], int(pair))
        expected[row] -= speeds[row] * strength * slope
    assert np.abs(expected).max() > 0.0
    np.testing.assert_allclose(path.gradient, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("room", [10.0, 0.1])
def test_a_step_follows_its_law_and_ends_within_the_limits(robot: RobotDescription, room: float) -> None:
    """Oracle: the law in numpy. With little room, joints leave their ranges."""
    random = np.random.default_rng(SEED + 2)
    clearance, weight, longest = robot.collision.clearance, 0.05, 0.04
    start = np.array(robot.positions["work"].joints)
    corrected = 0
    for count in (3, 18, 41):
        points = wandering(random, start, count)
        low, high = points.min(axis=0) - room, points.max(axis=0) + room
        low[1:3] += 1.5 * room * (room < 1.0)
        spread, before = _spread(count), points.copy()
        path = descent(clearance, points, low, high)
        path.push()
        smoothest = -spread @ _pull(points[0], points[-1], count)
        change = weight * (points[1:-1] - smoothest) + spread @ path.gradient
        inner = points[1:-1] - change * min(longest / np.abs(change).max(), 1.0 / weight)
        corrected += int((inner < low).any())
        for _ in range(20):
            violation = inner - inner.clip(low, high)
            for joint in np.flatnonzero(violation.any(axis=0)):
                row = int(np.abs(violation[:, joint]).argmax())
                correction = spread @ violation[:, joint]
                inner[:, joint] -= correction * violation[row, joint] / correction[row]
        assert path.step(weight, longest)
        np.testing.assert_allclose(points[1:-1], inner.clip(low, high), rtol=0.0, atol=1e-9)
        assert np.array_equal(points[[0, -1]], before[[0, -1]])
    assert corrected == (0 if room > 1.0 else 3)


def test_a_path_at_rest_far_from_everything_does_not_move(robot: RobotDescription) -> None:
    clearance, limits = robot.collision.clearance, robot.limits
    random = np.random.default_rng(SEED + 3)
    rows = random.uniform(limits.min_position, limits.max_position, (200, limits.dof))
    distances = clearance.distances(rows, 1.0).min(axis=1)
    assert distances.max() > PUSHED_M + 0.03
    points = np.tile(rows[distances.argmax()], (12, 1))
    path = descent(clearance, points, limits.min_position, limits.max_position, width_m=0.03)
    assert path.push() == PUSHED_M + 0.03
    assert not path.step(0.05, 0.04)


@pytest.mark.parametrize("points", [np.zeros((2, 7)), np.full((5, 7), np.nan)])
def test_a_path_without_inner_or_finite_points_is_rejected(robot: RobotDescription, points: Array) -> None:
    limits = robot.limits
    with pytest.raises(ValueError, match="at least three finite points"):
        PathDescent(
            robot.collision.clearance,
            points,
            np.zeros((3, 7)),
            np.eye(3),
            limits.min_position,
            limits.max_position,
            PUSHED_M,
            WIDTH_M,
        )
