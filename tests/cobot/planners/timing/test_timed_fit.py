"""Timed trajectories of others. Oracles: the trapezoids and TOTG's motions themselves, scipy's B-splines and
piecewise polynomials, Ruckig for the shortest motion along a line, nearest neighbours among dense samples for
the corridor, and for the compiled fit the same law in numpy.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import ruckig
from foreign_trajectories import problems, totg, trapezoid
from laws import jerk_fit as law
from scipy.interpolate import BSpline, CubicSpline, PPoly
from scipy.spatial import cKDTree
from thorough import few

from cobot.errors import LimitError
from cobot.planners import WaypointRequest, jerk_fit, plan_waypoints
from cobot.planners.corridor import asked_curve
from cobot.planners.timing.course import BLEND_SHARE
from cobot.planners.timing.timed_fit import fitted
from cobot.planners.timing.uniform_spline import (
    knots_of,
    moving_average,
    spline_at,
    spline_motion,
    stretch_needed,
)
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits, Waypoint

CORRIDOR_RAD = 1e-3
WITHIN = 1.05
EXACT = 1e-9
SEED = 20261125
DOF = 7


@pytest.fixture(scope="module")
def free(robot: RobotDescription) -> RobotDescription:
    """The robot in an empty room: this is about time."""

    class Nothing:
        def check_trajectory(self, trajectory: Trajectory) -> None:
            """All is free."""

    return replace(robot, collision=Nothing())  # type: ignore[arg-type]


def home(robot: RobotDescription) -> Array:
    return np.array(robot.positions["home"].joints)


def points(times_s: Array, positions: Array, *rates: Array) -> list[Waypoint]:
    columns = [times_s.tolist(), *(each.tolist() for each in rates)]
    return [Waypoint(row, *rest) for row, *rest in zip(positions.tolist(), *columns, strict=True)]


def request(sent: list[Waypoint], off_rad: float = 0.0, **options: object) -> WaypointRequest:
    start = np.array(sent[0].positions)
    start[0] += off_rad
    return WaypointRequest(start, sent, 0.01, corridor_rad=CORRIDOR_RAD, **options)  # type: ignore[arg-type]


def sampled(duration_s: float, step_s: float) -> Array:
    return np.append(np.arange(0.0, duration_s - 1e-9, step_s), duration_s)


def swing(robot: RobotDescription, times_s: Array, joint: int = 0, speed: float = 0.5) -> Array:
    """Home, and one joint from there by 0.6 rad in 1.32 s."""
    positions = np.repeat(home(robot)[None], len(times_s), axis=0)
    positions[:, joint] += trapezoid(times_s, 0.6, speed, 1.32)
    return positions


def used(motion: Trajectory, limits: JointLimits) -> float:
    """The largest share of a rate limit: by the roots that scipy finds, and not by cobot's own extrema."""
    most = 0.0
    for joint in range(motion.dof):
        path = PPoly(motion.coefficients[:, joint, ::-1].T, motion.breakpoints_s)
        for order, bound in enumerate(
            (limits.max_velocity, limits.max_acceleration, limits.max_jerk), start=1
        ):
            rate = path.derivative(order)
            places = [motion.breakpoints_s]
            if order < 3:
                found = rate.derivative().roots(discontinuity=False, extrapolate=False)
                places.append(found[np.isfinite(found)])
            inside = np.abs(rate(np.concatenate(places))).max(initial=0.0)
            before = np.abs(rate(np.nextafter(motion.breakpoints_s[1:], 0.0))).max()
            most = max(most, float(max(inside, before) / bound[joint]))
    return most


def beside(motion: Trajectory, asked: Trajectory | PPoly, duration_s: float) -> float:
    """How far the one is from the other, both ways, among dense samples: of the worst joint, rad."""
    ours = motion.sample(np.linspace(0.0, motion.duration_s, 40_000))
    grid = np.linspace(0.0, duration_s, 40_000)
    theirs = asked.sample(grid) if isinstance(asked, Trajectory) else asked(grid)
    far = [cKDTree(b).query(a[::40], p=np.inf)[0].max() for a, b in ((ours, theirs), (theirs, ours))]
    return float(max(far))


# Points of others


