"""Motions from the request to the arrival: planned, carried out, and answered for."""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from app.services.motion.execution import MotionService
from app.services.motion.goals import Goals, check_radii
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import joined
from app.services.rights.claims import Caller, Claim, watching
from app.services.rights.ownership import Ownership
from cobot.clock import Clock
from cobot.errors import CobotError, ExecutionError, InputError, PlanningError
from cobot.motions.fence import Fence
from cobot.motions.requests import Blended, MotionRequest
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array

Join = Callable[[RobotDescription], Blended]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a motion request ended. `error` is None when the arm has arrived and settled.

    `note` is the trajectory's.
    """

    error: CobotError | None
    motion_id: int | None
    duration_s: float
    planning_time_s: float
    note: str = ""


class MoveService:
    """Plans what is asked for and has it carried out, for the owner of the right to move."""

    def __init__(
        self,
        clock: Clock,
        ownership: Ownership,
        goals: Goals,
        motion: MotionService,
        planning: PlanningService,
    ) -> None:
        self._clock = clock
        self._ownership = ownership
        self._goals = goals
        self._motion = motion
        self._planning = planning

    async def move(self, goal: MotionRequest, caller: Caller) -> Outcome:
        """Plan, go, and return when the arm has arrived and settled, or why it has not.

        Raises:
            ConflictError, UnavailableError, InputError: nothing has moved.
        """

        async def plan_motion(claim: Claim, start: Array) -> Trajectory | None:
            return await self._motion.plan(claim, self._goals.request(goal, start), caller.timeout_s)

        return await self._move(plan_motion, caller)

    async def move_sequence(
        self, goals: Sequence[MotionRequest], radii_m: Sequence[float], caller: Caller
    ) -> Outcome:
        """Plan all of them, and go through them as one motion; see `move`.

        Args:
            radii_m: for each goal but the last: how far from it the TCP may leave its path; none: it stops.
        """
        check_radii(goals, radii_m)

        async def plan_motion(claim: Claim, start: Array) -> Trajectory | None:
            async def plan(request: MotionRequest) -> Trajectory | None:
                return await self._motion.plan(claim, request, caller.timeout_s)

            async def join(work: Join) -> Blended:
                return await claim.run_interruptibly(self._planning.compute(work, caller.timeout_s))

            return await self.sequence(goals, radii_m, start, plan, join)

        return await self._move(plan_motion, caller)

    async def sequence(
        self,
        goals: Sequence[MotionRequest],
        radii_m: Sequence[float],
        start: Array,
        plan: Callable[[MotionRequest], Awaitable[Trajectory | None]],
        join: Callable[[Join], Awaitable[Blended]],
    ) -> Trajectory | None:
        """Several motions as one; None if the arm is there already.

        Args:
            start: where the first begins, shape (dof,), rad.
            plan: plans one.
            join: has a planning process join them.

        Raises:
            PlanningError, InputError: saying which motion.
        """
        requests: list[MotionRequest] = []
        motions: list[Trajectory] = []
        radii: list[float] = []
        for number, (goal, radius) in enumerate(zip(goals, [*radii_m, *[0.0] * len(goals)], strict=False), 1):
            request = self._goals.request(goal, start)
            try:
                motion = await plan(request)
            except (PlanningError, InputError) as exc:
                error = exc.said(f"motion {number}: {exc}")
                if exc.explanation is not None:
                    error.explanation = replace(exc.explanation, motion=number)
                raise error from exc
            if motion is not None:
                requests.append(request)
                motions.append(motion)
                radii.append(radius)
                start = motion.end
            elif radii:  # It ends where the move before ends, so only its radius counts.
                radii[-1] = min(radii[-1], radius)
        if not motions:
            return None
        blended = await join(partial(joined, requests=requests, motions=motions, radii_m=radii[:-1]))
        return blended.trajectory

    async def _move(
        self, plan_motion: Callable[[Claim, Array], Awaitable[Trajectory | None]], caller: Caller
    ) -> Outcome:
        begun_s = self._clock.now_s()
        planned_s, note = begun_s, ""
        with self._ownership.claim(caller) as claim, contextlib.ExitStack() as watch:
            watch.enter_context(watching(claim, caller))
            error: CobotError | None = None
            try:
                state = await self._motion.ready()
                claim.accept()
                trajectory = await plan_motion(claim, state.commanded_position)
                planned_s = self._clock.now_s()
                if trajectory is not None:
                    note = trajectory.note
                    await self._go(claim, trajectory, caller, watch)
            except (PlanningError, ExecutionError) as exc:
                error = exc
                claim.fail(exc)
            now_s = self._clock.now_s()
            planning_s = (planned_s if planned_s > begun_s else now_s) - begun_s
            return Outcome(error, claim.motion_id, now_s - begun_s, planning_s, note)

    async def run(
        self,
        trajectory: Trajectory | None,
        require: Callable[[Array], None],
        caller: Caller,
        fence: Fence | None = None,
    ) -> Outcome:
        """Run what was planned before, and return when the arm has arrived, or why it has not.

        Args:
            trajectory: None if there is nothing to move.
            require: raises if the commanded joints, shape (dof,), rad, are not where the motion begins, or
                anything else is not as when it was planned. Called by the owner of the right to move.
            fence: that the TCP may not leave.

        Raises:
            ConflictError, UnavailableError, InputError: nothing has moved.
        """
        begun_s = self._clock.now_s()
        with self._ownership.claim(caller) as claim, contextlib.ExitStack() as watch:
            watch.enter_context(watching(claim, caller))
            error: CobotError | None = None
            try:
                require((await self._motion.ready()).commanded_position)
                claim.accept()
                if trajectory is not None:
                    await self._go(claim, trajectory, caller, watch, fence)
            except ExecutionError as exc:
                error = exc
                claim.fail(exc)
            note = "" if trajectory is None else trajectory.note
            return Outcome(error, claim.motion_id, self._clock.now_s() - begun_s, 0.0, note)

    async def _go(
        self,
        claim: Claim,
        trajectory: Trajectory,
        caller: Caller,
        watch: contextlib.ExitStack,
        fence: Fence | None = None,
    ) -> None:
        """Start a motion and follow it to its end. Without a waiting client its end has no timeout."""
        await self._motion.start(claim, trajectory, fence)
        if not caller.waits:
            watch.close()
        await self._motion.arrival(claim)
