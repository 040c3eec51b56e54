"""The time law along a path.

Oracle: toppra's duration on the same path, without jerk limits, which nothing can beat; Ruckig on a straight
line; eigenvalues for extrema; pinocchio for torques and for the motion of the TCP.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
import ruckig
from independent_models import second_robot

from benchmarks.planning.jerk_price import Optimiser
from cobot.errors import PlanningError
from cobot.planners import MotionRequest, plan
from cobot.planners.effort_reserve import PLANNED_EFFORT
from cobot.planners.search.spline import control_spline, resampled
from cobot.planners.timing.coordinates import Coordinates, Zones
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import Timed, time_optimal, with_room
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.trajectory import Trajectory
from cobot.types import (
    PLANNED_ACCELERATION,
    Array,
    CartesianLimits,
    JointLimits,
    PlannerName,
    Pose,
    Scaling,
    Synchronization,
)

SEED = 20261122
ROUNDING = 1.0 + 1e-9
SLOWEST = (
    np.array([2.66, 1.0181, -1.3849, 0.0279, -2.3634, 0.7365, -0.7479]),
    Pose(np.array([-0.776, 0.3592, 0.507]), np.array([0.61633, 0.29657, -0.16455, -0.71071])),
)
"""A line that begins near a singularity: one S-curve for all of it, set by its worst place, takes 22 s."""
TOOL_KG, TOOL_M = 14.0, 0.125


def planned_limits(robot: RobotDescription) -> JointLimits:
    return robot.limits.scaled(1.0, PLANNED_ACCELERATION, Scaling(1.0).shares[2])


def random_path(
    robot: RobotDescription, random: np.random.Generator, points: int, spread: float
) -> JointCurve:
    middle = random.uniform(0.4 * robot.limits.min_position, 0.4 * robot.limits.max_position)
    steps = random.normal(size=(points, robot.limits.dof)) * spread
    return JointCurve.through(np.linspace(0.0, 1.0, points), middle + np.cumsum(steps, axis=0))


def random_paths(robot: RobotDescription, count: int = 12) -> list[JointCurve]:
    random = np.random.default_rng(SEED)
    sizes = zip(random.integers(6, 10, count), random.uniform(0.15, 0.6, count), strict=True)
    return [random_path(robot, random, int(points), float(spread)) for points, spread in sizes]


def require_limits(trajectory: Trajectory, limits: JointLimits) -> float:
    """The greatest use of a limit."""
    bounds = (limits.max_velocity, limits.max_acceleration, limits.max_jerk)
    used = [
        float((np.maximum(*np.abs(trajectory.extrema(order))) / bound).max())
        for order, bound in enumerate(bounds, 1)
    ]
    assert max(used) <= ROUNDING
    for order in (1, 2):
        assert np.abs(trajectory.sample([0.0, trajectory.duration_s], order)).max() < 1e-9
    return max(used)


def least_duration_s(
    path: JointCurve, limits: JointLimits, extra: tuple[Array, Array, Array] | None = None
) -> float:
    """By toppra, under velocities and accelerations; `extra` is one more coordinate and its two limits."""
    # It imports Matplotlib, for which each process of the tests would wait.
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

    places = np.linspace(0.0, path.length, 400)
    rows, velocity, acceleration = path.at(places), limits.max_velocity, limits.max_acceleration
    if extra is not None:
        rows = np.concatenate([rows, places[:, None] * extra[0]], axis=1)
        velocity, acceleration = np.append(velocity, extra[1]), np.append(acceleration, extra[2])
    bounds = [np.stack([-each, each], axis=1) for each in (velocity, acceleration)]
    constraints = [JointVelocityConstraint(bounds[0]), JointAccelerationConstraint(bounds[1])]
    spline = toppra.SplineInterpolator(places, rows)
    grid = np.linspace(0.0, path.length, 401)
    return float(TOPPRA(constraints, spline, gridpoints=grid).compute_trajectory(0.0, 0.0).duration)


def carrying(robot: RobotDescription, mass_kg: float) -> RobotDescription:
    """With a point mass beyond the flange."""
    mj = copy.copy(robot.model.mj)
    body = mj.body("link7").id
    own = mj.body_mass[body]
    mj.body_ipos[body] = (own * mj.body_ipos[body] + mass_kg * np.array([0.0, 0.0, TOOL_M])) / (own + mass_kg)
    mj.body_mass[body] = own + mass_kg
    return replace(robot, model=RobotModel(mj, robot.limits, "base_link", "tcp"))


def torques(robot: RobotDescription, trajectory: Trajectory) -> Array:
    """By pinocchio, with the last link of the robot's model, shape (n, dof)."""
    model = second_robot().model.copy()
    body, last = robot.model.mj.body("link7").id, model.nq
    inertia = model.inertias[last]
    inertia.mass = float(robot.model.mj.body_mass[body])
    inertia.lever = robot.model.mj.body_ipos[body].copy()
    model.inertias[last] = inertia
    data, times = model.createData(), np.linspace(0.0, trajectory.duration_s, 1000)
    states = zip(*(trajectory.sample(times, order) for order in range(3)), strict=True)
    return np.array([pinocchio.rnea(model, data, *state) for state in states])