@pytest.mark.parametrize("step_s", [0.1, 0.01, 0.002])
@pytest.mark.parametrize("joint", [0, 6])
@pytest.mark.parametrize("speed", [0.5, 0.6, 0.9])
def test_a_trapezoid_takes_as_long_as_it_says(
    free: RobotDescription, step_s: float, joint: int, speed: float
) -> None:
    times_s = sampled(1.32, step_s)
    sent = points(times_s, swing(free, times_s, joint, speed))
    motion = plan_waypoints(free, request(sent, 1e-5))
    assert motion.duration_s <= WITHIN * 1.32
    assert used(motion, free.limits) <= 1.0 + EXACT
    assert motion.start == pytest.approx(home(free) + np.eye(DOF)[0] * 1e-5, abs=1e-15)
    assert motion.end == pytest.approx(sent[-1].positions, abs=1e-12)
    reached = motion.sample(np.linspace(0.0, motion.duration_s, 999))
    others = np.delete(np.arange(DOF), [0, joint])
    assert np.abs(reached[:, others] - home(free)[others]).max() < 1e-12
    assert motion.changes.smoothed_rad <= CORRIDOR_RAD
    assert motion.changes.blended_rad == pytest.approx(1e-5)
    assert "from the curve through the points" in motion.note
    assert "the jerk of" in motion.note or "the acceleration of" in motion.note


@pytest.mark.parametrize("decimals", [3, 4, 5, 6, 15])
def test_5000_points_over_10_s_take_10_s(free: RobotDescription, decimals: int) -> None:
    times_s = np.linspace(0.0, 10.0, 5000)
    share = trapezoid(times_s, 1.0, 0.3, 5.0) - trapezoid(times_s - 5.0, 1.0, 0.3, 5.0)
    sent = np.round(home(free) + share[:, None] * [0.5, 0.3, 0.4, 0.3, 0.5, 0.3, 0.6], decimals)
    motion = plan_waypoints(free, request(points(times_s, sent), 1e-5))
    assert motion.duration_s <= WITHIN * 10.0
    assert used(motion, free.limits) <= 1.0 + EXACT
    tree = cKDTree(motion.sample(np.linspace(0.0, motion.duration_s, 50_000)))
    assert tree.query(sent, p=np.inf)[0].max() <= CORRIDOR_RAD + 2e-5


@pytest.mark.parametrize(("share", "within"), [(0.1, 1.001), (0.5, 1.01), (0.7, WITHIN), (1.0, 1.3)])
@pytest.mark.parametrize("rates", few([0, 2]))
def test_what_totg_sends_is_followed_in_its_time_where_jerk_allows_it(
    free: RobotDescription, share: float, within: float, rates: int
) -> None:
    """Beside the limits there is room for the jerk; at them only slowness helps, and locally."""
    for seed, rows in enumerate(problems(free.limits, home(free), share, 0.1, 4, seed=7)):
        times_s, *columns = np.split(rows, [1, 1 + DOF, 1 + 2 * DOF], axis=1)
        sent = points(times_s[:, 0], *columns[: 1 + rates])
        motion = plan_waypoints(free, request(sent, 1e-5, retime=True))
        duration_s = float(times_s[-1, 0])
        assert motion.duration_s <= within * duration_s, seed
        assert motion.duration_s < 1.2 * duration_s + 0.5, "MoveIt's execution monitor"
        assert used(motion, free.limits) <= 1.0 + EXACT
        assert motion.changes.stretch == pytest.approx(motion.duration_s / duration_s)
        if rates == 0:
            asked = CubicSpline(times_s[:, 0], columns[0], bc_type="clamped")
            assert beside(motion, asked, duration_s) <= CORRIDOR_RAD + 6e-5  # of the samples' distance


@pytest.mark.parametrize("asked_s", [None, 0.1, 0.01])
def test_along_a_line_it_is_nearly_as_short_as_ruckigs_optimum(
    free: RobotDescription, asked_s: float | None
) -> None:
    """At all limits, and where a hundredth of the time is asked for."""
    limits = free.limits
    goal = home(free) + np.array([0.8, -0.4, 0.5, 0.3, -0.6, 0.4, 0.7])
    rows = totg(np.array([home(free), goal]), limits.max_velocity, limits.max_acceleration, 0.01)
    if asked_s is not None:
        rows = rows[[0, -1]]
        rows[-1, 0] = asked_s
    motion = plan_waypoints(free, request(points(rows[:, 0], rows[:, 1 : 1 + DOF]), retime=True))
    assert motion.duration_s <= 1.03 * ruckigs_s(free, goal)


