"""The effect of a planning budget: the duration of a motion divided by its lower bound, for several budgets.

The problems are those of `motion_bench_maker`. The budget is processor time, with the first motion. The lower
bound is the time that the slowest joint needs alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.planning.motion_bench_maker import TIMEOUT_S, Problem, unpacked
from benchmarks.table import Row, row
from cobot.errors import CobotError
from cobot.planners import MotionRequest, plan
from cobot.planners.search.improve import begin, improve
from cobot.robot.description import RobotDescription
from cobot.types import PlannerName, Scaling

BUDGETS_S = (0.05, 0.2, 1.0, 5.0)
COLUMNS = ("first", *(f"{budget_s:g} s" for budget_s in BUDGETS_S))


def budgets(every: int) -> Iterator[Row]:
    """Every so-manyth problem of each scene."""
    for chosen in unpacked("budgets", ["panda"], every):
        rows = np.array([found for each in chosen.problems if (found := ratios(chosen.robot, each))])
        for name, share in (("median", 50.0), ("p95", 95.0)):
            yield row(
                f"duration over its lower bound, {len(rows)} problems, with a budget: {name}",
                "",
                tuple(map(float, np.percentile(rows, share, axis=0))),
                "the lower bound",
                (1.0,) * len(COLUMNS),
                columns=COLUMNS,
            )


def ratios(robot: RobotDescription, problem: Problem) -> list[float]:
    """The duration divided by the lower bound, for the first motion and within each budget; empty if there is
    no motion.
    """
    there = replace(robot, collision=robot.collision.among(problem.scene))
    request = MotionRequest(problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=TIMEOUT_S)
    begun_s = time.process_time()
    try:
        first = plan(there, request)
    except CobotError:
        return []
    if first is None:
        return []
    state = begin(there, request, first)
    found = [first.duration_s / state.lower_bound_s]
    for budget_s in BUDGETS_S:
        left_s = budget_s - (time.process_time() - begun_s)
        if left_s > 0.0:
            state = improve(there, request, state, left_s, clock=time.process_time)
        found.append(state.best.duration_s / state.lower_bound_s)
    return found
