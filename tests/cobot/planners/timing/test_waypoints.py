"""Timed waypoints. Oracle: scipy's clamped CubicSpline at the points, BPoly between them, dense samples;
pinocchio for what the drives need.
"""

from __future__ import annotations

import re
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent_models import LIMITS as LIMITS_FILE
from independent_models import Contacts, largest_rates, rate_limits
from scipy.interpolate import BPoly, CubicSpline

from benchmarks.arms import Arm, arm, carrying, loaded_model
from cobot.errors import CobotError, CollisionError, InputError, LimitError
from cobot.planners import WaypointRequest, plan_waypoints
from cobot.planners.timing.waypoints import through
from cobot.robot.description import RobotDescription
from cobot.robot.limits import load_joint_limits
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, Scaling, Waypoint

SEED = 20261121
DOF = 7
STILL = [0.0] * DOF
EXAMPLES = settings(max_examples=60, deadline=None, derandomize=True, database=None)


def home(robot: RobotDescription) -> Array:
    return np.array(robot.positions["home"].joints)


def near_home(robot: RobotDescription, *offsets: float) -> list[list[float]]:
    """Joint positions that are the home position with an offset at all joints."""
    return [(home(robot) + offset).tolist() for offset in offsets]


def points_at(times: list[float], positions: list[list[float]]) -> list[Waypoint]:
    return [Waypoint(row, time) for row, time in zip(positions, times, strict=True)]


@st.composite
def courses(draw: st.DrawFn) -> tuple[Array, Array]:
    """Times (n,) from 0 and positions (n, 7)."""
    steps = draw(st.lists(st.floats(0.05, 5.0), min_size=1, max_size=8))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return np.concatenate([[0.0], np.cumsum(steps)]), random.uniform(-2.0, 2.0, (len(steps) + 1, DOF))


def require_c2(trajectory: Trajectory) -> None:
    """From the left and from the right of each breakpoint, by numpy's polynomials."""
    for segment, duration in enumerate(np.diff(trajectory.breakpoints_s)[:-1]):
        for joint in range(trajectory.dof):
            before = np.polynomial.Polynomial(trajectory.coefficients[segment, joint])
            after = np.polynomial.Polynomial(trajectory.coefficients[segment + 1, joint])
            for k in range(3):
                left, right = before.deriv(k)(duration), after.deriv(k)(0.0)
                assert left == pytest.approx(right, abs=1e-7 * (1.0 + abs(right))), (segment, joint, k)


@EXAMPLES
@given(courses())
def test_points_are_met_at_their_times_with_the_clamped_cubic_splines_velocities(
    course: tuple[Array, Array],
) -> None:
    times, positions = course
    limits = load_joint_limits(LIMITS_FILE)
    motion, labels = through(points_at(times.tolist(), positions.tolist()), positions[0], limits, 0.0)
    spline = CubicSpline(times, positions, bc_type="clamped")
    accelerations = spline(times, 2)
    accelerations[[0, -1]] = 0.0
    assert motion.breakpoints_s == pytest.approx(times)
    assert len(labels) == len(times)
    assert motion.sample(times) == pytest.approx(positions, abs=1e-7)
    expected = BPoly.from_derivatives(
        times, np.stack([positions, spline(times, 1), accelerations], axis=1), orders=5
    )
    between = np.linspace(0.0, times[-1], 77)
    wanted = expected(between)
    assert motion.sample(between) == pytest.approx(wanted, abs=1e-7 * (1.0 + np.abs(wanted).max()))
    require_c2(motion)
    for derivative in (1, 2):
        ends = motion.sample([0.0, motion.duration_s], derivative)
        assert np.abs(ends).max() < 1e-6 * (1.0 + np.abs(motion.sample(between, derivative)).max())


