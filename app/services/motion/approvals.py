"""Decides which plans agents may run: those that an operator has approved and, if the settings permit, those
within a fence.
"""

from __future__ import annotations

import time

from app.services.motion.moves import Outcome
from app.services.motion.plan import Plan
from app.services.motion.plans import PlanService
from app.services.rights.claims import Caller
from cobot.clock import Clock
from cobot.config import McpSection
from cobot.errors import PermissionDenied
from cobot.motions.fence import Fence
from cobot.robot.description import RobotDescription

ASK = "ask an operator to approve it: POST /robot/approve, or the panel"


class Approvals:
    """Keeps the approvals of plans. Each approval is valid for one run of one plan."""

    def __init__(
        self, robot: RobotDescription, clock: Clock, plans: PlanService, settings: McpSection
    ) -> None:
        self._robot = robot
        self._clock = clock
        self._plans = plans
        self._execution = settings.execution
        self._settings = settings.fence
        box = settings.fence
        self._fence = Fence(box.low, box.high, box.speed_m_s)
        self._by: dict[str, str] = {}

    def approve(self, plan_id: str, by: str) -> Plan:
        """Allow an agent to run this plan once.

        Raises:
            NotFoundError: the plan is unknown or has expired.
        """
        plan = self._plans.get(plan_id)
        known = {each.plan_id for each in self._plans.list_valid()}
        self._by = {plan_id: name for plan_id, name in self._by.items() if plan_id in known}
        self._by[plan_id] = by
        return plan

    def withdraw(self, plan_id: str) -> Plan:
        """Withdraw an approval. Raises the same errors as `approve`."""
        plan = self._plans.get(plan_id)
        self._by.pop(plan_id, None)
        return plan

    def approved_by(self, plan_id: str) -> str | None:
        """Return the client that has approved a plan, if the plan has not run since; None otherwise."""
        return self._by.get(plan_id)

    async def execute(self, plan_id: str, caller: Caller) -> Outcome:
        """Run a plan for an agent; see `PlanService.execute`.

        Raises:
            PermissionDenied: the plan is neither approved nor within the fence; the error gives the reason.
        """
        fence = self.permit(self._plans.get(plan_id))
        if fence is None:
            del self._by[plan_id]  # before anything is awaited, because an approval is valid for only one run
        return await self._plans.execute(plan_id, caller, fence)

    def permit(self, plan: Plan) -> Fence | None:
        """Return the fence within which an agent may run a plan; None for a plan that an operator has
        approved.

        Raises:
            PermissionDenied: an agent may not run the plan.
        """
        if self._execution == "off":
            raise PermissionDenied(
                "agents may not move this robot, because mcp.execution is off in its settings"
            )
        if plan.plan_id in self._by:
            return None
        if self._execution == "approved":
            raise PermissionDenied(f"plan {plan.plan_id} is not approved; {ASK}")
        problem = self._beyond(plan)
        if problem:
            raise PermissionDenied(
                f"plan {plan.plan_id} is not approved, and not within the fence: {problem}; {ASK}"
            )
        return self._fence

    def _beyond(self, plan: Plan) -> str:
        """Return the reason why a plan is outside the fence in the settings; "" if it is within the fence."""
        fence = self._settings
        others = sorted(plan.planners - set(fence.planners))
        if others:
            allowed = ", ".join(fence.planners)
            return f"its planner is {others[0]}, but mcp.fence.planners allows {allowed}"
        if effects := plan.effects:
            return f"it does more than move the arm ({effects[0]}), but the fence permits only motions"
        mass = self._robot.model.carried.mass
        if mass > fence.payload_kg:
            return f"the arm carries {mass:g} kg, but mcp.fence.payload_kg is {fence.payload_kg:g} kg"
        now = time.strftime("%H:%M", time.localtime(self._clock.wall_ns() / 1e9))
        begin, end = fence.hours.split("-")
        if not (begin <= now <= end if begin <= end else now >= begin or now <= end):
            return f"the time is {now}, but mcp.fence.hours is {fence.hours}"
        trajectory = plan.forecast.trajectory
        return "" if trajectory is None else self._fence.breach(trajectory, self._robot.model.chain)
