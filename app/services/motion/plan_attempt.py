"""One attempt to make a plan, with its options and its time limit."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import from_start, work_or_explain
from cobot.clock import Clock
from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.types import Array

ANSWER_S = 1.0
"""Part of an endpoint's timeout that the search for alternatives leaves for unfinished work and for the
answer, s.
"""
MIN_COMPUTE_S = 0.01
"""Minimum time that a planning process gets, s, even if less of the endpoint's timeout remains."""

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
        self._planning, self._clock, self._turn = planning, clock, turn
        self.asked, self.begin = asked, begin
        self._until_s = clock.now_s() + timeout_s
        self._explain_s = explain_s if asked.explain else 0.0

    async def compute(self, work: Callable[[RobotDescription], Result]) -> Result:
        """Run a computation in a planning process."""
        async with self._turn:
            return await self._planning.compute(work, max(self._left_s(), MIN_COMPUTE_S))

    async def of(self, request: MotionRequest, work: Callable[[RobotDescription], Result]) -> Result:
        """Return the result of `work` for the request. If it fails, the error gets an explanation if there is
        time.
        """
        if self.asked.start is not None and request.start is self.begin:
            work = partial(from_start, work=work, start=self.begin)
        if self._explain_s > 0.0:
            work = partial(
                work_or_explain,
                work=work,
                request=request,
                explain_s=self._explain_s,
                spare_s=self.spare_s,
            )
        return await self.compute(work)

    @property
    def spare_s(self) -> float:
        """Remaining time minus the time for the answer, s."""
        return self._left_s() - ANSWER_S

    def _left_s(self) -> float:
        return self._until_s - self._clock.now_s()
