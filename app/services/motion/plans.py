"""Motions and gripper commands that are planned now and may be run later."""

from __future__ import annotations

import asyncio
import secrets
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from app.services.motion.execution import MotionService
from app.services.motion.goals import Goals, check_radii
from app.services.motion.improvement import improve_within, plan_within_budget
from app.services.motion.moves import JoinedMoves, MoveService, Outcome
from app.services.motion.plan import QUEUED_TOLERANCE_RAD, Plan
from app.services.motion.plan_attempt import MIN_COMPUTE_S, PlanAttempt, PlanOptions
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import (
    describe,
    draw_picture,
    dry_run,
    forecast,
    plan_motion,
)
from app.services.motion.queue.moves import QueueRequest
from app.services.motion.queue.signals import MoveSignals
from app.services.rights.claims import Caller
from app.services.rights.job import Job
from app.services.rights.stop_reason import StopReason
from cobot.access.roles import acting
from cobot.clock import Clock
from cobot.config import Settings
from cobot.errors import (
    CobotError,
    ConflictError,
    InputError,
    NotFoundError,
    PlanningTimeout,
    UnavailableError,
)
from cobot.motions.fence import Fence
from cobot.motions.forecast import Forecast
from cobot.motions.gripper_bodies import GripperRequest
from cobot.motions.improving import Improving
from cobot.motions.rehearsal import Rehearsal
from cobot.motions.requests import MotionRequest
from cobot.motions.stretches import Leg
from cobot.robot.description import RobotDescription
from cobot.strict import shown
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

DRAW_S = 10.0
"""Timeout for a picture, including the wait for other pictures and for a process, s. Drawing itself takes 0.2
s.
"""


