"""How near to the time optimum paths are timed. toppra knows no jerk: its duration cannot be reached."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.jerk_price import Optimiser
from benchmarks.table import Row, percentiles, row
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.path import Path
from cobot.planners.time_law import time_optimal, with_room
from cobot.robot.description import RobotDescription, load_robot
from cobot.trajectory import Trajectory
from cobot.types import PLANNED_ACCELERATION, Array, PlannerName, Pose, Scaling

SPEED = Scaling(1.0)
RATIOS = ("p50", "p95", "largest")
PLACES, GRID = 300, 400
STEPS, PRICED = 60, 0.15
"""Of the optimiser that knows the jerk: steps of time, and the share of the paths that it is asked about."""


def durations(requests: int) -> Iterator[Row]:
    """lin, circ and ompl at full speed: duration beside toppra's on the same path, and what the law costs."""
    try:
        import toppra  # noqa: F401 - a peer, not a dependency
    except ImportError:
        print("toppra is missing: the durations are not compared", flush=True)
        return
    robot, random = load_robot(load_settings(None)), np.random.default_rng(13)
    ours_ms: list[float] = []
    theirs_ms: list[float] = []
    for planner in (PlannerName.LIN, PlannerName.CIRC, PlannerName.OMPL):
        ratios: list[float] = []
        without: list[float] = []
        priced: list[float] = []
        free: list[float] = []
        while len(ratios) < requests:
            motion = _motion(robot, planner, random)
            if motion is None:
                continue
            path = Path.of_trajectory(motion)
            begun = time.process_time()
            with_tcp = planner is not PlannerName.OMPL
            least_s = _toppra(robot, path, with_tcp)
            theirs_ms.append(1e3 * (time.process_time() - begun))
            begun = time.process_time()
            limits = robot.limits.scaled(1.0, 1.0, SPEED.jerk)
            timed = time_optimal(robot, path, limits)
            ours_ms.append(1e3 * (time.process_time() - begun))
            if len(priced) < PRICED * requests:
                best_s = Optimiser(path, with_room(robot, limits), STEPS).shortest_s(timed.progress)
                priced.append(timed.trajectory.duration_s / best_s)
                free.append(_toppra(robot, path, False) / best_s)
            ratios.append(motion.duration_s / least_s)
            without.append(_without_jerk(robot, path, with_tcp) / least_s)
        for name, shares in ((f"duration of {planner}", ratios), (f"{planner} without jerk limits", without)):
            p50, p95, largest = np.percentile(shares, (50.0, 95.0, 100.0))
            yield row(
                f"{name}, as a share of toppra's, which knows no jerk",
                "",
                (float(p50), float(p95), float(largest)),
                "toppra",
                (1.0, 1.0, 1.0),
                columns=RATIOS,
                ratio_of="p50",
                aim="1.1 (p50), 1.25 (p95) where jerk allows it",
            )
        p50, p95, largest = np.percentile(priced, (50.0, 95.0, 100.0))
        yield row(
            f"duration of {planner}, joint limits alone, as a share of what linear programs find, with jerk",
            "",
            (float(p50), float(p95), float(largest)),
            "toppra, without jerk",
            tuple(float(each) for each in np.percentile(free, (50.0, 95.0, 100.0))),
            columns=RATIOS,
            ratio_of="p50",
        )
    yield row("CPU time of the time law", "ms", percentiles(ours_ms), "toppra", percentiles(theirs_ms))


def _motion(robot: RobotDescription, planner: PlannerName, random: np.random.Generator) -> Trajectory | None:
    limits = robot.limits
    start = random.uniform(limits.min_position, limits.max_position)
    here = robot.model.forward(start)
    across, turn = random.normal(size=3), random.normal(size=4) * 0.1
    goal: Pose | Array = Pose(
        here.position + random.uniform(0.1, 0.6) * across / np.linalg.norm(across), here.quaternion + turn
    )
    via = None
    if planner is PlannerName.OMPL:
        goal = random.uniform(limits.min_position, limits.max_position)
    elif planner is PlannerName.CIRC:
        assert isinstance(goal, Pose)
        aside = np.cross(across, random.normal(size=3))
        via = 0.5 * (here.position + goal.position) + 0.1 * aside / np.linalg.norm(aside)
    try:
        return plan(robot, MotionRequest(start, goal, planner, SPEED, via))
    except CobotError:
        return None


def _without_jerk(robot: RobotDescription, path: Path, with_tcp: bool) -> float:
    """The law's duration, s, under toppra's limits: a hundred times the jerk, and all of the acceleration."""
    all_of_it = replace(robot, limits=robot.limits.scaled(1.0, 1.0 / PLANNED_ACCELERATION, 1.0))
    tcp_limits = robot.cartesian_limits.scaled(1.0, 1.0, 100.0) if with_tcp else None
    limits = robot.limits.scaled(1.0, 1.0, 100.0)
    return time_optimal(all_of_it, path, limits, tcp_limits).trajectory.duration_s


def _toppra(robot: RobotDescription, path: Path, with_tcp: bool) -> float:
    """The duration, s; the TCP's way and turn count as two more joints."""
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
