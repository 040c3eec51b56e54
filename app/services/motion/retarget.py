"""Changes the goal of the running motion. The arm leaves its current path at a point ahead, without a stop.

The arm keeps moving while the new motion is planned. The point of the change is therefore as far ahead as
planning usually takes. If the arm passes it before the real-time loop has received the new trajectory, the
loop rejects the trajectory and the arm continues as before. A point further ahead is tried next.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from app.services.motion.execution import MotionService
from app.services.motion.goals import Goals
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import change_goal, lead_around
from app.services.rights.claims import Claim
from app.services.rights.job import Job, JobKind, JobState
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.errors import CobotError, ConflictError, ExecutionError, InputError
from cobot.motions.change_over import ChangeOver
from cobot.motions.planners import ANY_GOAL
from cobot.motions.requests import MotionRequest
from cobot.motions.signals import NO_SIGNALS
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName

MIN_LEAD_S, FIRST_LEAD_S, MAX_LEAD_S = 0.06, 0.1, 2.0
"""Path time from the arm to the point of the change, s: minimum, initial and maximum value. The value is the
minimum plus twice the last planning time.
"""
ATTEMPTS = 3
KINDS = (JobKind.MOVE, JobKind.EXECUTE)

Result = TypeVar("Result")

log = logging.getLogger("cobot.motion")


@dataclass(frozen=True, slots=True)
class Retargeted:
    """The point at which the arm leaves its former path, and the motion from there.

    Attributes:
        change_in_s, settled_in_s: time at planned speed until the arm leaves its former path, and until it
            follows only the new motion.
        joints: joint positions at the change, shape (dof,), rad.
        duration_s: time from the change to the new goal, at planned speed.
        planning_s: time from the request until the real-time loop has received the new motion, s.
        note: see `Trajectory`.
    """

    motion_id: int
    change_in_s: float
    settled_in_s: float
    joints: Array
    duration_s: float
    planning_s: float
    note: str


@dataclass(frozen=True, slots=True)
class WayAround:
    """A search for a path around objects, in a planning process.

    Attributes:
        since_s: beginning of the search, on the link's clock.
        search: task that returns the new path; None if the motion need not leave its path, or cannot stop in
            time.
    """

    claim: Claim
    job: Job
    since_s: float
    search: asyncio.Task[ChangeOver | None]


class RetargetService:
    """Changes the goal of the running motion of one robot."""

    def __init__(
        self,
        link: RobotLink,
        ownership: Ownership,
        goals: Goals,
        motion: MotionService,
        planning: PlanningService,
    ) -> None:
        self._link = link
        self._ownership = ownership
        self._goals = goals
        self._motion = motion
        self._planning = planning
        self._busy = False
        self._lead_s = FIRST_LEAD_S

    async def retarget(self, job: Job, goal: MotionRequest, timeout_s: float) -> Retargeted:
        """Change the goal of a job's motion. After an error the motion continues unchanged, unless it was
        stopped.

        Args:
            timeout_s: timeout for planning, with all repetitions.

        Raises:
            ConflictError: the job has no motion whose goal can be changed, another client is moving the arm
                or has control, or the change came too late.
            InputError: the goal is relative to the TCP, or has actions or conditions.
            PlanningError: the goal cannot be reached from the point of the change, or the path is not free.
            MotionStopped: a stop was requested in the meantime, or the scene has changed and the new motion
                stops.
            UnavailableError: see `Commands.replace`.
        """
        claim = self._claim_of(job)
        _require_goal(goal)
        self._ownership.require_mover("change the goal of the motion")
        if self._busy:
            raise ConflictError(
                f"job {job.id}: another request is changing its goal, or the service is planning a path "
                "around an object; request the change again"
            )
        self._busy = True
        try:
            return await self._change(claim, job, goal, timeout_s)
        finally:
            self._busy = False

    def seek_way(
        self, under_way: Trajectory, within_s: float, free_s: float, scene: Scene
    ) -> WayAround | None:
        """Begin to search for a different path to the goal of the running motion, in case an object of the
        next scene blocks the current path.

        Only a motion whose path can be chosen freely is redirected: a single motion without constraints,
        actions or conditions, by a planner that moves the joints.

        Args:
            under_way: trajectory of the motion.
            within_s: timeout for the search, s.
            free_s: path time from now that must be free, s. If it is not, no path is searched.
        """
        claim = self._ownership.moving
        if not isinstance(claim, Claim) or self._busy:
            return None
        goal, job = claim.goal, claim.job
        if goal is None or job is None or claim.trajectory is not under_way:
            return None
        if goal.planner not in ANY_GOAL or goal.constraints is not None:
            return None
        try:
            self._claim_of(job)
        except CobotError:
            return None
        way = replace(goal, goal=under_way.end, planner=PlannerName.OMPL, in_tool=False)
        lead_s = within_s * self._link.hurry + MIN_LEAD_S
        work = self._task(claim, under_way, way, lead_s, partial(lead_around, free_s=free_s))
        search = asyncio.create_task(self._planning.compute(work, within_s, scene))
        search.add_done_callback(_note)
        return WayAround(claim, job, self._link.clock.now_s(), search)

    async def lead_around(self, way: WayAround, within_s: float, in_force: asyncio.Event) -> bool:
        """Redirect the running motion to its goal along a different path, because an object is in the current
        path.

        Args:
            within_s: timeout for finding the new path and sending it to the real-time loop, s.
            in_force: event that is set once plans are made and checked in the scene with the object. The new
                path is sent only after that.

        Returns:
            Whether the motion was redirected. If not, it continues as before.
        """
        if self._busy:
            return False
        claim, self._busy = way.claim, True
        try:
            async with asyncio.timeout(within_s):
                found = await claim.run_interruptibly(_result_of(way.search))
                if found is None:
                    return False
                await in_force.wait()
                await self._hand_over(claim, way.job, found, self._link.clock.now_s())
        except (TimeoutError, CobotError) as exc:
            log.info(
                "%smotion %s: no way around: %s", self._link.label, claim.motion_id, str(exc) or "too late"
            )
            return False
        finally:
            self._busy = False
        self._report(claim, found, self._link.clock.now_s() - way.since_s)
        return True

    def _claim_of(self, job: Job) -> Claim:
        """Return the claim of a job whose motion is running.

        Raises:
            ConflictError: the goal of the job cannot be changed; the error gives the reason.
        """
        wait = "; cancel it and request the new motion"
        if job.kind not in KINDS:
            raise ConflictError(f"job {job.id} ({job.kind}) has no goal that can be changed{wait}")
        if job.state is JobState.PAUSED:
            raise ConflictError(f"job {job.id} is paused: resume it first, then change its goal")
        if job.state is not JobState.RUNNING:
            raise ConflictError(f"job {job.id} is {job.state}, so its motion has not begun{wait}")
        claim = self._ownership.claim_of(job)
        if claim is None or claim.trajectory is None or claim.motion_id is None:
            raise ConflictError(f"job {job.id} belongs to the motion queue, whose goals are fixed{wait}")
        if job.signals is not None:
            raise ConflictError(f"job {job.id} has actions or conditions on its path{wait}")
        claim.proceed()
        return claim

    async def _change(self, claim: Claim, job: Job, goal: MotionRequest, timeout_s: float) -> Retargeted:
        begun_s, lead_s = self._link.clock.now_s(), self._lead_s
        for attempt in range(1, ATTEMPTS + 1):
            planned_s = self._link.clock.now_s()
            left_s = timeout_s - (planned_s - begun_s)
            assert claim.trajectory is not None
            work = self._task(claim, claim.trajectory, goal, lead_s, change_goal)
            found = await claim.run_interruptibly(self._planning.compute(work, left_s))
            took_s = self._link.clock.now_s() - planned_s
            lead_s = self._lead_s = min(2.0 * took_s * self._link.hurry + MIN_LEAD_S, MAX_LEAD_S)
            try:
                await self._hand_over(claim, job, found, planned_s)
            except ConflictError:
                raise
            except ExecutionError as exc:
                claim.proceed()
                if attempt == ATTEMPTS:
                    raise ConflictError(
                        f"job {job.id}: in {ATTEMPTS} attempts the arm passed the place of the change "
                        f"before the new motion was ready, so it continues to its former goal: {exc}"
                    ) from exc
                continue
            claim.goal = goal
            return self._report(claim, found, self._link.clock.now_s() - begun_s)
        raise AssertionError

    def _task(
        self,
        claim: Claim,
        under_way: Trajectory,
        goal: MotionRequest,
        lead_s: float,
        change: Callable[..., Result],
    ) -> Callable[[RobotDescription], Result]:
        """Create a task for a planning process: change the goal of a motion at the path time `lead_s` from
        now.
        """
        state = self._link.state()
        now_s = state.path_time_s if state.motion_id == claim.motion_id else 0.0
        return partial(
            change,
            request=self._goals.request(goal, under_way.end),
            under_way=under_way,
            now_s=now_s,
            from_s=now_s + lead_s,
        )

    async def _hand_over(self, claim: Claim, job: Job, found: ChangeOver, planned_s: float) -> None:
        """Make the real-time loop continue with the new trajectory.

        Raises:
            ConflictError: the motion has already ended.
            ExecutionError: the real-time loop rejects the trajectory, for example because the arm has passed
                the point of the change; or the motion was interrupted, and the arm stops on its current path.
        """
        if claim.ended.is_set() or self._ownership.claim_of(job) is not claim:
            raise ConflictError(f"job {job.id} ended while the path to the new goal was being planned")
        await self._motion.replace(claim, found.trajectory, found.offset_s, planned_s)
        claim.proceed()

    def _report(self, claim: Claim, found: ChangeOver, planning_s: float) -> Retargeted:
        motion_id, whole = claim.motion_id, found.trajectory
        assert motion_id is not None
        self._link.events.publish(
            "motion", what="retargeted", motion=motion_id, duration_s=whole.duration_s, by=str(claim.client)
        )
        label, took_ms = self._link.label, 1e3 * planning_s
        log.info("%smotion %d: its new way was ready after %.0f ms", label, motion_id, took_ms)
        state = self._link.state()
        is_old = state.path_duration_s != whole.duration_s  # the state may be from the previous cycle
        now_s = state.path_time_s - (found.offset_s if is_old else 0.0)
        return Retargeted(
            motion_id,
            max(found.begin_s - now_s, 0.0),
            max(found.end_s - now_s, 0.0),
            whole.sample([found.begin_s])[0],
            whole.duration_s - found.begin_s,
            planning_s,
            whole.note,
        )


async def _result_of(search: asyncio.Task[ChangeOver | None]) -> ChangeOver | None:
    return await search


def _note(search: asyncio.Task[ChangeOver | None]) -> None:
    """Log the error of a search, because its caller may no longer wait for the result."""
    if not search.cancelled() and (error := search.exception()) is not None:
        log.debug("no way around: %s", error)


def _require_goal(goal: MotionRequest) -> None:
    """Raises InputError if the goal makes no sense while the arm is moving."""
    if goal.is_relative:
        raise InputError(
            "the goal is relative to the position of the arm (frame_id tool, or an arc by an angle), "
            "but the arm is moving; give the goal in the base frame, or as joint angles"
        )
    if goal.signals != NO_SIGNALS:
        raise InputError(
            "actions and conditions cannot be added to a running motion; leave them out, or cancel the "
            "job and request a new motion"
        )
