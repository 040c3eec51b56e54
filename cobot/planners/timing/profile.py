"""Ruckig's profiles: the fastest way from rest to rest under velocity, acceleration and jerk limits."""

from __future__ import annotations

import ruckig

from cobot.errors import PlanningError
from cobot.findings import Finding


def fastest_profile(problem: ruckig.InputParameter) -> ruckig.Trajectory:
    """Solve a Ruckig problem.

    Raises:
        PlanningError: Ruckig finds no profile, for example because limits are almost 0.
    """
    solution = ruckig.Trajectory(problem.degrees_of_freedom)
    try:
        result = ruckig.Ruckig(problem.degrees_of_freedom).calculate(problem, solution)
    except (ruckig.RuckigError, ValueError):  # ValueError: Ruckig's binding does not know the result
        result = None
    if result in (ruckig.Result.Working, ruckig.Result.Finished):
        return solution
    raise PlanningError(
        f"no time profile from rest to rest with a velocity of up to {min(problem.max_velocity):.3g}, an "
        f"acceleration of up to {min(problem.max_acceleration):.3g} and a jerk of up to "
        f"{min(problem.max_jerk):.3g} per second: these may be too small",
        findings=[Finding("time", "smallest limit", _smallest(problem), 0.0, "")],
    )


def _smallest(problem: ruckig.InputParameter) -> float:
    limits = (problem.max_velocity, problem.max_acceleration, problem.max_jerk)
    return float(min(min(each) for each in limits))