def test_random_paths_are_followed_within_the_limits_on_true_extrema(robot: RobotDescription) -> None:
    limits = planned_limits(robot)
    for path in random_paths(robot):
        timed = time_optimal(robot, path, limits)
        assert require_limits(timed.trajectory, limits) > 0.99
        times = np.linspace(0.0, timed.trajectory.duration_s, 1500)
        progress = timed.progress.sample(times)[:, 0]
        assert (progress[0], progress[-1]) == pytest.approx((0.0, path.length), abs=1e-12)
        assert np.diff(progress).min() > -1e-12
        np.testing.assert_allclose(timed.trajectory.sample(times), path.at(progress), atol=2e-6)
        np.testing.assert_allclose(timed.trajectory.end, path.at(np.array([path.length]))[0], atol=1e-9)


def test_random_paths_take_little_longer_than_without_jerk_limits(robot: RobotDescription) -> None:
    limits = planned_limits(robot)
    ratios = [
        time_optimal(robot, path, limits).trajectory.duration_s / least_duration_s(path, limits)
        for path in random_paths(robot)
    ]
    assert min(ratios) > 0.999, "toppra's optimum on the same path cannot be beaten"
    assert np.median(ratios) < 1.10
    assert np.percentile(ratios, 95) < 1.25


def test_a_short_line_takes_as_long_as_another_optimiser_finds_under_the_same_limits(
    robot: RobotDescription,
) -> None:
    # There jerk costs most, up to 1.4 times toppra's duration. Oracle: sequential linear programs over time.
    random, limits = np.random.default_rng(23), planned_limits(robot)
    home = np.array(robot.positions["home"].joints)
    start = home + random.uniform(-0.3, 0.3, 7)
    here, across = robot.model.forward(start), random.normal(size=3)
    goal = Pose(here.position + 0.1 * across / np.linalg.norm(across), here.quaternion)
    line = plan(robot, MotionRequest(start, goal, PlannerName.LIN, Scaling(1.0)))
    assert line is not None
    path = JointCurve.of_trajectory(line)
    timed = time_optimal(robot, path, limits)
    best_s = Optimiser(path, with_room(robot, limits), 40).shortest_s(timed.progress)
    assert 0.98 * best_s < timed.trajectory.duration_s < 1.01 * best_s


def fastest_s(limits: JointLimits, way: Array) -> float:
    """The shortest time for a straight way, shape (dof,), from rest to rest, by Ruckig."""
    problem, solution = ruckig.InputParameter(1), ruckig.Trajectory(1)
    problem.target_position = [1.0]
    for name in ("velocity", "acceleration", "jerk"):
        setattr(problem, f"max_{name}", [float((getattr(limits, f"max_{name}") / np.abs(way)).min())])
    ruckig.Ruckig(1).calculate(problem, solution)
    return float(solution.duration)


@pytest.mark.parametrize("distance_rad", [1e-5, 1e-3, 0.05, 0.3, 2.0])
def test_a_straight_line_takes_as_long_as_ruckig_in_phase(
    robot: RobotDescription, distance_rad: float
) -> None:
    limits = planned_limits(robot)
    start = 0.3 * robot.limits.min_position
    way = distance_rad * np.array([1.0, -0.7, 0.5, 0.3, -0.9, 0.2, 0.1])
    timed = time_optimal(robot, JointCurve.straight(start, start + way), limits)
    require_limits(timed.trajectory, limits)
    assert 0.9999 < timed.trajectory.duration_s / fastest_s(limits, way) < 1.01


