"""The time law along a path. Oracle: closed formulas of S-curves, and differences of dense samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from cobot.errors import PlanningError
from cobot.planners.time_law import PathRates, TimeLaw, joint_rates, timed
from cobot.robot.description import RobotDescription

SEED = 20261122


def test_a_law_that_only_jerk_limits_takes_the_time_of_the_formula() -> None:
    """From rest to rest over the distance 1: T = (32 / j)^(1/3)."""
    for jerk in (0.1, 4.0, 500.0):
        assert TimeLaw(PathRates(1e3, 1e3, jerk)).duration_s == pytest.approx(np.cbrt(32.0 / jerk), rel=1e-9)


def test_a_law_with_a_phase_of_constant_velocity_takes_the_time_of_the_formula() -> None:
    """T = 1/v + v/a + a/j, where both limits are reached."""
    v, a, j = 0.2, 0.5, 3.0
    law = TimeLaw(PathRates(v, a, j))
    assert law.duration_s == pytest.approx(1 / v + v / a + a / j, rel=1e-9)
    u, du, ddu = law.at(np.linspace(0.0, law.duration_s, 4001))
    assert (u[0], u[-1]) == pytest.approx((0.0, 1.0), abs=1e-9)
    assert du.max() <= v + 1e-9
    assert np.abs(ddu).max() <= a + 1e-9
    step_s = law.duration_s / 4000
    assert np.abs(np.diff(ddu)).max() / step_s <= j * (1 + 1e-6)
    np.testing.assert_allclose(np.diff(u) / step_s, 0.5 * (du[1:] + du[:-1]), atol=1e-4)


def test_knots_go_from_the_beginning_to_the_end_and_hold_every_change_of_jerk() -> None:
    law = TimeLaw(PathRates(0.2, 0.5, 3.0))
    knots = law.knots(20)
    assert (knots[0], knots[-1]) == (0.0, law.duration_s)
    assert (np.diff(knots) > 0.0).all()
    a_j, v_a = 0.5 / 3.0, 0.2 / 0.5
    for change in (a_j, v_a, v_a + a_j):
        assert np.abs(knots - change).min() < 1e-9
        assert np.abs(law.duration_s - change - knots).min() < 1e-9


def test_a_random_path_keeps_the_joint_limits(robot: RobotDescription) -> None:
    random, limits = np.random.default_rng(SEED), robot.limits
    for _ in range(20):
        rows = random.uniform(0.5 * limits.min_position, 0.5 * limits.max_position, (8, limits.dof))
        path = make_interp_spline(np.linspace(0.0, 1.0, 8), rows, k=5)
        rates = joint_rates(path, limits, PathRates(np.inf, np.inf, np.inf))
        shares = np.linspace(0.0, 1.0, 2000)
        assert (np.abs(path.derivative(1)(shares)) * rates.velocity <= limits.max_velocity * 1.01).all()
        trajectory = timed(path, limits, 60)
        times = np.linspace(0.0, trajectory.duration_s, 3000)
        for order, limit in ((1, limits.max_velocity), (2, limits.max_acceleration), (3, limits.max_jerk)):
            assert (np.abs(trajectory.sample(times, order)) <= limit * (1 + 1e-5)).all()
        np.testing.assert_allclose(trajectory.end, rows[-1], atol=1e-9)


def test_limits_that_are_all_but_zero_are_refused_with_their_values() -> None:
    with pytest.raises(PlanningError, match="no time profile from rest to rest"):
        TimeLaw(PathRates(1e-300, 1e-300, 1e-300))
