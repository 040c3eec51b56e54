"""Motions that are planned now and perhaps run later."""

from __future__ import annotations

import asyncio
import secrets
from collections import OrderedDict
from copy import deepcopy
from dataclasses import dataclass, fields
from functools import partial

import numpy as np

from app.services.motion.execution import Goal, MotionService, Outcome
from app.services.motion.ownership import Caller
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import forecast
from cobot.clock import Clock
from cobot.config import PlanningSection
from cobot.errors import ConflictError, InputError, NotFoundError, PlanningTimeout
from cobot.motions.forecast import Forecast
from cobot.robot.description import RobotDescription
from cobot.robot.limits import check_positions
from cobot.strict import shown
from cobot.types import Array, JointLimits

START_TOLERANCE_RAD = 1e-6
"""How far a joint may be from where a plan begins: a plan is run as it is, what is off would be a jump."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that can be run.

    Attributes:
        start: where it begins, shape (dof,), rad.
        limits: of the joints, as they were when it was made.
        made_s: when that was, on the service's clock.
        scene: the version of the scene that it was made for.
        tool: that of the tool.
    """

    plan_id: str
    start: Array
    forecast: Forecast
    limits: JointLimits
    made_s: float
    scene: int = 0
    tool: int = 0


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
        self.lifetime_s = settings.plan_lifetime_s
        self._plans: OrderedDict[str, Plan] = OrderedDict()
        self._turn = asyncio.Lock()

    async def make(self, goal: Goal, start: list[float] | None, samples: int, timeout_s: float) -> Plan:
        """Plan; nothing moves.

        Args:
            start: joint angles, rad; None for where the arm is, which has to be at rest.

        Raises:
            ConflictError: the arm moves and there is no `start`.
            InputError, PlanningError, UnavailableError: as for a motion.
        """
        begin = self._given(start) if start is not None else await self._present()
        limits = deepcopy(self._robot.limits)
        work = partial(forecast, request=self._motion.request(goal, begin), samples=samples)
        try:
            async with asyncio.timeout(timeout_s), self._turn:
                found = await self._planning.compute(work, timeout_s)
        except TimeoutError as exc:
            raise PlanningTimeout(f"not planned within {timeout_s:g} s") from exc
        scene = self._robot.collision.scene.version
        tool = self._robot.model.tool.version
        plan = Plan(secrets.token_hex(8), begin, found, limits, self._clock.now_s(), scene, tool)
        self._plans[plan.plan_id] = plan
        self._forget()
        return plan

    async def execute(self, plan_id: str, caller: Caller) -> Outcome:
        """Run a plan; it is kept, so that it can be run again from where it begins.

        Raises:
            NotFoundError: there is no such plan, or no more.
            ConflictError: the arm or a limit is not where it was; with what, by how much and what is allowed.
            ConflictError, UnavailableError: somebody else moves the arm, or it is not ready.
        """
        self._forget()
        plan = self._plans.get(plan_id)
        if plan is None:
            raise NotFoundError(
                f"there is no plan {shown(plan_id)}: the newest {self._kept} are kept, for "
                f"{self.lifetime_s:g} s and until the service restarts; plan again"
            )
        return await self._motion.run(plan.forecast.trajectory, partial(self._require_same, plan), caller)

    def _require_same(self, plan: Plan, joints: Array) -> None:
        for item in fields(JointLimits)[1:]:
            before, now = getattr(plan.limits, item.name), getattr(self._robot.limits, item.name)
            for joint in np.flatnonzero(before != now)[:1]:
                name = plan.limits.names[int(joint)]
                raise ConflictError(
                    f"plan {plan.plan_id}: {item.name} of {name} was {before[joint]:g} when it was "
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
            raise ConflictError(
                f"plan {plan.plan_id}: {plan.limits.names[worst]} is at {joints[worst]:.6f} rad, "
                f"{abs(off[worst]):.3g} rad from {plan.start[worst]:.6f} rad where the plan begins; allowed "
                f"are {START_TOLERANCE_RAD:g} rad; go there, or plan again"
            )

    def _given(self, start: list[float]) -> Array:
        limits = self._robot.limits
        if len(start) != limits.dof:
            raise InputError(f"start must have {limits.dof} angles, got {len(start)}")
        begin = np.array(start, dtype=np.float64)
        check_positions(limits, begin, "start: the angle")
        return begin

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
