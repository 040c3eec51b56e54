"""How close timed paths are to the time optimum. toppra has no jerk limits, so its duration cannot be
reached.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from foreign_trajectories import problems

from benchmarks.planning.jerk_price import Optimiser
from benchmarks.table import Row, percentiles, row
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.motions.requests import MotionRequest
from cobot.planners import WaypointRequest, plan, plan_waypoints
from cobot.planners.blending.joined import Leg, joined, leg_of
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import time_optimal, with_room
from cobot.robot.description import RobotDescription, load_robot
from cobot.trajectory import Trajectory
from cobot.types import PLANNED_ACCELERATION, Array, PlannerName, Pose, Scaling, Waypoint

SPEED = Scaling(1.0)
RATIOS = ("p50", "p95", "largest")
PLACES, GRID = 300, 400
CORNERS, RADIUS_M = 2, 0.05
STEPS, PRICED = 60, 0.15
"""Of the optimiser that knows the jerk: steps of time, and the share of the paths that it is asked about."""


def durations(requests: int) -> Iterator[Row]:
    """Motions at full speed: their duration next to toppra's on the same path, and the CPU time of the time
    law. For lin, circ and ompl also the share of the duration that the jerk limits cause.
    """
    try:
        import toppra  # noqa: F401 - a peer, not a dependency
    except ImportError:
        print("toppra is missing: the durations are not compared", flush=True)
        return
    robot, random = load_robot(load_settings(None)), np.random.default_rng(13)
    ours_ms: list[float] = []
    theirs_ms: list[float] = []
    for planner in (PlannerName.LIN, PlannerName.CIRC, PlannerName.OMPL):
        found = _measured(robot, planner, random, requests)
        ours_ms += found.ours_ms
        theirs_ms += found.theirs_ms
        yield _beside_toppra(f"duration of {planner}", found.ratios)
        yield _beside_toppra(f"{planner} without jerk limits", found.without_jerk)
        yield row(
            f"duration of {planner}, joint limits alone, as a share of what linear programs find, with jerk",
            "",
            _three(found.priced),
            "toppra, without jerk",
            _three(found.priced_toppra),
            columns=RATIOS,
            ratio_of="p50",
        )
    yield row("CPU time of the time law", "ms", percentiles(ours_ms), "toppra", percentiles(theirs_ms))
    for name, motion_of, with_tcp in (
        ("polyline, 50 mm at 2 corners", lambda: _motion(robot, PlannerName.POLYLINE, random), True),
        ("chomp", lambda: _motion(robot, PlannerName.CHOMP, random), False),
        ("3 lin motions, 50 mm at 2 corners", lambda: _blended(robot, random), True),
        ("what TOTG sends at all limits", lambda: _retimed(robot, random), False),
    ):
        ratios: list[float] = []
        while len(ratios) < requests:
            if (motion := motion_of()) is not None:
                path = JointCurve.of_trajectory(motion)
                ratios.append(motion.duration_s / _toppra(robot, path, with_tcp))
        yield _beside_toppra(f"duration of {name}", ratios)


@dataclass(slots=True)
class _Measured:
    """The motions of one planner.

    Attributes:
        ours_ms, theirs_ms: CPU time of the time law and of toppra.
        ratios, without_jerk: durations with and without jerk limits, as shares of toppra's.
        priced, priced_toppra: durations under joint limits alone, and toppra's, as shares of what linear
            programs find with jerk; of some motions.
    """

    ours_ms: list[float] = field(default_factory=list)
    theirs_ms: list[float] = field(default_factory=list)
    ratios: list[float] = field(default_factory=list)
    without_jerk: list[float] = field(default_factory=list)
    priced: list[float] = field(default_factory=list)
    priced_toppra: list[float] = field(default_factory=list)


def _measured(
    robot: RobotDescription, planner: PlannerName, random: np.random.Generator, requests: int
) -> _Measured:
    found, with_tcp = _Measured(), planner is not PlannerName.OMPL
    while len(found.ratios) < requests:
        motion = _motion(robot, planner, random)
        if motion is None:
            continue
        path = JointCurve.of_trajectory(motion)
        begun = time.process_time()
        least_s = _toppra(robot, path, with_tcp)
        found.theirs_ms.append(1e3 * (time.process_time() - begun))
        begun = time.process_time()
        limits = robot.limits.scaled(*SPEED.shares)
        timed = time_optimal(robot, path, limits)
        found.ours_ms.append(1e3 * (time.process_time() - begun))
        if len(found.priced) < PRICED * requests:
            best_s = Optimiser(path, with_room(robot, limits), STEPS).shortest_s(timed.progress)
            found.priced.append(timed.trajectory.duration_s / best_s)
            found.priced_toppra.append(_toppra(robot, path, False) / best_s)
        found.ratios.append(motion.duration_s / least_s)
        found.without_jerk.append(_without_jerk(robot, path, with_tcp) / least_s)
    return found


def _beside_toppra(name: str, shares: list[float]) -> Row:
    return row(
        f"{name}, as a share of toppra's, which knows no jerk",
        "",
        _three(shares),
        "toppra",
        (1.0, 1.0, 1.0),
        columns=RATIOS,
        ratio_of="p50",
        aim="1.1 (p50), 1.25 (p95) where jerk allows it",
    )


def _three(values: list[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in np.percentile(values, (50.0, 95.0, 100.0)))


def _motion(robot: RobotDescription, planner: PlannerName, random: np.random.Generator) -> Trajectory | None:
    limits = robot.limits
    start = random.uniform(limits.min_position, limits.max_position)
    here = robot.model.forward(start)
    across, turn = random.normal(size=3), random.normal(size=4) * 0.1
    goal: Pose | Array = Pose(
        here.position + random.uniform(0.1, 0.6) * across / np.linalg.norm(across), here.quaternion + turn
    )
    via = None
    through: tuple[Pose, ...] = ()
    if planner is PlannerName.POLYLINE:
        through = tuple(
            Pose(here.position + random.uniform(-0.3, 0.3, 3), here.quaternion) for _ in range(CORNERS)
        )
    if planner in (PlannerName.OMPL, PlannerName.CHOMP):
        goal = random.uniform(limits.min_position, limits.max_position)
    elif planner is PlannerName.CIRC:
        assert isinstance(goal, Pose)
        aside = np.cross(across, random.normal(size=3))
        via = 0.5 * (here.position + goal.position) + 0.1 * aside / np.linalg.norm(aside)
    try:
        radius_m = RADIUS_M if through else 0.0
        return plan(
            robot, MotionRequest(start, goal, planner, SPEED, via, through=through, radius_m=radius_m)
        )
    except CobotError:
        return None


def _blended(robot: RobotDescription, random: np.random.Generator) -> Trajectory | None:
    """Lines as one motion; None if one of the lines is impossible or a corner cannot be round."""
    legs: list[Leg] = []
    start = random.uniform(robot.limits.min_position, robot.limits.max_position)
    here = robot.model.forward(start)
    for _ in range(CORNERS + 1):
        goal = Pose(here.position + random.uniform(-0.3, 0.3, 3), here.quaternion)
        request = MotionRequest(start, goal, PlannerName.LIN, SPEED)
        try:
            motion = plan(robot, request)
        except CobotError:
            return None
        if motion is None:
            return None
        legs.append(leg_of(robot, request, motion))
        start = motion.end
    whole = joined(robot, legs, [RADIUS_M] * CORNERS)
    return whole.trajectory if all(whole.blended) else None


def _retimed(robot: RobotDescription, random: np.random.Generator) -> Trajectory | None:
    """A path of several legs, timed by TOTG at the velocity and acceleration limits."""
    home = np.array(robot.positions["home"].joints)
    (rows,) = problems(robot.limits, home, 1.0, 0.02, 1, seed=int(random.integers(2**31)))
    points = [Waypoint(each[1 : 1 + len(home)].tolist(), float(each[0])) for each in rows]
    try:
        return plan_waypoints(robot, WaypointRequest(home, points, 0.01, retime=True, corridor_rad=1e-3))
    except CobotError:
        return None


def _without_jerk(robot: RobotDescription, path: JointCurve, with_tcp: bool) -> float:
    """The duration that the time law finds within toppra's limits: a hundred times the jerk, and all of the
    acceleration, s.
    """
    all_of_it = replace(robot, limits=robot.limits.scaled(1.0, 1.0 / PLANNED_ACCELERATION, 1.0))
    tcp_limits = robot.cartesian_limits.scaled(1.0, 1.0, 100.0) if with_tcp else None
    limits = robot.limits.scaled(1.0, 1.0, 100.0)
    return time_optimal(all_of_it, path, limits, tcp_limits).trajectory.duration_s


def _toppra(robot: RobotDescription, path: JointCurve, with_tcp: bool) -> float:
    """The duration that toppra finds, s. The distance and the rotation of the TCP count as two additional
    joints.
    """
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint

    toppra.setup_logging("ERROR")
    places = np.linspace(0.0, path.length, PLACES)
    rows, limits, tcp = path.at(places), robot.limits, robot.cartesian_limits
    velocity, acceleration = limits.max_velocity, limits.max_acceleration
    if with_tcp:
        rates = robot.model.chain.twists(rows, path.at(places, 1))
        speeds = np.stack(
            [np.linalg.norm(rates[:, :3], axis=1), np.linalg.norm(rates[:, 3:], axis=1)], axis=1
        )
        steps = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(places)[:, None]
        ways = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        rows = np.concatenate([rows, ways], axis=1)
        velocity = np.append(velocity, [tcp.max_linear_velocity, tcp.max_angular_velocity])
        acceleration = np.append(acceleration, [tcp.max_linear_acceleration, tcp.max_angular_acceleration])
    constraints = [
        JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
        JointAccelerationConstraint(np.stack([-acceleration, acceleration], axis=1)),
    ]
    spline = toppra.SplineInterpolator(places, rows)
    problem = TOPPRA(constraints, spline, gridpoints=np.linspace(0.0, path.length, GRID + 1))
    found = problem.compute_trajectory(0.0, 0.0)
    return float(found.duration) if found is not None else float("nan")