def test_given_velocities_and_accelerations_are_met(robot: RobotDescription) -> None:
    middle = Waypoint(near_home(robot, 0.2)[0], 2.0, [0.1] * DOF, [0.05] * DOF)
    only_velocity = Waypoint(near_home(robot, 0.3)[0], 3.0, [0.02] * DOF)
    course = [Waypoint(home(robot).tolist(), 0.0), middle, only_velocity, Waypoint(home(robot).tolist(), 6.0)]
    motion, _ = through(course, home(robot), robot.limits, 0.0)
    assert motion.sample([2.0], 1)[0] == pytest.approx(np.full(DOF, 0.1))
    assert motion.sample([2.0], 2)[0] == pytest.approx(np.full(DOF, 0.05))
    assert motion.sample([3.0], 1)[0] == pytest.approx(np.full(DOF, 0.02))
    require_c2(motion)


def test_a_first_point_later_than_now_is_reached_from_the_present_position(robot: RobotDescription) -> None:
    course = points_at([2.0, 4.0], near_home(robot, 0.2, 0.4))
    motion = plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))
    assert motion.start == pytest.approx(home(robot), abs=1e-12)
    assert motion.sample([2.0, 4.0]) == pytest.approx(np.array(near_home(robot, 0.2, 0.4)), abs=1e-9)
    assert motion.duration_s == 4.0


def test_a_single_later_point_is_a_motion(robot: RobotDescription) -> None:
    motion = plan_waypoints(
        robot, WaypointRequest(home(robot), points_at([3.0], near_home(robot, 0.3)), 0.01)
    )
    assert motion.duration_s == 3.0
    assert motion.end == pytest.approx(home(robot) + 0.3)


def test_a_start_within_the_tolerance_is_replaced_by_where_the_arm_is(robot: RobotDescription) -> None:
    course = points_at([0.0, 3.0], near_home(robot, 0.009, 0.3))
    motion = plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))
    assert motion.start == pytest.approx(home(robot), abs=1e-12)


def test_a_start_elsewhere_is_refused_with_joint_both_angles_and_the_way_out(robot: RobotDescription) -> None:
    course = points_at([0.0, 3.0], near_home(robot, 0.0, 0.3))
    course[0].positions[3] -= 0.05  # type: ignore[index]
    message = (
        "point 1: starts with joint4 at -1.6200 rad, but the arm is at -1.5700 rad: 0.0500 rad apart, "
        "allowed: 0.01 rad; move there first, or send move_to_start=true (on the command line: "
        "--move-to-start)"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))


def test_an_approach_leads_to_the_first_point_and_comes_to_rest_there(robot: RobotDescription) -> None:
    course = points_at([0.0, 3.0], near_home(robot, 0.2, 0.4))
    alone = plan_waypoints(robot, WaypointRequest(home(robot) + 0.2, course, 0.01))
    motion = plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, approach=Scaling(0.5)))
    approach_s = motion.duration_s - alone.duration_s
    assert approach_s > 0.0
    assert motion.start == pytest.approx(home(robot))
    assert motion.sample([approach_s])[0] == pytest.approx(home(robot) + 0.2, abs=1e-9)
    assert np.abs(motion.sample([approach_s], 1)).max() < 1e-9
    times = np.linspace(0.0, alone.duration_s, 50)
    assert motion.sample(approach_s + times) == pytest.approx(alone.sample(times), abs=1e-9)
    require_c2(motion)


def test_an_approach_from_where_the_motion_begins_adds_nothing(robot: RobotDescription) -> None:
    course = points_at([0.0, 3.0], near_home(robot, 0.0, 0.4))
    motion = plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, approach=Scaling(0.5)))
    assert motion.duration_s == 3.0


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (
            [0.0, 1.0, 1.0, 2.0],
            "point 3: time_from_start is 1.0 s; it must be at least 1e-09 s later than the 1.0 s of point 2",
        ),
        (
            [0.0, 2.0, 1.0, 3.0],
            "point 3: time_from_start is 1.0 s; it must be at least 1e-09 s later than the 2.0 s of point 2",
        ),
        (
            [0.0, 0.0, 1.0, 2.0],
            "point 2: time_from_start is 0.0 s; it must be at least 1e-09 s later than the 0.0 s of point 1",
        ),
        ([-1.0, 0.0, 1.0, 2.0], "point 1: time_from_start is -1.0 s; it must not be negative"),
        ([0.0, 1.0, 2.0, 1.3e308], "point 4: time_from_start is 1.3e+308 s, allowed: up to 1e+06 s"),
        ([0.0, 1.0, 1.0 + 2e-10, 2.0], "must be at least 1e-09 s later than the 1.0 s of point 2"),
        ([0.0, 5e-324, 1.0, 2.0], "is 5e-324 s; it must be at least 1e-09 s later than the 0.0 s"),
        ([5e-324, 1.0, 2.0, 3.0], "point 1: time_from_start is 5e-324 s; it must be 0 or at least 1e-09 s"),
    ],
)
def test_times_that_do_not_increase_are_refused_with_both_points(
    robot: RobotDescription, times: list[float], message: str
) -> None:
    course = points_at(times, near_home(robot, 0.0, 0.1, 0.2, 0.3))
    with pytest.raises(InputError, match=re.escape(message)):
        plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))