@pytest.mark.parametrize("share", [0.9, 1.0])
def test_at_the_limits_any_line_takes_as_long_as_asked_or_as_ruckigs_optimum(
    free: RobotDescription, share: float
) -> None:
    limits, random = free.limits, np.random.default_rng(SEED)
    for _ in range(4):
        goal = home(free) + random.uniform(-0.5, 0.5, DOF)
        rows = totg(
            np.array([home(free), goal]), share * limits.max_velocity, share * limits.max_acceleration, 0.01
        )
        motion = plan_waypoints(free, request(points(rows[:, 0], rows[:, 1 : 1 + DOF]), retime=True))
        assert motion.duration_s <= 1.03 * max(ruckigs_s(free, goal), rows[-1, 0]), f"seed {SEED}"
        assert used(motion, limits) <= 1.0 + EXACT


def ruckigs_s(robot: RobotDescription, goal: Array) -> float:
    """How long Ruckig takes from home along the straight joint line."""
    limits = robot.limits
    problem = ruckig.InputParameter(DOF)
    problem.current_position, problem.target_position = home(robot), goal
    problem.max_velocity, problem.max_acceleration = limits.max_velocity, limits.max_acceleration
    problem.max_jerk, problem.synchronization = limits.max_jerk, ruckig.Synchronization.Phase
    best = ruckig.Trajectory(DOF)
    ruckig.Ruckig(DOF).calculate(problem, best)
    return float(best.duration)


# What may be changed, and what not


def test_who_did_not_ask_for_slowness_is_refused_with_the_time_it_takes(free: RobotDescription) -> None:
    line = np.array([home(free), home(free) + 0.4])
    rows = totg(line, free.limits.max_velocity, free.limits.max_acceleration, 0.05)
    sent = points(rows[:, 0], rows[:, 1 : 1 + DOF])
    slow = plan_waypoints(free, request(sent, retime=True))
    assert slow.duration_s > WITHIN * rows[-1, 0]
    takes = f"{slow.duration_s:.3f} s instead of {rows[-1, 0]:.3f} s"
    with pytest.raises(
        LimitError, match=r"retime=true slows the motion down until the limits hold"
    ) as refused:
        plan_waypoints(free, request(sent))
    assert takes in str(refused.value)
    with pytest.raises(LimitError, match=r"its limit is .*; within the limits it takes ") as refused:
        plan_waypoints(free, request(sent, retime=True, longest_s=1.01 * float(rows[-1, 0])))
    assert takes in str(refused.value)


def test_time_is_stretched_only_where_the_limits_need_it(free: RobotDescription) -> None:
    """4 s of a gentle motion, then a leg that no limit permits in its time, then 4 s of the gentle motion."""
    times_s = np.arange(901) * 0.01
    far = trapezoid(times_s, 0.6, 0.2, 4.0) - trapezoid(times_s - 5.0, 0.6, 0.2, 4.0)
    fast = trapezoid(times_s - 4.25, 1.0, 4.0, 0.5)
    positions = np.repeat(home(free)[None], 901, axis=0)
    positions[:, 0] += far
    positions[:, 1] += fast
    motion = plan_waypoints(free, request(points(times_s, positions), retime=True))
    assert 0.3 < motion.duration_s - 9.0 < 0.6
    begin_s, end_s = motion.changes.slowed_s or (0.0, 9.0)
    assert 4.1 < begin_s < 4.4
    assert 4.6 < end_s < 4.9
    assert f"slower from {begin_s:.3f} s to {end_s:.3f} s" in motion.note
    early = np.linspace(0.0, 3.5, 100)
    assert np.abs(motion.sample(early) - _at(positions, times_s, early)).max() < 0.01
    late = np.linspace(5.5, 9.0, 100)
    delay_s = motion.duration_s - 9.0
    assert np.abs(motion.sample(late + delay_s) - _at(positions, times_s, late)).max() < 0.01


def _at(positions: Array, times_s: Array, wanted_s: Array) -> Array:
    return np.stack([np.interp(wanted_s, times_s, column) for column in positions.T], axis=1)


