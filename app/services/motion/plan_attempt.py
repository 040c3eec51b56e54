"""One attempt to make a plan, with its options and its time limit."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import explain
from cobot.clock import Clock
from cobot.errors import LimitError, PlanningError
from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.robot.limits import check_positions
from cobot.types import Array

ANSWER_S = 1.0
"""Part of an endpoint's timeout that the search for alternatives does not use, s. It is reserved for
unfinished work and for the answer.
"""
MIN_COMPUTE_S = 0.01
"""Minimum time for a planning process, s, even if less of the endpoint's timeout is left."""

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """The options of a plan, in addition to its goals.

    Attributes:
        start: joint angles at the start, rad; None for the arm's current position, at which the arm must be
            at rest.
        samples: number of path points in the answer.
        explain: whether to search for changes that make a plan possible, if planning fails.
    """

    start: list[float] | None = None
    samples: int = 50
    explain: bool = True


class PlanAttempt:
    """One attempt to make a plan within its time limit.

    Attributes:
        begin: joint positions at the start of the plan, shape (dof,), rad.
    """

    def __init__(
        self,
        planning: PlanningService,
        robot: RobotDescription,
        clock: Clock,
        asked: PlanOptions,
        begin: Array,
        timeout_s: float,
        explain_s: float,
        turn: asyncio.Lock,
    ) -> None:
        """
        Args:
            turn: lock that is held while a planning process works, so that plans use one process at a time.
        """
        self._planning, self._robot, self._clock, self._turn = planning, robot, clock, turn
        self.asked, self.begin = asked, begin
        self._until_s = clock.now_s() + timeout_s
        self._explain_s = explain_s if asked.explain else 0.0

    async def compute(self, work: Callable[[RobotDescription], Result]) -> Result:
        """Run a computation in a planning process."""
        async with self._turn:
            return await self._planning.compute(work, max(self._left_s(), MIN_COMPUTE_S))

    async def of(self, request: MotionRequest, work: Callable[[RobotDescription], Result]) -> Result:
        """Return the result of `work` for the request. If it fails, the failure is explained if there is
        time.
        """
        try:
            if self.asked.start is not None and request.start is self.begin:
                check_positions(self._robot.limits, self.begin, "start: the angle", 0.0)
            return await self.compute(work)
        except (PlanningError, LimitError) as exc:
            budget_s = min(self._explain_s, self.spare_s)
            if exc.findings and budget_s > 0.0:
                exc.explanation = await self.compute(
                    partial(explain, request=request, error=exc, budget_s=budget_s)
                )
            raise

    @property
    def spare_s(self) -> float:
        """Time that is left, except the time for the answer, s."""
        return self._left_s() - ANSWER_S

    def _left_s(self) -> float:
        return self._until_s - self._clock.now_s()