@pytest.mark.parametrize("name", ["positions", "velocities", "accelerations"])
@pytest.mark.parametrize("check_limits", [False, True])
def test_what_no_arm_does_is_refused_before_anything_is_computed_with_it(
    robot: RobotDescription, name: str, check_limits: bool
) -> None:
    course = points_at([0.0, 1.0, 2.0], near_home(robot, 0.0, 0.1, 0.0))
    rates: dict[str, Any] = {name: [*STILL[1:], -1.3e308]}
    course[1] = replace(course[1], **rates)
    asked = WaypointRequest(home(robot), course, 0.01, check_limits=check_limits, retime=True)
    kind: type[CobotError] = InputError
    beyond = f"point 2: {name} may be up to 1e+06, got 1.3e+308"
    if name == "positions" and check_limits:
        kind, beyond = LimitError, "point 2: angle of joint7 is -1.3e+308"
    with pytest.raises(kind, match=re.escape(beyond)):
        plan_waypoints(robot, asked)


def test_who_asks_for_far_too_much_gets_no_memory_for_it(robot: RobotDescription) -> None:
    """0.1 rad within a nanosecond: in steps of milliseconds the retimed motion would have milliards."""
    course = points_at([0.0, 1e-9, 2.0], near_home(robot, 0.0, 0.1, 0.0))
    tracemalloc.start()
    try:
        with pytest.raises(LimitError):  # the spline swings beyond the joints' ranges
            plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, retime=True, corridor_rad=0.001))
        assert tracemalloc.get_traced_memory()[1] < 2**28
    finally:
        tracemalloc.stop()


def test_no_points_are_refused(robot: RobotDescription) -> None:
    with pytest.raises(InputError, match="points: at least one is needed"):
        plan_waypoints(robot, WaypointRequest(home(robot), [], 0.01))


def test_one_point_at_time_zero_is_no_motion(robot: RobotDescription) -> None:
    course = points_at([0.0], near_home(robot, 0.0))
    for approach in (None, Scaling(0.5)):
        with pytest.raises(InputError, match="a motion needs a point with a time_from_start above 0"):
            plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, approach=approach))


@pytest.mark.parametrize("name", ["positions", "velocities", "accelerations"])
def test_a_point_with_too_few_numbers_is_refused_by_its_label(robot: RobotDescription, name: str) -> None:
    course = points_at([0.0, 3.0], near_home(robot, 0.0, 0.4))
    values = {"positions": near_home(robot, 0.2)[0], "velocities": None, "accelerations": None}
    values[name] = [0.0] * 6
    bad = Waypoint(time_from_start_s=1.0, label="row 7", **values)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=f"row 7: {name} must have 7 numbers, got 6"):
        plan_waypoints(robot, WaypointRequest(home(robot), [course[0], bad, course[1]], 0.01))


@pytest.mark.parametrize(("index", "end"), [(0, "start"), (1, "end")])
@pytest.mark.parametrize("name", ["velocities", "accelerations"])
def test_a_motion_that_is_not_at_rest_at_its_ends_is_refused(
    robot: RobotDescription, index: int, end: str, name: str
) -> None:
    positions = near_home(robot, 0.0, 0.4)
    moving = {name: [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]}
    course = [Waypoint(positions[i], 3.0 * i, **(moving if i == index else {})) for i in (0, 1)]
    with pytest.raises(
        InputError, match=f"point {index + 1}: the motion must {end} at rest, but its {name} are not 0"
    ):
        plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))