class PlanService:
    """Creates plans and keeps the newest ones in memory. A restart of the service deletes them.

    Plans are made one at a time, so that planning processes remain free for motions.

    Attributes:
        command_gripper: function that runs a gripper command and returns the reason if it fails, otherwise
            None.
    """

    command_gripper: Callable[[GripperRequest, Caller], Awaitable[CobotError | None]]

    def __init__(
        self,
        robot: RobotDescription,
        clock: Clock,
        goals: Goals,
        motion: MotionService,
        moves: MoveService,
        planning: PlanningService,
        settings: Settings,
    ) -> None:
        self._robot = robot
        self._clock = clock
        self._goals = goals
        self._motion = motion
        self._moves = moves
        self._planning = planning
        self._settings = settings
        self._kept = settings.planning.kept_plans
        self._explain_s = settings.planning.explain_s
        self.lifetime_s = settings.planning.plan_lifetime_s
        self._plans: OrderedDict[str, Plan] = OrderedDict()
        self._turn = asyncio.Lock()
        self._drawing = asyncio.Lock()

    async def make(
        self, goals: Sequence[MotionRequest], radii_m: Sequence[float], asked: PlanOptions, timeout_s: float
    ) -> Plan:
        """Plan one motion, or several motions as one. Nothing moves.

        Args:
            radii_m: as in `MoveService.move_sequence`.

        Raises:
            ConflictError: the arm is moving and no `start` is given.
            InputError, PlanningError, UnavailableError: the same errors as for a motion. They contain an
                `explanation` if it was requested and something was found.
        """
        check_radii(goals, radii_m)
        begin = await self._present() if asked.start is None else self._read_start(asked.start)
        limits = deepcopy(self._robot.limits)
        attempt = PlanAttempt(
            self._planning, self._clock, asked, begin, timeout_s, self._explain_s, self._turn
        )
        try:
            async with asyncio.timeout(timeout_s):
                if len(goals) == 1:
                    return await self._make_one(goals[0], limits, attempt)
                versions = self._versions
                found, course = await self._forecast(goals, radii_m, attempt)
        except TimeoutError as exc:
            raise PlanningTimeout.after(timeout_s, f"not planned within {timeout_s:g} s") from exc
        planners = frozenset(str(goal.planner) for goal in goals)
        return await self._keep_motion(
            begin, found, course, limits, versions, planners=planners, motions=len(goals)
        )

    async def improve(self, plan_id: str, budget_s: float, samples: int, timeout_s: float) -> Plan:
        """Search for a faster plan for the same request within a time, s. The given plan stays unchanged. It
        is returned if no faster one is found.

        Raises:
            NotFoundError: the plan is unknown or has expired.
            ConflictError: a limit, the scene or the tool has changed.
            InputError: the plan does not consist of one motion.
            PlanningError, UnavailableError: a faster motion was found, but could not be described in time.
        """
        plan, versions = self.get(plan_id), self._versions
        plan.require_unchanged(self._robot)
        request, found = plan.goal, plan.found
        if request is None:
            kind = "a gripper command" if plan.gripper is not None else f"of {plan.motions} motions"
            raise InputError(f"plan {plan_id}: is {kind}; only a plan of one motion can be improved")
        if found is None:
            return plan
        options, begun_s = PlanOptions(samples=samples, explain=False), self._clock.now_s()
        attempt = PlanAttempt(self._planning, self._clock, options, plan.start, timeout_s, 0.0, self._turn)
        budget_s = min(budget_s, attempt.spare_s)
        better = await improve_within(
            self._clock, attempt.compute, request, found, budget_s, lambda: self._versions == versions
        )
        plan.require_unchanged(self._robot)
        is_faster = isinstance(better, Improving) and better.best.duration_s < _best(found).duration_s
        if not is_faster:
            same = replace(plan, found=better)
            if plan_id in self._plans:
                self._plans[plan_id] = same
            return same
        work = partial(describe, trajectory=_best(better), start=plan.start, samples=samples)
        try:
            async with asyncio.timeout(timeout_s - (self._clock.now_s() - begun_s)):
                described = await attempt.compute(work)
        except TimeoutError as exc:
            raise PlanningTimeout.after(
                timeout_s,
                f"plan {plan_id}: not improved within {timeout_s:g} s, because other plans are being "
                "made; try again",
            ) from exc
        planning_s = plan.planning_s + self._clock.now_s() - begun_s
        return await self._keep_one(plan.limits, versions, request, better, described, planning_s)

    async def _make_one(self, goal: MotionRequest, limits: JointLimits, attempt: PlanAttempt) -> Plan:
        """Plan one motion within its budget. If the scene or the tool changes in the meantime, plan once
        more.
        """
        request, begun_s = self._goals.request(goal, attempt.begin), self._clock.now_s()
        samples, budget_s = attempt.asked.samples, min(goal.budget_s, attempt.spare_s)
        plan_first = partial(attempt.of, request, partial(plan_motion, request=request))
        found: Trajectory | Improving | None
        while True:
            versions = self._versions
            if budget_s > 0.0:
                found = await plan_within_budget(
                    self._planning, self._clock, attempt.compute, request, plan_first, budget_s
                )
                best = None if found is None else _best(found)
                work = partial(describe, trajectory=best, start=request.start, samples=samples)
                described = await attempt.compute(work)
            else:
                work = partial(forecast, request=request, samples=samples)
                described = await attempt.of(request, work)
                found = described.trajectory
            if self._versions == versions:
                break
            budget_s -= self._clock.now_s() - begun_s
        planning_s = self._clock.now_s() - begun_s
        return await self._keep_one(limits, versions, request, found, described, planning_s)

    async def _keep_one(
        self,
        limits: JointLimits,
        versions: tuple[int, int],
        request: MotionRequest,
        found: Trajectory | Improving | None,
        described: Forecast,
        planning_s: float,
    ) -> Plan:
        motion = described.trajectory
        duration_s = 0.0 if motion is None else motion.duration_s
        course = JoinedMoves(motion, (request.signals,), (duration_s,))
        return await self._keep_motion(
            request.start,
            described,
            course,
            limits,
            versions,
            planners=frozenset([str(request.planner)]),
            goal=request,
            found=found,
            planning_s=planning_s,
        )

    async def _keep_motion(
        self,
        begin: Array,
        described: Forecast,
        course: JoinedMoves,
        limits: JointLimits,
        versions: tuple[int, int],
        **fields: Any,
    ) -> Plan:
        """Store a plan of motions, with their actions and conditions."""
        to_run, signals = await self._moves.place(course, begin)
        return self._keep(begin, described, limits, versions, to_run=to_run, signals=signals, **fields)

    @property
    def _versions(self) -> tuple[int, int]:
        """Return the versions of the scene and of the tool."""
        return self._robot.collision.scene.version, self._robot.model.tool.version

    async def make_gripper(self, request: GripperRequest, samples: int, timeout_s: float) -> Plan:
        """Plan a gripper command. Nothing moves. When the plan is run later, the arm must be at the same
        position as now.

        Raises:
            ConflictError: the arm is moving.
            UnavailableError: the robot is not ready, or no planning process is free.
        """
        begin = np.array((await self._motion.require_ready()).commanded_position)
        work = partial(describe, trajectory=None, start=begin, samples=samples)
        versions = self._versions
        async with self._turn:
            found = await self._planning.compute(work, timeout_s)
        return self._keep(begin, found, deepcopy(self._robot.limits), versions, gripper=request)

    def _keep(
        self, begin: Array, described: Forecast, limits: JointLimits, versions: tuple[int, int], **fields: Any
    ) -> Plan:
        """Store a plan that was made with these versions of the scene and the tool."""
        made_s, number = self._clock.now_s(), f"plan_{secrets.token_hex(8)}"
        plan = Plan(number, begin, described, limits, made_s, *versions, by=acting.get().name, **fields)
        self._plans[plan.plan_id] = plan
        self._forget()
        return plan

    async def _forecast(
        self, goals: Sequence[MotionRequest], radii_m: Sequence[float], attempt: PlanAttempt
    ) -> tuple[Forecast, JoinedMoves]:
        begin, samples = attempt.begin, attempt.asked.samples

        async def plan(request: MotionRequest) -> Trajectory | None:
            return await attempt.of(request, partial(plan_motion, request=request))

        course = await self._moves.sequence(goals, radii_m, begin, plan, attempt.compute)
        work = partial(describe, trajectory=course.trajectory, start=begin, samples=samples)
        return await attempt.compute(work), course

    async def picture(self, plan_id: str) -> bytes:
        """Draw a picture of a plan as PNG. Pictures are drawn one at a time.

        Raises:
            NotFoundError: see `get`.
            UnavailableError: other pictures are being drawn, or all planning processes are busy.
        """
        found = self.get(plan_id).forecast
        try:
            async with asyncio.timeout(DRAW_S):
                await self._drawing.acquire()
        except TimeoutError:
            raise UnavailableError(
                f"the plan could not be drawn within {DRAW_S:g} s, because other plans are being drawn; "
                "try again"
            ) from None
        try:
            return await self._planning.compute(
                partial(draw_picture, joints=found.joints, poses=found.poses), DRAW_S
            )
        finally:
            self._drawing.release()

    def list_valid(self) -> list[Plan]:
        """List the plans that can be run, oldest first."""
        self._forget()
        return list(self._plans.values())

    def expires_in_s(self, plan: Plan) -> float:
        return max(plan.made_s + self.lifetime_s - self._clock.now_s(), 0.0)

    def get(self, plan_id: str) -> Plan:
        """Return a plan that can be run.

        Raises:
            NotFoundError: the plan is unknown or has expired.
        """
        self._forget()
        plan = self._plans.get(plan_id)
        if plan is None:
            raise NotFoundError(
                f"there is no plan {shown(plan_id)}; only the newest {self._kept} plans are kept, for "
                f"{self.lifetime_s:g} s or until the service restarts; plan again"
            )
        return plan

    async def execute(self, plan_id: str, caller: Caller, fence: Fence | None = None) -> Outcome:
        """Run a plan. It is kept, so it can be run again from its start.

        Args:
            fence: fence that the TCP may not leave.

        Raises:
            NotFoundError: the plan is unknown or has expired.
            ConflictError: the arm's position or a limit has changed. The error gives the change and the
                allowed deviation.
            ConflictError, UnavailableError: another client is moving the arm, or the arm is not ready.
        """
        plan = self.get(plan_id)

        def require(joints: Array) -> None:
            plan.require_unchanged(self._robot)
            plan.require_start(joints)

        if plan.gripper is not None:
            begun_s = self._clock.now_s()
            require(np.array((await self._motion.require_ready()).commanded_position))
            error = await self.command_gripper(plan.gripper, caller)
            return Outcome(error, None, self._clock.now_s() - begun_s, 0.0)
        return await self._moves.run(plan.to_run, require, caller, fence, plan.signals)

    async def rehearse(
        self, plan_id: str, gone: asyncio.Event, timeout_s: float
    ) -> tuple[Plan, Rehearsal | None]:
        """Run a plan on a simulated copy of the robot, in a planning process. The robot does not move. Only
        one plan or dry run is computed at a time.

        Args:
            gone: event that is set when the client disconnects, which ends the dry run.

        Returns:
            The plan and the result of the dry run. The result is None if the plan does not move the arm.

        Raises:
            NotFoundError: the plan is unknown or has expired.
            ConflictError: a limit, the scene or the tool has changed.
            MotionStopped: the client has disconnected.
            PlanningError, PlanningTimeout, UnavailableError: see `PlanningService.compute`.
        """
        plan = self.get(plan_id)
        plan.require_unchanged(self._robot)
        trajectory = plan.forecast.trajectory
        if trajectory is None:
            return plan, None
        work = partial(dry_run, settings=self._settings, start=plan.start, trajectory=trajectory)
        running = asyncio.create_task(self._rehearse(work, timeout_s))
        leaving = asyncio.create_task(gone.wait())
        try:
            await asyncio.wait({running, leaving}, return_when=asyncio.FIRST_COMPLETED)
            if not running.done():
                raise StopReason("the client has disconnected", "client_left").error
            return plan, await running
        finally:
            running.cancel()
            leaving.cancel()

    async def _rehearse(self, work: Callable[[RobotDescription], Rehearsal], timeout_s: float) -> Rehearsal:
        begun_s = self._clock.now_s()
        try:
            async with asyncio.timeout(timeout_s):
                await self._turn.acquire()
        except TimeoutError:
            raise PlanningTimeout.after(
                timeout_s,
                f"the dry run did not begin within {timeout_s:g} s, because other plans are being made; "
                "try again",
            ) from None
        try:
            left_s = timeout_s - (self._clock.now_s() - begun_s)
            return await self._planning.compute(work, max(left_s, MIN_COMPUTE_S))
        finally:
            self._turn.release()

    def queue_request(self, plan_id: str, job: Job, radius_m: float) -> QueueRequest:
        """Create the request for the queue to run a plan. The plan is checked again when its turn comes.

        Raises:
            NotFoundError: the plan is unknown or has expired.
            ConflictError: a limit, the scene or the tool has changed.
        """
        plan = self.get(plan_id)
        if plan.gripper is not None:
            raise InputError(f"plan {plan_id}: is a gripper command, which cannot be queued")
        trajectory, same = plan.forecast.trajectory, partial(plan.require_unchanged, self._robot)
        same()

        def begin(start: Array) -> Leg | None:
            plan.require_start(start, "will be", QUEUED_TOLERANCE_RAD)
            return None if trajectory is None else Leg(trajectory, plan.limits, None)

        return QueueRequest(
            f"plan {plan_id}",
            [begin],
            radius_m,
            job=job,
            exact=True,
            midway=False,
            count=plan.motions,
            require_valid=same,
            signals=MoveSignals(exact=plan.signals),
        )

    def _read_start(self, start: list[float]) -> Array:
        joints = np.array(start, dtype=np.float64)
        self._goals.require_joints(joints, name="start", checked=False)
        return joints

    async def _present(self) -> Array:
        try:
            return np.array((await self._motion.require_ready()).commanded_position)
        except ConflictError as exc:
            raise ConflictError(f"{exc}; give `start` to plan while the arm is moving") from exc

    def _forget(self) -> None:
        """Remove plans that have expired, and the oldest ones above the maximum number."""
        oldest_s = self._clock.now_s() - self.lifetime_s
        while self._plans:
            first = next(iter(self._plans.values()))
            if len(self._plans) <= self._kept and first.made_s >= oldest_s:
                return
            del self._plans[first.plan_id]


def _best(found: Trajectory | Improving) -> Trajectory:
    return found.best if isinstance(found, Improving) else found
