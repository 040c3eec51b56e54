"""MotionBenchMaker's problems: the share that cobot solves, and the computing time, next to VAMP and
roboplan.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.planning.motion_bench_maker import ARMS, TIMEOUT_S, Problem, ProblemSet, unpacked
from benchmarks.planning.peers import roboplan, vamp
from benchmarks.planning.peers.searches import MissingPeer, run
from benchmarks.table import Row, row
from cobot.errors import CobotError
from cobot.planners import MotionRequest, plan
from cobot.planners.rrt_connect import connect
from cobot.planners.search.detours import length
from cobot.planners.search.sampling import RANGE_RAD, find_path, room
from cobot.robot.description import RobotDescription
from cobot.types import PlannerName, Scaling

COLUMNS = ("p50", "p95", "max")


@dataclass(slots=True)
class Results:
    """Times in ms of each problem: of its whole plan, its shortened path, and RRT-Connect alone; lengths,
    rad; durations, s. `at_margin` counts the problems whose goals do not keep the margin."""

    plan_ms: list[float]
    path_ms: list[float]
    search_ms: list[float]
    lengths: list[float]
    durations: list[float]
    failures: list[str]
    at_margin: int = 0


def problem_sets(every: int) -> Iterator[Row]:
    """Every so-manyth problem of each scene."""
    for each in unpacked("problem_sets", list(ARMS), every):
        found = measure(each.robot, each.problems)
        print(*found.failures, sep="\n", file=sys.stderr)
        yield from _rows(each.arm, found)
        yield from _beside_peers(each, found)


def _beside_peers(each: ProblemSet, found: Results) -> Iterator[Row]:
    name = f"MotionBenchMaker, {each.arm}: the polyline alone, shortened, {len(found.path_ms)} solved"
    for peer, stages, make in (
        ("VAMP", ("RRT-Connect", "with simplification"), lambda: vamp.search_of(each.arm)),
        ("roboplan", ("RRT-Connect",), lambda: roboplan.search_of(each.arm, each.resources)),
    ):
        try:
            searches = run(make(), each.problems)
        except MissingPeer as exc:
            yield row(name, "ms", _three(found.path_ms), f"{peer}: {exc}", (np.nan,) * 3, columns=COLUMNS)
            continue
        for stage, times_ms in zip(stages, zip(*searches.times_ms, strict=True), strict=True):
            against = f"{peer}, {stage}, {searches.solved}"
            yield row(name, "ms", _three(found.path_ms), against, _three(times_ms), columns=COLUMNS)


def _rows(arm: str, found: Results) -> Iterator[Row]:
    count = len(found.plan_ms) + len(found.failures)
    yield row(
        f"MotionBenchMaker, {arm}, {count} problems: ompl, from request to checked trajectory",
        "ms",
        _three(found.plan_ms),
        "the polyline alone",
        _three(found.path_ms),
        columns=COLUMNS,
        aim="5 / 50 / 500 ms",
    )
    yield row(
        f"MotionBenchMaker, {arm}: RRT-Connect alone",
        "ms",
        _three(found.search_ms),
        "shortened",
        _three(found.path_ms),
        columns=COLUMNS,
        aim="0.5 ms at p50",
    )
    accepted = count - found.at_margin
    yield row(
        f"MotionBenchMaker, {arm}: solved, of the {accepted} problems whose ends keep the margin",
        "%",
        (100.0 * len(found.plan_ms) / accepted,),
        "all",
        (100.0,),
        columns=("solved",),
        aim="100 %",
    )


def measure(robot: RobotDescription, problems: Iterable[Problem]) -> Results:
    """Plan each problem as a whole, then its shortened polyline, then RRT-Connect alone."""
    found = Results([], [], [], [], [], [])
    for problem in problems:
        there = replace(robot, collision=robot.collision.among(problem.scene))
        request = MotionRequest(
            problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=TIMEOUT_S
        )
        begun_ns = time.process_time_ns()
        try:
            motion = plan(there, request)
        except CobotError as exc:
            found.failures.append(f"{problem.name}: {exc}")
            found.at_margin += not there.collision.is_free(problem.goal)
            continue
        found.plan_ms.append((time.process_time_ns() - begun_ns) / 1e6)
        found.durations.append(0.0 if motion is None else motion.duration_s)
        if not there.collision.is_free(problem.start):  # the plan leaves the start before it searches
            continue
        begun_ns = time.process_time_ns()
        corners = find_path(there, request, problem.goal[None])
        found.path_ms.append((time.process_time_ns() - begun_ns) / 1e6)
        found.lengths.append(length(corners))
        found.search_ms.append(_search_ms(there, problem))
    return found


def _search_ms(robot: RobotDescription, problem: Problem) -> float:
    """The time of RRT-Connect alone, with the distance that `find_path` requires."""
    limits, goals = robot.limits, problem.goal[None]
    with robot.collision.keeping(room(robot, np.vstack([problem.start, goals]))) as clearance:
        begun_ns = time.process_time_ns()
        connect(
            clearance,
            problem.start,
            goals,
            limits.min_position,
            limits.max_position,
            1,
            TIMEOUT_S,
            RANGE_RAD,
        )
        return (time.process_time_ns() - begun_ns) / 1e6


def _three(values: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in np.percentile(values, (50.0, 95.0, 100.0)))