def test_a_point_beyond_the_limits_is_refused_with_point_joint_value_and_range(
    robot: RobotDescription,
) -> None:
    course = points_at([0.0, 30.0, 60.0], near_home(robot, 0.0, 0.1, 0.2))
    course[1].positions[1] = 2.2  # type: ignore[index]
    message = "point 2: angle of joint2 is 2.2 rad, allowed: -2.1 to 2.1 rad"
    with pytest.raises(LimitError, match=re.escape(message)):
        plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))


def test_a_motion_too_fast_between_two_points_names_them(robot: RobotDescription) -> None:
    course = points_at([0.0, 2.0, 2.2, 4.2], near_home(robot, 0.0, 0.0, 0.5, 0.5))
    with pytest.raises(LimitError, match=r"^between point \d and point \d \(from .* s\) the \w+ of joint\d"):
        plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))


def test_an_overshoot_beyond_a_position_limit_between_points_is_found(robot: RobotDescription) -> None:
    # All points are within the limits, the curve through them is not.
    positions = near_home(robot, 0.0, 0.0, 0.0, 0.0)
    positions[1][0], positions[2][0] = 2.969, 2.969
    course = points_at([0.0, 8.0, 9.0, 17.0], positions)
    spline = CubicSpline([0.0, 8.0, 9.0, 17.0], [row[0] for row in positions], bc_type="clamped")
    assert spline(np.linspace(0.0, 17.0, 999)).max() > 2.97
    with pytest.raises(LimitError, match=r"between point 2 and point 3 .* position of joint1 reaches 2\.99"):
        plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))


def test_retime_slows_down_just_enough_and_keeps_the_path(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED)
    for _ in range(20):
        offsets = random.uniform(-0.15, 0.15, (5, DOF))
        offsets[0] = 0.0
        times = np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 0.2, 4))])
        course = points_at(times.tolist(), (home(robot) + offsets).tolist())
        with pytest.raises(LimitError):
            plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01))
        motion = plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, retime=True))
        factor = motion.duration_s / times[-1]
        assert factor > 1.0
        assert motion.sample(factor * times) == pytest.approx(home(robot) + offsets, abs=1e-7)
        used = (largest_rates(motion) / rate_limits(robot.limits)).max()
        assert 0.97 < used <= 1.0 + 1e-5


def test_retime_leaves_a_slow_motion_as_it_is(robot: RobotDescription) -> None:
    course = points_at([0.0, 5.0], near_home(robot, 0.0, 0.4))
    motion = plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, retime=True))
    assert motion.duration_s == 5.0


@pytest.mark.parametrize("checked", [True, False])
def test_points_that_lead_through_the_floor_are_always_refused(
    robot: RobotDescription, checked: bool
) -> None:
    below = [0.0, 1.9, 0.0, -0.2, 0.0, 0.0, 0.0]
    assert frozenset({"world", "link7"}) in Contacts().bodies(np.array(below))
    course = points_at([0.0, 20.0, 40.0], [home(robot).tolist(), below, home(robot).tolist()])
    with pytest.raises(CollisionError, match=r"collision of floor and link\d at .* mm after \d+ %"):
        plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, check_limits=checked))


def test_without_limit_checks_a_fast_motion_passes_unchanged(robot: RobotDescription) -> None:
    course = points_at([0.0, 0.1], near_home(robot, 0.0, 0.3))
    motion = plan_waypoints(robot, WaypointRequest(home(robot), course, 0.01, check_limits=False))
    assert motion.duration_s == 0.1


TOOL = Tool(mass=14.0, centre=(0.0, 0.0, 0.2))


def used_effort(of: Arm, motion: Trajectory, tool: Tool) -> float:
    """The largest share of a joint's effort, by pinocchio, every millisecond."""
    model = loaded_model(of.model, of.tcp, tool)
    data, times = model.createData(), np.linspace(0.0, motion.duration_s, int(1e3 * motion.duration_s))
    states = zip(*(motion.sample(times, order) for order in range(3)), strict=True)
    efforts = np.array([pinocchio.rnea(model, data, *state) for state in states])
    return float((np.abs(efforts) / of.robot.limits.max_effort).max())