@pytest.mark.parametrize("speed", [0.03, 0.1])
def test_a_slow_motion_needs_few_segments_and_takes_no_longer_than_ruckigs(
    robot: RobotDescription, speed: float
) -> None:
    start, way = 0.3 * robot.limits.min_position, np.array([1.0, -0.7, 0.5, 0.3, -0.9, 0.2, 0.1])
    limits = robot.limits.scaled(speed, PLANNED_ACCELERATION, Scaling(1.0).shares[2])
    timed = time_optimal(robot, JointCurve.straight(start, start + way), limits)
    require_limits(timed.trajectory, limits)
    assert 0.9999 < timed.trajectory.duration_s / fastest_s(limits, way) < 1.002
    assert timed.trajectory.segments < 250  # with cells of equal duration: 472 and 1000


@pytest.mark.parametrize("speed", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("more", [1.0, 10.0, 50.0])
def test_a_line_of_an_arm_with_high_jerk_limits_takes_no_longer_than_ruckigs(
    robot: RobotDescription, speed: float, more: float
) -> None:
    """As a Franka, whose acceleration builds up in 2 ms: cells must not get longer so soon that the jerk
    limit, which is small for the speed, makes the arm brake in the middle of its way.
    """
    start, way = 0.3 * robot.limits.min_position, np.array([1.0, -0.7, 0.5, 0.3, -0.9, 0.2, 0.1])
    scaled = robot.limits.scaled(speed, min(speed, PLANNED_ACCELERATION), Scaling(speed).shares[2])
    limits = scaled.with_rates(scaled.max_velocity, scaled.max_acceleration, more * scaled.max_jerk)
    timed = time_optimal(robot, JointCurve.straight(start, start + way), limits)
    require_limits(timed.trajectory, limits)
    assert 0.9999 < timed.trajectory.duration_s / fastest_s(limits, way) < 1.005


@pytest.mark.parametrize(
    ("speed", "share", "longest_s"), [(0.1, 0.5, 21.5), (0.1, 0.1, 26.0), (0.3, 0.1, 8.7)]
)
def test_a_short_slow_part_of_a_long_path_slows_only_this_part(
    robot: RobotDescription, speed: float, share: float, longest_s: float
) -> None:
    """As a short slow motion between two long ones, with blends. Without the slow part it takes 20.4 and
    7.1 s.
    """
    ends, dof = 0.5 * np.array([robot.limits.min_position, robot.limits.max_position]), robot.limits.dof
    path = JointCurve.straight(*ends)
    shares = np.ones((3, 3, dof + 2))
    shares[0, 1] = share
    zones = Zones(path.length * np.array([0.5, 0.505, 1.0]), shares)
    limits = robot.limits.scaled(speed, speed, speed)
    motion = time_optimal(robot, path, limits, zones=zones).trajectory
    require_limits(motion, limits)
    times = np.linspace(0.0, motion.duration_s, 20001)
    way = (motion.sample(times)[:, 0] - ends[0, 0]) / np.ptp(ends[:, 0])
    inside = (way > 0.5) & (way < 0.505)
    used = np.abs(motion.sample(times[inside], 1)) / limits.max_velocity
    assert 0.9 * share < used.max() < share * ROUNDING
    assert motion.duration_s < longest_s


@pytest.mark.parametrize("share", [1e-6, 0.01])
def test_the_law_is_the_same_in_slow_motion(robot: RobotDescription, share: float) -> None:
    """Velocities by f, accelerations by f², jerks by f³: the same motion in 1/f of the time."""
    limits, path = planned_limits(robot), random_paths(robot, 1)[0]
    usual = time_optimal(robot, path, limits).trajectory.duration_s
    slow = time_optimal(robot, path, limits.scaled(share, share**2, share**3)).trajectory.duration_s
    assert slow * share == pytest.approx(usual, rel=1e-6)


def test_limits_that_are_all_but_zero_are_refused(robot: RobotDescription) -> None:
    with pytest.raises(PlanningError, match="no motion along the path"):
        time_optimal(robot, random_paths(robot, 1)[0], robot.limits.scaled(1e-300, 1e-300, 1e-300))


def test_a_line_is_slow_only_where_a_joint_has_to_be(robot: RobotDescription) -> None:
    start, goal = SLOWEST
    motion = plan(robot, MotionRequest(start, goal, PlannerName.LIN, Scaling(1.0)))
    assert motion is not None
    assert require_limits(motion, planned_limits(robot)) > 0.99
    assert motion.duration_s < 1.3
    path, tcp = JointCurve.of_trajectory(motion), robot.cartesian_limits
    length = np.linalg.norm(np.asarray(goal.position) - robot.model.forward(start).position)
    assert motion.duration_s <= 1.25 * max(
        least_duration_s(path, robot.limits), length / tcp.max_linear_velocity
    )


def test_what_a_line_deviates_in_orientation_is_no_coordinate_but_stays_within_the_limits(
    robot: RobotDescription,
) -> None:
    start = np.array(robot.positions["home"].joints)
    here = robot.model.forward(start)
    goal = Pose(here.position + np.array([-0.05, -0.1, 0.1]), here.quaternion)
    line = plan(robot, MotionRequest(start, goal, PlannerName.LIN, Scaling(1.0)))
    assert line is not None
    path, tcp = JointCurve.of_trajectory(line), robot.cartesian_limits
    assert len(Coordinates(robot.model, path, robot.limits, tcp).max_jerk) == 7 + 1
    times = np.linspace(0.0, line.duration_s, 400)
    twists = robot.model.chain.twists(line.sample(times), line.sample(times, 1))[:, 3:]
    jerk = np.gradient(np.gradient(twists, times, axis=0), times, axis=0)
    assert np.abs(twists).max() < 1e-3 * tcp.max_angular_velocity
    assert np.abs(jerk).max() < tcp.max_angular_jerk


def followed(robot: RobotDescription, timed: Timed) -> tuple[Array, Array]:
    """The TCP's velocity and acceleration by pinocchio's Jacobian, shape (n, 6) each; and steps between."""
    times = np.linspace(0.0, timed.trajectory.duration_s, 4001)
    joints, rates = timed.trajectory.sample(times), timed.trajectory.sample(times, 1)
    twists = np.array([second_robot().jacobian(q) @ v for q, v in zip(joints, rates, strict=True)])
    return twists, np.diff(twists, axis=0) / (times[1] - times[0])


@pytest.mark.parametrize("bent", [False, True])
def test_the_tcp_keeps_its_own_limits_and_uses_them(robot: RobotDescription, bent: bool) -> None:
    work = np.array(robot.positions["work"].joints)
    here = robot.model.forward(work)
    via = here.position + np.array([0.05, 0.1, 0.0]) if bent else None
    goal = Pose(here.position + np.array([0.0, 0.2, 0.0]), here.quaternion)
    planner = PlannerName.CIRC if bent else PlannerName.LIN
    motion = plan(robot, MotionRequest(work, goal, planner, Scaling(0.3, 0.2), via))
    assert motion is not None
    limits = robot.cartesian_limits.scaled(0.3, 0.2, 0.2)
    twists, accelerations = followed(robot, Timed(motion, lambda: motion))
    speed = np.linalg.norm(twists[:, :3], axis=1).max() / limits.max_linear_velocity
    change = np.linalg.norm(accelerations[:, :3], axis=1).max() / limits.max_linear_acceleration
    assert max(speed, change) <= 1.002
    assert max(speed, change) > (0.75 if bent else 0.97)  # In between tangent and normal it may use less.


def test_a_turn_keeps_the_angular_limits(robot: RobotDescription) -> None:
    limits = planned_limits(robot)
    slow = CartesianLimits(1.0, 4.0, 40.0, 0.3, 0.8, 6.0)
    path = random_paths(robot, 2)[1]
    twists, accelerations = followed(robot, time_optimal(robot, path, limits, slow))
    assert 0.97 < np.linalg.norm(twists[:, 3:], axis=1).max() / 0.3 < 1.002
    assert np.linalg.norm(accelerations[:, 3:], axis=1).max() / 0.8 < 1.002
    assert np.linalg.norm(twists[:, :3], axis=1).max() <= 1.002
    assert np.linalg.norm(accelerations[:, :3], axis=1).max() <= 4.0 * 1.002


def test_with_a_heavy_tool_no_joint_needs_more_than_its_drive_has(robot: RobotDescription) -> None:
    heavy, limits = carrying(robot, TOOL_KG), planned_limits(robot)
    random, beyond = np.random.default_rng(SEED), 0
    for _ in range(40):
        path = random_path(robot, random, 6, 0.8)
        light = time_optimal(robot, path, limits).trajectory
        if (np.abs(torques(heavy, light)) / limits.max_effort).max() <= 1.0:
            continue
        beyond += 1
        timed = time_optimal(heavy, path, limits)
        require_limits(timed.trajectory, limits)
        used = (np.abs(torques(heavy, timed.trajectory)) / limits.max_effort).max()
        assert used <= PLANNED_EFFORT + 0.002, "some of it is left for the drives to correct with"
        assert timed.trajectory.duration_s < 1.5 * light.duration_s
    assert beyond >= 2, "the efforts were to count"


def nearest(path: Trajectory, points: Array) -> Array:
    """How far each point, shape (n, dof), is from a path, rad."""
    along = path.sample(np.linspace(0.0, path.duration_s, 5000))
    return np.array([np.linalg.norm(along - point, axis=1).min() for point in points])


@pytest.mark.parametrize("way", Synchronization)
def test_ptp_with_a_heavy_tool_is_slowed_down_on_its_path(
    robot: RobotDescription, way: Synchronization
) -> None:
    heavy = carrying(robot, TOOL_KG)
    start = np.array([-1.5, 0.6, 0.0, -1.2, 0.0, -1.0, 0.0])
    goal = np.array([1.5, 0.9, 0.4, -0.9, 0.5, -0.6, 0.9])
    request = MotionRequest(start, goal, PlannerName.PTP, Scaling(1.0), synchronization=way)
    free = plan(heavy, request)
    assert free is not None
    max_effort = robot.limits.max_effort.copy()
    max_effort[0] = 0.7 * np.abs(torques(heavy, free)[:, 0]).max()  # Its axis is vertical: it need not hold.
    weak = replace(heavy, limits=replace(robot.limits, max_effort=max_effort))
    motion = plan(weak, request)
    assert motion is not None
    assert (np.abs(torques(heavy, motion)) / max_effort).max() <= PLANNED_EFFORT + 0.002
    assert free.duration_s < motion.duration_s < 1.5 * free.duration_s
    assert nearest(free, motion.sample(np.linspace(0.0, motion.duration_s, 200))).max() < 1e-3


@pytest.mark.parametrize("share", [0.9, 0.99])
def test_an_arm_moves_where_holding_it_takes_nearly_all_of_an_effort(
    robot: RobotDescription, share: float
) -> None:
    start, goal = np.array([[0.0, 0.8, 0.0, -0.8, 0.0, 0.5, 0.0], [0.3, 0.9, 0.0, -0.6, 0.0, 0.6, 0.0]])
    way = start + np.linspace(0.0, 1.0, 200)[:, None] * (goal - start)
    held = np.abs([robot.model.gravity_torques(joints)[1] for joints in way]).max()
    max_effort = robot.limits.max_effort.copy()
    max_effort[1] = held / share
    weak = replace(robot, limits=replace(robot.limits, max_effort=max_effort))
    motion = plan(weak, MotionRequest(start, goal, PlannerName.PTP, Scaling(1.0)))
    assert motion is not None
    used = (np.abs(torques(weak, motion)) / max_effort).max()
    assert used <= max(PLANNED_EFFORT, 0.5 * (1.0 + share)) + 0.001
    assert motion.duration_s < 5.0


def test_a_spline_nearer_to_its_corners_takes_little_longer(robot: RobotDescription) -> None:
    """Sixteen times the points: under one S-curve for the whole path five times the duration."""
    random, limits = np.random.default_rng(SEED), planned_limits(robot)
    for _ in range(3):
        corners = random.uniform(0.4 * limits.min_position, 0.4 * limits.max_position, (4, limits.dof))
        few, many = (
            time_optimal(robot, JointCurve.of_spline(control_spline(resampled(corners, points))), limits)
            for points in (12, 192)
        )
        assert many.trajectory.duration_s < 1.5 * few.trajectory.duration_s


def test_what_the_drives_cannot_even_hold_is_refused_with_the_joint_and_the_place(
    robot: RobotDescription,
) -> None:
    stretched = np.array([0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])
    path = JointCurve.straight(stretched, stretched + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    message = r"joint\d needs \d+\.?\d* N·m to hold the arm at \d+ % of the path, but its limit is \d+ N·m"
    with pytest.raises(PlanningError, match=message):
        time_optimal(carrying(robot, 40.0), path, planned_limits(robot))
