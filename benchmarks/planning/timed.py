"""Timed trajectories from other programs: how much longer than requested they take, and their
planning time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pinocchio
from foreign_trajectories import problems, trapezoid

from benchmarks.arms import SHIPPED, arm, carrying, loaded_model
from benchmarks.table import EACH, Row, percentiles, row
from cobot.config import load_settings
from cobot.errors import LimitError
from cobot.planners import WaypointRequest, plan_waypoints
from cobot.planners.timing.course import through
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.feasibility import check_limits
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, Waypoint

SHARES = (0.1, 0.5, 0.7, 0.9, 1.0)
STEPS_S = (0.1, 0.01, 0.002)
DECIMALS = (3, 4, 5, 6, 15)
OFF_RAD = 1e-5
COLUMNS = ("p50", "p95", "largest")
CORRIDOR_RAD = 1e-3
BEYOND = 1.005
"""Of an effort: the bound of 0.1 % and what the samples of both programs may differ by."""
LOAD = Tool(mass=14.0, centre=(0.0, 0.0, 0.2))


def timed(count: int) -> Iterator[Row]:
    """Durations as multiples of the requested ones, with and without a corridor; then CPU time."""
    robot = replace(load_robot(load_settings(None)), collision=_Nothing())  # type: ignore[arg-type]
    limits, home = robot.limits, np.array(robot.positions["home"].joints)
    yield _durations(
        robot, "trapezoids of 0.6 rad in 1.32 s, at 0.1 to 0.002 s, 3 to 15 decimals", _swings(home)
    )
    for share in SHARES:
        rows = problems(limits, home, share, 0.1, count, seed=1)
        sent = [_points(each[:, 0], *np.split(each[:, 1:], 3, axis=1)) for each in rows]
        yield _durations(robot, f"TOTG of 1 to 5 legs at {share:.0%} of the limits, as MoveIt sends it", sent)
    yield _loaded(robot, count)
    for name, rows in _long(robot):
        for decimals in (6, 3):
            yield from _planned(robot, name, rows[:, 0], np.round(rows[:, 1:], decimals), decimals)


def _loaded(robot: RobotDescription, count: int) -> Row:
    """The number of motions in which a drive exceeds its effort limit, with a load near the maximum,
    according to pinocchio.
    """
    heavy, refused = carrying(robot, LOAD), 0
    ours: list[float] = []
    asked: list[float] = []
    for name in ("home", "work"):
        start = np.array(robot.positions[name].joints)
        for share in SHARES:
            for rows in problems(robot.limits, start, share, 0.1, count, seed=1):
                points = _points(rows[:, 0], *np.split(rows[:, 1:], 3, axis=1))
                asked.append(_effort(robot, through(points, start, robot.limits, 0.0)[0]))
                try:
                    ours.append(_effort(robot, _plan(heavy, points, CORRIDOR_RAD)))
                except LimitError:
                    refused += 1
    values = [(100.0 * np.mean(np.array(each) > BEYOND), 100.0 * max(each)) for each in (ours, asked)]
    return row(
        f"motions with {LOAD.mass:g} kg beyond a drive's effort (of {len(asked)}; {refused} are refused)",
        "",
        values[0],
        "the points as they are sent",
        values[1],
        columns=("beyond, %", "most of an effort, %"),
        aim="0",
    )


def _effort(robot: RobotDescription, motion: Trajectory) -> float:
    """The largest share of a drive's effort limit, sampled every 2 ms."""
    shipped = arm(SHIPPED)
    model = loaded_model(shipped.model, shipped.tcp, LOAD)
    data, times_s = model.createData(), np.arange(0.0, motion.duration_s, 0.002)
    states = zip(*(motion.sample(times_s, order) for order in range(3)), strict=True)
    efforts = np.array([pinocchio.rnea(model, data, *state) for state in states])
    return float((np.abs(efforts) / robot.limits.max_effort).max())


class _Nothing:
    """A stand-in for an empty scene."""

    def check_trajectory(self, trajectory: Trajectory) -> None:
        """Accept every trajectory as collision-free."""


def _durations(robot: RobotDescription, name: str, sent: list[list[Waypoint]]) -> Row:
    ours, evenly = [], []
    for points in sent:
        asked_s = points[-1].time_from_start_s
        ours.append(_plan(robot, points, CORRIDOR_RAD).duration_s / asked_s)
        evenly.append(_plan(robot, points, 0.0).duration_s / asked_s)
    values = [np.percentile(each, (50.0, 95.0, 100.0)).tolist() for each in (ours, evenly)]
    name = f"duration in shares of the asked one: {name}"
    return row(
        name, "", values[0], "slowed down evenly", values[1], columns=COLUMNS, ratio_of=EACH, aim="1.05"
    )


def _planned(
    robot: RobotDescription, name: str, times_s: Array, positions: Array, decimals: int
) -> Iterator[Row]:
    points = _points(times_s, positions)
    begun_s = time.process_time()
    motion = _plan(robot, points, CORRIDOR_RAD)
    ours_s = time.process_time() - begun_s
    begun_s = time.process_time()
    exact, _ = through(points, positions[0], robot.limits, 0.0)
    try:
        check_limits(exact, robot.limits)
    except LimitError:
        said = "beyond them"
    else:
        said = "within them"
    floor_s = time.process_time() - begun_s
    ratio = motion.duration_s / times_s[-1]
    yield row(
        f"CPU time of {len(points):,} points, {name}, {decimals} decimals ({ratio:.3f} of the asked time)",
        "s",
        percentiles([ours_s]),
        f"interpolating them and checking the limits ({said})",
        percentiles([floor_s]),
        aim="3 s",
    )


def _plan(robot: RobotDescription, points: list[Waypoint], corridor_rad: float) -> Trajectory:
    start = np.array(points[0].positions)
    start[0] -= OFF_RAD
    return plan_waypoints(robot, WaypointRequest(start, points, 0.01, retime=True, corridor_rad=corridor_rad))


def _swings(home: Array) -> list[list[Waypoint]]:
    found = []
    for step_s in STEPS_S:
        times_s = np.append(np.arange(0.0, 1.32 - 1e-9, step_s), 1.32)
        for joint in (0, 6):
            for speed in (0.5, 0.6, 0.75, 0.9):
                for decimals in DECIMALS:
                    positions = np.repeat(home[None], len(times_s), axis=0)
                    positions[:, joint] += trapezoid(times_s, 0.6, speed, 1.32)
                    found.append(_points(times_s, np.round(positions, decimals)))
    return found


def _long(robot: RobotDescription) -> Iterator[tuple[str, Array]]:
    """A long path back and forth, timed by TOTG: times and positions, shape (n, 1 + dof)."""
    limits, home = robot.limits, np.array(robot.positions["home"].joints)
    for share in (0.5, 0.9):
        (sent,) = problems(limits, home, share, 0.002, 1, seed=2, most_legs=20, grid=4000)
        once = sent[:-1, 1 : 1 + limits.dof]
        for rows in (5_000, 50_000):
            times = max(round(rows / (2 * len(once))), 1)
            positions = np.tile(np.vstack([once, once[::-1]]), (times, 1))
            table = np.column_stack([0.002 * np.arange(len(positions)), positions])
            yield f"TOTG at {share:.0%} of the limits, every 2 ms", table


def _points(times_s: Array, *values: Array) -> list[Waypoint]:
    rows = [each.tolist() for each in values]
    return [
        Waypoint(positions, time_s, *rates)
        for time_s, positions, *rates in zip(times_s.tolist(), *rows, strict=True)
    ]