def swing(robot: RobotDescription, *change: float) -> tuple[Array, list[Waypoint]]:
    """0.8 s with the hand stretched out, by changes of joints 4 and 6."""
    start = home(robot)
    start[5] = 0.5
    end = start.copy()
    end[[3, 5]] += change
    return start, points_at([0.0, 0.8], [start.tolist(), end.tolist()])


def test_what_a_load_makes_too_heavy_for_a_drive_is_slowed_down_by_just_so_much() -> None:
    of = arm("iiwa")
    heavy = carrying(of.robot, TOOL)
    start, course = swing(of.robot, -0.4, -0.3)
    light = plan_waypoints(of.robot, WaypointRequest(start, course, 0.01))
    assert used_effort(of, light, TOOL) > 1.1
    asked = WaypointRequest(start, course, 0.01, retime=True, corridor_rad=1e-3)
    motion = plan_waypoints(heavy, asked)
    assert 0.99 < used_effort(of, motion, TOOL) <= 1.001
    assert "joint6 needs 45" in motion.note
    assert motion.changes.stretch == pytest.approx(motion.duration_s / 0.8)
    assert motion.changes.slowed_s == (0.0, 0.8)
    shares = np.linspace(0.0, 1.0, 50)
    assert motion.sample(shares * motion.duration_s) == pytest.approx(light.sample(shares * 0.8), abs=1e-9)
    message = r"after 7\d % of the motion \(0.6\d+ s\) joint6 needs 45.*, but its limit is 40 N·m; "
    with pytest.raises(LimitError, match=message + r"retime=true .* \(1.37\d s instead of 0.800 s\)"):
        plan_waypoints(heavy, replace(asked, retime=False))
    with pytest.raises(LimitError, match=message + r"within the limits it takes .*, and up to 1.0"):
        plan_waypoints(heavy, replace(asked, longest_s=1.0))


def test_a_few_per_cent_for_the_sake_of_the_drives_are_not_asked_about() -> None:
    of = arm("iiwa")
    start, course = swing(of.robot, -0.4, 0.0)
    motion = plan_waypoints(carrying(of.robot, TOOL), WaypointRequest(start, course, 0.01))
    assert used_effort(of, motion, TOOL) <= 1.001
    assert 0.8 < motion.duration_s < 0.84


def test_a_load_that_cannot_even_be_held_on_the_way_is_refused_at_any_speed() -> None:
    of = arm("iiwa")
    end = home(of.robot) + np.array([0.0, -0.4, 0.0, 0.4, 0.0, -0.4, 0.0])
    asked = WaypointRequest(home(of.robot), points_at([2.0], [end.tolist()]), 0.01, retime=True)
    assert plan_waypoints(of.robot, asked).duration_s == 2.0
    with pytest.raises(
        LimitError, match=r"joint6 needs 42.\d+ N·m, but its limit is 40 N·m; slowing down does not help"
    ):
        plan_waypoints(carrying(of.robot, TOOL), asked)


@pytest.mark.parametrize("name", ["spherical", "gantry"])
def test_random_motions_of_loaded_arms_need_no_more_than_their_drives_have(name: str) -> None:
    of, tool = arm(name), Tool(mass=4.0, centre=(0.0, 0.0, 0.15))
    heavy, random, slowed = carrying(of.robot, tool), np.random.default_rng(SEED), 0
    for _ in range(30):
        start = home(of.robot)
        rows = start + np.cumsum(random.uniform(-0.2, 0.2, (4, len(start))), axis=0)
        asked = WaypointRequest(start, points_at([0.4, 0.8, 1.2, 1.6], rows.tolist()), 0.01, retime=True)
        try:
            motion = plan_waypoints(heavy, asked)
        except (LimitError, CollisionError):
            continue
        assert used_effort(of, motion, tool) <= 1.001, f"seed {SEED}"
        slowed += "needs" in motion.note
    assert slowed > 0
