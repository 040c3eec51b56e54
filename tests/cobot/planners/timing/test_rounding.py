"""Taking the rounding out of points. Oracle: the motion that was rounded; scipy's piecewise polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

from cobot.errors import LimitError
from cobot.planners import MotionRequest, WaypointRequest, plan, plan_waypoints
from cobot.planners.timing.rounding import smoothed
from cobot.robot.description import RobotDescription
from cobot.types import Array, PlannerName, Scaling, Waypoint

STEP_S = 0.002
SWAY_RAD = np.array([0.5, 0.3, 0.4, 0.3, 0.5, 0.3, 0.6])


def wave(robot: RobotDescription, count: int = 3000) -> tuple[Array, Array]:
    """Times and positions of a swaying that begins and ends at rest, at home."""
    times_s = np.arange(count) * STEP_S
    edge = np.clip(np.minimum(times_s, times_s[-1] - times_s) / 2.0, 0.0, 1.0)
    grown = edge**4 * (35.0 - 84.0 * edge + 70.0 * edge**2 - 20.0 * edge**3)
    sway = SWAY_RAD * grown[:, None] * np.sin(1.5 * times_s)[:, None]
    return times_s, np.array(robot.positions["home"].joints) + sway


def there_and_back(robot: RobotDescription) -> tuple[Array, Array]:
    """Two motions of a planner that drives at its jerk limits, as somebody samples them."""
    home = np.array(robot.positions["home"].joints)
    away = home + np.array([0.8, -0.4, 0.5, 0.3, -0.6, 0.4, 0.7])
    parts = []
    for start, goal in ((home, away), (away, home)):
        motion = plan(robot, MotionRequest(start, goal, PlannerName.PTP, Scaling(0.5)))
        assert motion is not None
        parts += [motion.sample(np.arange(0.0, motion.duration_s, STEP_S)), np.repeat(goal[None], 20, axis=0)]
    positions = np.vstack(parts)
    return np.arange(len(positions)) * STEP_S, positions


def sent(robot: RobotDescription, times_s: Array, positions: Array, **options: bool) -> WaypointRequest:
    points = [Waypoint(row.tolist(), time_s) for row, time_s in zip(positions, times_s.tolist(), strict=True)]
    return WaypointRequest(positions[0], points, 0.01, **options)


@pytest.mark.parametrize("course", [wave, there_and_back])
@pytest.mark.parametrize("decimals", [5, 6, 7])
def test_what_was_rounded_runs_within_its_rounding_and_says_so(
    robot: RobotDescription, course: object, decimals: int
) -> None:
    times_s, exact = course(robot)  # type: ignore[operator]
    rounded = np.round(exact, decimals)
    motion = plan_waypoints(robot, sent(robot, times_s, rounded))
    unit = 10.0**-decimals
    assert np.abs(motion.sample(times_s) - rounded).max() <= unit
    assert f"within their rounding of {unit:.0e} rad" in motion.note
    assert (motion.start == rounded[0]).all()
    assert motion.end == pytest.approx(rounded[-1], abs=1e-12)
    low, high = motion.extrema(3)
    assert (np.maximum(-low, high) <= robot.limits.max_jerk * (1 + 1e-6)).all()


def test_what_keeps_the_limits_is_not_touched(robot: RobotDescription) -> None:
    times_s, exact = wave(robot)
    motion = plan_waypoints(robot, sent(robot, times_s, exact))
    assert motion.note == ""
    assert np.abs(motion.sample(times_s) - exact).max() < 1e-12
    slow = np.round(exact[::50], 5)
    motion = plan_waypoints(robot, sent(robot, times_s[::50], slow))
    assert motion.note == ""
    assert np.abs(motion.sample(times_s[::50]) - slow).max() < 1e-12


def test_what_is_too_fast_stays_refused_with_the_way_out(robot: RobotDescription) -> None:
    times_s, exact = wave(robot)
    with pytest.raises(LimitError, match="retime=true slows the motion down until the limits hold"):
        plan_waypoints(robot, sent(robot, times_s / 5.0, np.round(exact, 6)))
    motion = plan_waypoints(robot, sent(robot, times_s / 5.0, np.round(exact, 6), retime=True))
    assert motion.note
    assert motion.duration_s < 1.3 * times_s[-1]  # not by what the rounding would need


@pytest.mark.parametrize("decimals", [2, 3, 12])
def test_few_decimals_are_meant_and_many_are_not_rounded(robot: RobotDescription, decimals: int) -> None:
    times_s, exact = wave(robot)
    assert smoothed(times_s, np.round(exact, decimals)) is None


def test_points_that_are_few_far_apart_or_uneven_are_meant_as_they_are(robot: RobotDescription) -> None:
    times_s, exact = wave(robot)
    rounded = np.round(exact, 6)
    assert smoothed(times_s[:50], rounded[:50]) is None
    assert smoothed(times_s * 20.0, rounded) is None
    uneven = times_s.copy()
    uneven[1000:] += STEP_S
    assert smoothed(uneven, rounded) is None
    assert smoothed(times_s, rounded) is not None


def test_a_constant_jerk_is_not_changed() -> None:
    breaks_s = np.array([0.0, 1.0, 3.0, 4.0])
    course = PPoly(np.array([[0.5, -0.5, 0.5]]), breaks_s).antiderivative(3)
    times_s = np.arange(2001) * STEP_S
    exact = course(times_s)
    found = smoothed(times_s, np.round(np.repeat(exact[:, None], 7, axis=1), 6))
    assert found is not None
    within = np.abs(times_s[:, None] - breaks_s).min(axis=1) > 0.1
    assert np.abs(found[0][within, 0] - exact[within]).max() < 5e-7  # no more than the rounding itself
