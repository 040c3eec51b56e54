"""Motions that are planned now and perhaps run later."""

from __future__ import annotations

import asyncio
import secrets
from collections import OrderedDict
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from app.services.motion.execution import Goal, MotionService, Outcome, check_radii
from app.services.motion.ownership import Caller
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import described, explained, forecast, planned
from cobot.access.roles import acting
from cobot.clock import Clock
from cobot.config import PlanningSection
from cobot.errors import (
    ConflictError,
    InputError,
    LimitError,
    NotFoundError,
    PlanningError,
    PlanningTimeout,
)
from cobot.motions.fence import Fence
from cobot.motions.forecast import Forecast
from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.robot.limits import check_positions
from cobot.strict import shown
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

START_TOLERANCE_RAD = 1e-6
"""How far a joint may be from where a plan begins: a plan is run as it is, what is off would be a jump."""


ANSWER_S = 1.0
"""Of an endpoint's time, what explaining leaves for what it has begun and for the answer."""
SHORTEST_S = 0.01

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """What a plan is asked for beside its motion.

    Attributes:
        start: joint angles, rad; None for where the arm is, which has to be at rest.
        samples: how many points of the path are answered.
        explain: if there is no plan, try what would make one.
    """

    start: list[float] | None = None
    samples: int = 50
    explain: bool = True


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that can be run.

    Attributes:
        start: where it begins, shape (dof,), rad.
        limits: of the joints, as they were when it was made.
        made_s: when that was, on the service's clock.
        scene: the version of the scene that it was made for.
        tool: that of the tool.
        planners: that it was asked of.
        by: who has asked.
    """

    plan_id: str
    start: Array
    forecast: Forecast
    limits: JointLimits
    made_s: float
    scene: int = 0
    tool: int = 0
    planners: frozenset[str] = frozenset()
    by: str = ""


class _Attempt:
    """One plan in the making, within its time.

    Attributes:
        begin: where it begins, shape (dof,), rad.
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
    ) -> None:
        self._planning, self._robot, self._clock = planning, robot, clock
        self.asked, self.begin = asked, begin
        self._until_s = clock.now_s() + timeout_s
        self._explain_s = explain_s if asked.explain else 0.0

    async def compute(self, work: Callable[[RobotDescription], Result]) -> Result:
        """Have a planning process compute something."""
        return await self._planning.compute(work, max(self._left_s(), SHORTEST_S))

    async def of(self, request: MotionRequest, work: Callable[[RobotDescription], Result]) -> Result:
        """What `work` makes of the robot; a failure is explained, if there is time."""
        try:
            if self.asked.start is not None and request.start is self.begin:
                check_positions(self._robot.limits, self.begin, "start: the angle", 0.0)
            return await self.compute(work)
        except (PlanningError, LimitError) as exc:
            budget_s = min(self._explain_s, self._left_s() - ANSWER_S)
            if exc.findings and budget_s > 0.0:
                exc.explanation = await self.compute(
                    partial(explained, request=request, error=exc, budget_s=budget_s)
                )
            raise

    def _left_s(self) -> float:
        return self._until_s - self._clock.now_s()