def test_a_turn_is_not_left_out_and_a_rest_stays_one(free: RobotDescription) -> None:
    """There and back on the same line: what leaves out the tip is nowhere beside the line."""
    times_s = np.arange(601) * 0.01
    tip = trapezoid(times_s, 0.3, 0.55, 1.0) - trapezoid(times_s - 1.0, 0.3, 0.55, 1.0)
    again = trapezoid(times_s - 4.0, 0.3, 0.55, 1.0) - trapezoid(times_s - 5.0, 0.3, 0.55, 1.0)
    positions = home(free) + (tip + again)[:, None]
    motion = plan_waypoints(free, request(points(times_s, positions), retime=True))
    reached = motion.sample(np.arange(0.0, motion.duration_s, 1e-3)) - home(free)
    half = len(reached) // 2
    for part in (reached[:half], reached[half:]):
        assert part.max(axis=0) == pytest.approx(np.full(DOF, 0.3), abs=CORRIDOR_RAD)
    resting = np.abs(reached).max(axis=1) < CORRIDOR_RAD
    assert 1.8 < 1e-3 * np.count_nonzero(resting[500:-500]) < 2.4


def test_a_corridor_of_0_is_the_exact_curve_slowed_down_as_a_whole(free: RobotDescription) -> None:
    times_s = sampled(1.32, 0.01)
    sent = points(times_s, swing(free, times_s))
    exact = replace(request(sent, retime=True), corridor_rad=0.0)
    motion = plan_waypoints(free, exact)
    factor = motion.duration_s / 1.32
    assert factor > 1.5
    assert motion.sample(factor * times_s) == pytest.approx(swing(free, times_s), abs=1e-9)
    assert motion.changes.slowed_s == (0.0, 1.32)
    assert f"from 1.320 s to {motion.duration_s:.3f} s" in motion.note


@pytest.mark.parametrize("corridor_rad", [1e-4, 3e-3])
def test_a_corridor_is_kept_whatever_it_is(free: RobotDescription, corridor_rad: float) -> None:
    for rows in problems(free.limits, home(free), 0.9, 0.02, 2, seed=11):
        sent = points(rows[:, 0], rows[:, 1 : 1 + DOF])
        widths = corridor_rad * np.array([1.0, 1.0, 0.2, 1.0, 1.0, 1.0, 1.0])
        motion = plan_waypoints(free, replace(request(sent, retime=True), corridor_rad=widths))
        asked = CubicSpline(rows[:, 0], rows[:, 1 : 1 + DOF], bc_type="clamped")
        assert beside(motion, asked, float(rows[-1, 0])) <= corridor_rad + 6e-5
        assert used(motion, free.limits) <= 1.0 + EXACT


def test_what_keeps_the_limits_is_not_touched(free: RobotDescription) -> None:
    sent = points(np.array([0.0, 2.0, 4.0]), home(free) + np.array([[0.0], [0.3], [0.0]]))
    motion = plan_waypoints(free, request(sent))
    assert (motion.note, motion.changes.stretch, motion.changes.smoothed_rad) == ("", 1.0, 0.0)
    assert motion.sample([2.0])[0] == pytest.approx(home(free) + 0.3, abs=1e-12)


@pytest.mark.parametrize("given", [False, True])
def test_an_offset_at_the_start_fades_away_and_takes_little_of_the_limits(
    free: RobotDescription, given: bool
) -> None:
    times_s = np.arange(401) * 0.01
    s = times_s / 4.0
    positions = home(free) + (0.4 * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))[:, None]
    curve = CubicSpline(times_s, positions, bc_type="clamped")
    rates = (curve(times_s, 1), curve(times_s, 2)) if given else ()
    for each in rates:
        each[[0, -1]] = 0.0
    still = plan_waypoints(free, request(points(times_s, positions, *rates)))
    moved = plan_waypoints(free, request(points(times_s, positions, *rates), 0.009))
    changes = moved.changes
    assert (moved.duration_s, changes.stretch, changes.smoothed_rad) == (4.0, 1.0, 0.0)
    assert changes.blended_rad == pytest.approx(0.009)
    assert 0.3 < changes.blended_s < 1.0
    assert (
        f"9.0e-03 rad away from the first point; this is blended out within {changes.blended_s:.3f} s"
        in moved.note
    )
    grid = np.linspace(0.0, 4.0, 4001)
    apart = moved.sample(grid) - still.sample(grid)
    assert apart[0] == pytest.approx(np.eye(DOF)[0] * 0.009, abs=1e-12)
    assert (np.diff(apart[:, 0]) < 1e-9).all()
    assert np.abs(apart[grid > changes.blended_s + 0.05]).max() < 1e-6
    for order, bound in enumerate((free.limits.max_velocity, free.limits.max_acceleration), start=1):
        change = moved.sample(grid, order) - still.sample(grid, order)
        assert (np.abs(change) <= 1.1 * BLEND_SHARE * bound).all()


