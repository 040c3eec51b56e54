"""Plans within a time budget: first one motion, then faster ones.

A planning process improves a motion for a short time and then returns it. So the process is free for other
tasks in between, and if it is killed, the last returned motion remains.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Protocol, TypeVar

from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import improve_motion
from cobot.clock import Clock
from cobot.errors import PlanningError, UnavailableError
from cobot.motions.improving import Improving
from cobot.motions.planners import Way
from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory

Result = TypeVar("Result")
SLICE_S = 0.1
"""Time for which a process improves a motion before it returns the motion, s. The last attempt may take
longer.
"""
MIN_SLICE_S = 0.002
"""Minimum duration of a slice, s. For a shorter one, sending the motion to a process does not pay."""
OVERTIME_S = 1.0
"""How long to wait for a slice after the end of the budget, s. All planning processes may be busy, and an
attempt may take a long time.
"""

log = logging.getLogger("cobot.planning")


class Compute(Protocol):
    """Runs a function in a planning process."""

    def __call__(self, work: Callable[[RobotDescription], Result], /) -> Awaitable[Result]: ...


async def plan_within_budget(
    planning: PlanningService,
    clock: Clock,
    compute: Compute,
    request: MotionRequest,
    plan_first: Callable[[], Awaitable[Trajectory | None]],
    budget_s: float,
) -> Trajectory | Improving | None:
    """Plan a motion, then use the rest of the time budget (s) to search for faster ones. If the scene or the
    tool changes in the meantime, planning starts over.

    Raises:
        CobotError: any error that `plan_first` raises.
    """
    until_s = clock.now_s() + budget_s
    while True:
        scene, tool = planning.scene, planning.tool

        def is_unchanged(scene: object = scene, tool: object = tool) -> bool:
            return planning.scene is scene and planning.tool is tool

        found: Trajectory | Improving | None = await plan_first()
        if found is not None:
            left_s = until_s - clock.now_s()
            found = await improve_within(clock, compute, request, found, left_s, is_unchanged)
        if is_unchanged():
            return found
        log.info("the scene or the tool has changed during planning: planning again")


async def improve_within(
    clock: Clock,
    compute: Compute,
    request: MotionRequest,
    found: Trajectory | Improving,
    budget_s: float,
    is_unchanged: Callable[[], bool],
) -> Trajectory | Improving:
    """Search for faster motions for `budget_s`, and return the fastest one. The search ends early when no
    faster motion can be found, the scene or the tool has changed, or no planning process is free. It ends at
    most `OVERTIME_S` late.
    """
    until_s, left_s = clock.now_s() + budget_s, budget_s
    while request.traits.way is Way.SEARCH and left_s >= MIN_SLICE_S and is_unchanged():
        spent_s = found.spent_s if isinstance(found, Improving) else 0.0
        work = partial(improve_motion, request=request, found=found, slice_s=min(left_s, SLICE_S))
        try:
            async with asyncio.timeout(until_s - clock.now_s() + OVERTIME_S):
                found = await compute(work)
        except (PlanningError, UnavailableError, TimeoutError) as exc:
            log.warning("a motion is not improved further: %s", str(exc) or "no process was free in time")
            break
        if found.done:
            break
        left_s = min(left_s - (found.spent_s - spent_s), until_s - clock.now_s())
    return found
