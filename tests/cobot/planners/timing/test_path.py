"""Paths in joint space. Oracle: scipy's splines."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from cobot.errors import InputError
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.planners.search.spline import control_spline, smooth_curve
from cobot.planners.timing.path import JointCurve
from cobot.robot.description import RobotDescription
from cobot.types import PlannerName, Scaling

PLACES = np.linspace(0.0, 1.0, 301)


@pytest.mark.parametrize("points", [2, 3, 5, 6, 20])
def test_a_path_through_points_is_scipys_spline_with_its_derivatives(points: int) -> None:
    random = np.random.default_rng(points)
    rows, parameters = random.normal(size=(points, 7)), np.linspace(0.0, 1.0, points)
    path, spline = (
        JointCurve.through(parameters, rows),
        make_interp_spline(parameters, rows, k=min(5, points - 1)),
    )
    np.testing.assert_allclose(path.at(parameters), rows, atol=1e-12)
    for order, found in enumerate(path.derivatives(PLACES[:-1])):
        expected = spline(PLACES[:-1], order)
        np.testing.assert_allclose(found, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("count", [12, 24, 48])
def test_a_smooth_curve_is_scipys_clamped_spline(count: int) -> None:
    points = np.random.default_rng(1).normal(size=(count, 7))
    path, pieces = smooth_curve(points)
    np.testing.assert_allclose(path.at(np.array([0.0, path.length])), points[[0, -1]], atol=1e-12)
    spline = control_spline(points)
    for order, found in enumerate(path.derivatives(PLACES)):
        expected = spline(PLACES, order)
        np.testing.assert_allclose(found, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))
    np.testing.assert_allclose(pieces[:, 0], spline(path.breakpoints[:-1]), atol=1e-12)
    np.testing.assert_allclose(pieces, path.bezier(), atol=1e-9)


def test_the_path_of_a_motion_is_where_the_motion_was(robot: RobotDescription) -> None:
    start, goal = np.array(robot.positions["home"].joints), np.array(robot.positions["work"].joints)
    goal[[0, 4]] += 1.0, -0.3
    request = MotionRequest(start, goal, PlannerName.PTP, Scaling(1.0))
    motion = plan_ptp(robot, request, goal)
    path = JointCurve.of_trajectory(motion)
    along = motion.sample(np.linspace(0.0, motion.duration_s, 20_000))
    for point in path.at(path.length * PLACES):
        assert np.linalg.norm(along - point, axis=1).min() < 3e-4
    assert np.linalg.norm(path.at(path.length * PLACES, 1), axis=1) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("breakpoints", "coefficients", "message"),
    [
        ([0.0, 1.0], np.zeros((1, 7, 4)), r"coefficients \(n, dof, 6\)"),
        ([0.0, 1.0, 2.0], np.zeros((1, 7, 6)), r"breakpoints \(n\+1,\)"),
        ([0.0, np.nan], np.zeros((1, 7, 6)), "must be finite"),
        ([0.1, 1.0], np.zeros((1, 7, 6)), "start at 0 and be strictly increasing"),
        ([0.0, 0.0], np.zeros((1, 7, 6)), "start at 0 and be strictly increasing"),
    ],
)
def test_what_is_no_path_is_refused(breakpoints: list[float], coefficients: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        JointCurve(np.array(breakpoints), coefficients)