# The parts


def test_a_uniform_spline_is_de_boors_and_its_bounds_hold_between_the_knots(free: RobotDescription) -> None:
    random = np.random.default_rng(5)
    for _ in range(5):
        control = np.cumsum(random.uniform(-0.1, 0.1, (30, DOF)), axis=0)
        control[:3], control[-3:] = control[0], control[-1]
        motion = spline_motion(control, 0.02)
        oracle = BSpline(0.02 * np.arange(-3.0, 31.0), control, 3)
        grid = np.linspace(0.0, motion.duration_s, 500, endpoint=False)
        assert motion.sample(grid) == pytest.approx(oracle(grid), abs=1e-12)
        assert knots_of(control)[:-1] == pytest.approx(oracle(motion.breakpoints_s[:-1]), abs=1e-12)
        position, velocity = spline_at(control, 0.02, grid)
        assert position == pytest.approx(oracle(grid), abs=1e-12)
        assert velocity == pytest.approx(oracle(grid, 1), abs=1e-10)
        factor = float(stretch_needed(control, 0.02, free.limits).max())
        assert used(motion.stretched(factor), free.limits) <= 1.0 + EXACT
        for end in (0.0, motion.duration_s):
            assert np.abs(motion.sample([end], 1)).max() < 1e-12


def test_a_moving_average_is_a_convolution_with_rest_at_both_ends() -> None:
    values = np.random.default_rng(6).uniform(-1.0, 1.0, (20, 3))
    for count in (1, 2, 5):
        rows = np.concatenate([np.repeat(values[:1], count, 0), values, np.repeat(values[-1:], count - 1, 0)])
        expected = np.stack([np.convolve(c, np.full(count, 1.0 / count), "valid") for c in rows.T], axis=1)
        assert moving_average(values, count) == pytest.approx(
            expected[1:] if count > 1 else values, abs=1e-12
        )


@pytest.mark.parametrize("turns", [1, 7, 40])
def test_the_compiled_fit_follows_its_law(free: RobotDescription, turns: int) -> None:
    for rows in problems(free.limits, home(free), 1.0, 0.02, 3, seed=turns):
        spline = CubicSpline(rows[:, 0], rows[:, 1 : 1 + DOF], bc_type="clamped")
        accelerations = spline(rows[:, 0], 2)
        accelerations[[0, -1]] = 0.0
        motion = from_hermite(rows[:, 0], spline(rows[:, 0]), spline(rows[:, 0], 1), accelerations)
        curve = asked_curve(motion, 0.01)
        steps = round(motion.duration_s / 0.01)
        times_s = np.clip(np.arange(-1.0, steps + 2.0) / steps, 0.0, 1.0) * motion.duration_s
        control = curve.at(times_s)
        control[:3], control[-3:] = control[0], control[-1]
        given = (curve, control, times_s, motion.duration_s / steps, free.limits, np.full(DOF, 5e-4), turns)
        ours, theirs = jerk_fit.fit(*given), law.fit(*given)
        assert ours[0] == pytest.approx(
            theirs[0], abs=2e-10 * turns
        )  # a banded system of condition 1e5, by turns
        assert ours[1] == pytest.approx(theirs[1], abs=2e-10 * turns)


def test_there_is_no_fit_where_the_velocities_alone_take_longer(free: RobotDescription) -> None:
    times_s = sampled(0.3, 0.01)
    positions = home(free) + trapezoid(times_s, 1.0, 5.0, 0.3)[:, None]
    spline = CubicSpline(times_s, positions, bc_type="clamped")
    asked = from_hermite(times_s, positions, spline(times_s, 1), 0.0 * positions)
    assert fitted(asked, free.limits, np.full(DOF, CORRIDOR_RAD), 0.31) is None