class PlanService:
    """Makes plans and keeps the newest of them, in memory: after a restart of the service there are none.

    One is made at a time, so that they leave planning processes to the motions.
    """

    def __init__(
        self,
        robot: RobotDescription,
        clock: Clock,
        motion: MotionService,
        planning: PlanningService,
        settings: PlanningSection,
    ) -> None:
        self._robot = robot
        self._clock = clock
        self._motion = motion
        self._planning = planning
        self._kept = settings.kept_plans
        self._explain_s = settings.explain_s
        self.lifetime_s = settings.plan_lifetime_s
        self._plans: OrderedDict[str, Plan] = OrderedDict()
        self._turn = asyncio.Lock()

    async def make(
        self, goals: Sequence[Goal], radii_m: Sequence[float], asked: PlanOptions, timeout_s: float
    ) -> Plan:
        """Plan one motion, or several as one; nothing moves.

        Args:
            radii_m: as for `MotionService.move_sequence`.

        Raises:
            ConflictError: the arm moves and there is no `start`.
            InputError, PlanningError, UnavailableError: as for a motion; with an `explanation`, if it is
                asked for and the error has findings.
        """
        check_radii(goals, radii_m)
        begin = await self._present() if asked.start is None else self._given(asked.start)
        limits = deepcopy(self._robot.limits)
        attempt = _Attempt(self._planning, self._robot, self._clock, asked, begin, timeout_s, self._explain_s)
        try:
            async with asyncio.timeout(timeout_s), self._turn:
                found = await self._forecast(goals, radii_m, attempt)
        except TimeoutError as exc:
            raise PlanningTimeout.after(timeout_s, f"not planned within {timeout_s:g} s") from exc
        scene = self._robot.collision.scene.version
        tool = self._robot.model.tool.version
        planners = frozenset(str(goal.planner) for goal in goals)
        made_s, by = self._clock.now_s(), acting.get().name
        plan = Plan(secrets.token_hex(8), begin, found, limits, made_s, scene, tool, planners, by)
        self._plans[plan.plan_id] = plan
        self._forget()
        return plan

    async def _forecast(self, goals: Sequence[Goal], radii_m: Sequence[float], attempt: _Attempt) -> Forecast:
        begin, samples = attempt.begin, attempt.asked.samples
        if len(goals) == 1:
            request = self._motion.request(goals[0], begin)
            return await attempt.of(request, partial(forecast, request=request, samples=samples))

        async def plan(request: MotionRequest) -> Trajectory | None:
            return await attempt.of(request, partial(planned, request=request))

        trajectory = await self._motion.sequence(goals, radii_m, begin, plan, attempt.compute)
        return await attempt.compute(partial(described, trajectory=trajectory, start=begin, samples=samples))

    def kept(self) -> list[Plan]:
        """Those that can be run, the oldest first."""
        self._forget()
        return list(self._plans.values())

    def expires_in_s(self, plan: Plan) -> float:
        return max(plan.made_s + self.lifetime_s - self._clock.now_s(), 0.0)

    def get(self, plan_id: str) -> Plan:
        """A plan that can be run.

        Raises:
            NotFoundError: there is no such plan, or no more.
        """
        self._forget()
        plan = self._plans.get(plan_id)
        if plan is None:
            raise NotFoundError(
                f"there is no plan {shown(plan_id)}: the newest {self._kept} are kept, for "
                f"{self.lifetime_s:g} s and until the service restarts; plan again"
            )
        return plan

    async def execute(self, plan_id: str, caller: Caller, fence: Fence | None = None) -> Outcome:
        """Run a plan; it is kept, so that it can be run again from where it begins.

        Args:
            fence: that the TCP may not leave.

        Raises:
            NotFoundError: there is no such plan, or no more.
            ConflictError: the arm or a limit is not where it was; with what, by how much and what is allowed.
            ConflictError, UnavailableError: somebody else moves the arm, or it is not ready.
        """
        plan = self.get(plan_id)
        require = partial(self._require_same, plan)
        return await self._motion.run(plan.forecast.trajectory, require, caller, fence)

    def _require_same(self, plan: Plan, joints: Array) -> None:
        for quantity in JointLimits.QUANTITIES:
            before, now = getattr(plan.limits, quantity), getattr(self._robot.limits, quantity)
            for joint in np.flatnonzero(before != now)[:1]:
                name = plan.limits.names[int(joint)]
                raise ConflictError(
                    f"plan {plan.plan_id}: {quantity} of {name} was {before[joint]:g} when it was "
                    f"made and is {now[joint]:g} now; allowed is no difference; plan again"
                )
        for what, before, now in (
            ("scene", plan.scene, self._robot.collision.scene.version),
            ("tool", plan.tool, self._robot.model.tool.version),
        ):
            if before != now:
                raise ConflictError(
                    f"plan {plan.plan_id}: the {what} had version {before} when it was made and has version "
                    f"{now} now; plan again"
                )
        off = joints - plan.start
        worst = int(np.abs(off).argmax())
        if abs(off[worst]) > START_TOLERANCE_RAD:
            unit = plan.limits.unit(worst)
            raise ConflictError(
                f"plan {plan.plan_id}: {plan.limits.names[worst]} is at {joints[worst]:.6f} {unit}, "
                f"{abs(off[worst]):.3g} {unit} from {plan.start[worst]:.6f} {unit} where the plan begins; "
                f"allowed are {START_TOLERANCE_RAD:g} {unit}; go there, or plan again"
            )

    def _given(self, start: list[float]) -> Array:
        limits = self._robot.limits
        if len(start) != limits.dof:
            raise InputError(f"start must have {limits.dof} angles, got {len(start)}")
        return np.array(start, dtype=np.float64)

    async def _present(self) -> Array:
        try:
            return np.array((await self._motion.ready()).commanded_position)
        except ConflictError as exc:
            raise ConflictError(f"{exc}; give `start` to plan meanwhile") from exc

    def _forget(self) -> None:
        """Those that are too many or too old."""
        oldest_s = self._clock.now_s() - self.lifetime_s
        while self._plans:
            first = next(iter(self._plans.values()))
            if len(self._plans) <= self._kept and first.made_s >= oldest_s:
                return
            del self._plans[first.plan_id]
