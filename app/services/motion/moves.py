"""Plans and executes requested motions, and reports their results."""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from app.services.motion.execution import MotionService
from app.services.motion.goals import Goals, check_radii
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import join_motions
from app.services.motion.signal_follower import SignalFollower, planned_results
from app.services.rights.claims import Caller, Claim, watching
from app.services.rights.ownership import Ownership
from app.services.rights.signal_results import NO_RESULTS, SignalResults
from cobot.clock import Clock
from cobot.errors import CobotError, ExecutionError, InputError, PlanningError
from cobot.motions.fence import Fence
from cobot.motions.improving import Planned
from cobot.motions.requests import Blended, MotionRequest
from cobot.motions.signal_places import place_signals, resting
from cobot.motions.signals import NO_PLACED, NO_SIGNALS, PathSignals, Placed
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array

Join = Callable[[RobotDescription], Blended]


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a motion request. `error` is None if the arm has arrived and settled.

    `note` is the trajectory's note, `signals` has the results of its actions and conditions, and `planned` is
    the rating of the plan of a single motion.
    """

    error: CobotError | None
    motion_id: int | None
    duration_s: float
    planning_time_s: float
    note: str = ""
    signals: SignalResults = NO_RESULTS
    planned: Planned | None = None


@dataclass(frozen=True, slots=True)
class JoinedMoves:
    """Several motions as one trajectory, with their actions and conditions.

    Attributes:
        trajectory: the motion; None if the arm is already at the goal.
        signals: signals of each motion.
        ends_s: path time at which each motion ends.
        planned: rating of the plan; None for several motions.
    """

    trajectory: Trajectory | None
    signals: tuple[PathSignals, ...]
    ends_s: tuple[float, ...]
    planned: Planned | None = None


class MoveService:
    """Plans and executes requested motions for the holder of a claim."""

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
        """Plan and execute a motion. Returns when the arm has settled at the goal or has failed to reach it.
        The outcome gives the reason.

        Raises:
            ConflictError, UnavailableError, InputError: the motion is rejected; nothing has moved.
        """

        async def plan_motion(claim: Claim, start: Array) -> JoinedMoves:
            request = self._goals.request(goal, start)
            motion, quality = await self._motion.plan_goal(claim, request, caller.timeout_s)
            claim.goal = goal
            ends_s = (0.0 if motion is None else motion.duration_s,)
            return JoinedMoves(motion, (goal.signals,), ends_s, quality)

        return await self._move(plan_motion, caller)

    async def move_sequence(
        self, goals: Sequence[MotionRequest], radii_m: Sequence[float], caller: Caller
    ) -> Outcome:
        """Plan several motions and execute them as one; see `move`.

        Args:
            radii_m: blend radius at each goal except the last; empty: the TCP stops at each goal.
        """
        check_radii(goals, radii_m)

        async def plan_motion(claim: Claim, start: Array) -> JoinedMoves:
            async def plan(request: MotionRequest) -> Trajectory | None:
                return (await self._motion.plan_goal(claim, request, caller.timeout_s))[0]

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
    ) -> JoinedMoves:
        """Plan several motions and join them into one.

        Args:
            start: start of the first motion, shape (dof,), rad.
            plan: plans one motion.
            join: joins the motions in a planning process.

        Raises:
            PlanningError, InputError: a motion cannot be planned or joined; the error gives its number.
        """
        requests: list[MotionRequest] = []
        motions: list[Trajectory] = []
        radii: list[float] = []
        parts: list[int] = []  # number of motions up to each goal
        for number, (goal, radius) in enumerate(zip(goals, [*radii_m, *[0.0] * len(goals)], strict=False), 1):
            request = self._goals.request(goal, start)
            try:
                motion = await plan(request)
            except (PlanningError, InputError) as exc:
                error = exc.with_message(f"motion {number}: {exc}")
                if exc.explanation is not None:
                    error.explanation = replace(exc.explanation, motion=number)
                raise error from exc
            if motion is not None:
                requests.append(request)
                motions.append(motion)
                radii.append(radius)
                start = motion.end
            # This motion ends where the previous one ends, so its radius replaces the previous one.
            elif radii:
                radii[-1] = min(radii[-1], radius)
            parts.append(len(motions))
        signals = tuple(goal.signals for goal in goals)
        if not motions:
            return JoinedMoves(None, signals, (0.0,) * len(goals))
        blended = await join(partial(join_motions, requests=requests, motions=motions, radii_m=radii[:-1]))
        ends_s = (0.0, *blended.ends_s[:-1], blended.trajectory.duration_s)
        return JoinedMoves(blended.trajectory, signals, tuple(ends_s[count] for count in parts))

    async def place(self, course: JoinedMoves, start: Array) -> tuple[Trajectory | None, Placed]:
        """Return the trajectory to run from `start`, and its actions and conditions; see `place_signals`. If
        the arm is already at the goal, the trajectory has zero length if there are actions or conditions;
        otherwise it is None. `start` has shape (dof,), in rad.
        """
        if all(each == NO_SIGNALS for each in course.signals):
            return course.trajectory, NO_PLACED
        trajectory = course.trajectory or resting(start)
        return trajectory, place_signals(course.signals, course.ends_s, await self._motion.way(trajectory))

    async def _move(
        self, plan_motion: Callable[[Claim, Array], Awaitable[JoinedMoves]], caller: Caller
    ) -> Outcome:
        begun_s = self._clock.now_s()
        planned_s, note, begun, quality = begun_s, "", _Begun(), None
        with await self._ownership.claim_motion(caller) as claim, contextlib.ExitStack() as watch:
            watch.enter_context(watching(claim, caller))
            error: CobotError | None = None
            try:
                state = await self._motion.require_ready()
                claim.accept()
                course = await plan_motion(claim, state.commanded_position)
                planned_s, quality = self._clock.now_s(), course.planned
                trajectory, begun.signals = await self.place(course, state.commanded_position)
                if trajectory is not None:
                    note = trajectory.note
                    await self._go(claim, trajectory, caller, watch, begun)
            except (PlanningError, ExecutionError) as exc:
                error = exc
                claim.fail(exc)
            now_s = self._clock.now_s()
            planning_s = (planned_s if planned_s > begun_s else now_s) - begun_s
            return Outcome(error, claim.motion_id, now_s - begun_s, planning_s, note, begun.results, quality)

    async def run(
        self,
        trajectory: Trajectory | None,
        require: Callable[[Array], None],
        caller: Caller,
        fence: Fence | None = None,
        signals: Placed = NO_PLACED,
    ) -> Outcome:
        """Run a planned motion and wait until it has ended. The outcome states whether the arm has reached
        the goal and, if not, why.

        Args:
            trajectory: None if there is nothing to move.
            require: function that is called once the claim is held, with the commanded joint positions, shape
                (dof,), rad. It raises an error if they are not at the start of the motion, or if anything
                else has changed since planning.
            fence: the fence that the TCP may not leave.
            signals: actions and conditions of the motion.

        Raises:
            ConflictError, UnavailableError, InputError: the motion is rejected; nothing has moved.
        """
        begun_s, begun = self._clock.now_s(), _Begun(signals)
        with await self._ownership.claim_motion(caller) as claim, contextlib.ExitStack() as watch:
            watch.enter_context(watching(claim, caller))
            error: CobotError | None = None
            try:
                require((await self._motion.require_ready()).commanded_position)
                claim.accept()
                if trajectory is not None:
                    await self._go(claim, trajectory, caller, watch, begun, fence)
            except ExecutionError as exc:
                error = exc
                claim.fail(exc)
            note = "" if trajectory is None else trajectory.note
            took_s = self._clock.now_s() - begun_s
            return Outcome(error, claim.motion_id, took_s, 0.0, note, begun.results)

    async def _go(
        self,
        claim: Claim,
        trajectory: Trajectory,
        caller: Caller,
        watch: contextlib.ExitStack,
        begun: _Begun,
        fence: Fence | None = None,
    ) -> None:
        """Start a motion and follow it to its end. There is no timeout if no client is waiting for the
        result.
        """
        follower = begun.follower = await self._motion.start(claim, trajectory, fence, begun.signals)
        if not caller.waits:
            watch.close()
        await self._motion.arrival(claim, follower)
        if follower is not None and follower.retract_m > 0.0:
            await self._motion.retract(claim, trajectory, follower, caller.timeout_s, fence)


@dataclass(slots=True)
class _Begun:
    """The signals of a motion, and their follower once it has begun."""

    signals: Placed = NO_PLACED
    follower: SignalFollower | None = None

    @property
    def results(self) -> SignalResults:
        return planned_results(self.signals) if self.follower is None else self.follower.results
