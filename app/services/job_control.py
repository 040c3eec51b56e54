"""Operations on jobs: begin, wait for, cancel, pause and resume a job."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Coroutine
from typing import Any

from app.services.clients import CLIENT
from app.services.gripping.service import GripperService
from app.services.motion.queue.motion_queue import MotionQueue
from app.services.motion.queue.moves import QueueRequest
from app.services.programs.sequences import SequenceService
from app.services.programs.steps import NEXT, RunnerInstructions
from app.services.programs.studies import StudyService
from app.services.rights.claims import Caller
from app.services.rights.job import WITHOUT_ARM, Job, JobRecord, JobState
from app.services.rights.job_book import JobBook, unknown
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from app.services.rights.stopping import StopService
from cobot.errors import CobotError, ConflictError, ExecutionError, PlanningTimeout
from cobot.types import RESTING

log = logging.getLogger("cobot.jobs")

ENDS_S = 1.0
"""Maximum time between a motion's end and its job's end, s."""


class JobService:
    """The jobs of one robot."""

    def __init__(
        self,
        book: JobBook,
        ownership: Ownership,
        stopping: StopService,
        sequences: SequenceService,
        queue: MotionQueue,
        gripper: GripperService,
        studies: StudyService,
    ) -> None:
        self.book = book
        self._studies = studies
        self._gripper = gripper
        self._queue = queue
        self._sequences = sequences
        self._ownership = ownership
        self._stopping = stopping
        self._tasks: set[asyncio.Task[Any]] = set()
        self._paused: Job | None = None  # the last job that was paused by a request with its id

    async def begin(self, job: Job, work: Coroutine[Any, Any, Any]) -> JobRecord:
        """Run a job in the background.

        Args:
            work: coroutine that does the job's work. A blocking endpoint awaits the same coroutine.

        Raises:
            CobotError: the job is rejected for a reason that is known before planning.
        """
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._forget_task)
        accepted = asyncio.create_task(job.accepted.wait())
        try:
            await asyncio.wait({task, accepted}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            accepted.cancel()
        if not job.accepted.is_set():
            await task  # raises
        return job.record()

    async def enqueue(self, job: Job, request: QueueRequest, caller: Caller) -> JobRecord:
        """Queue a motion. Returns once it is planned and waits in the queue.

        Raises:
            PlanningTimeout: planning takes longer than the caller's timeout.
            CobotError: see `MotionQueue.add`.
        """
        time_s = caller.timeout_s
        try:
            async with asyncio.timeout(time_s):
                await self._queue.add(request, caller.stops, caller.token)
        except TimeoutError as exc:
            raise PlanningTimeout.after(time_s, f"not planned within {time_s:g} s") from exc
        return job.record()

    async def wait(self, number: str, timeout_s: float) -> JobRecord:
        """Wait until a job has ended or the timeout has passed, and return the job.

        Raises:
            NotFoundError: the job is unknown or has expired.
        """
        job = self.book.live(number)
        if job is not None and timeout_s > 0.0:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(job.ended.wait(), timeout_s)
            return job.record()
        return self._find(number)

    async def cancel(self, number: str, timeout_s: float) -> JobRecord:
        """Cancel only this job, regardless of which client started it. The arm stops on its path.

        A queued job leaves the queue, and all other jobs continue.

        Raises:
            NotFoundError, ConflictError: there is no such job, or it has already ended.
            ExecutionError: the arm is not known to be at rest; the error gives the reason.
        """
        job = self.going(number)
        reason = StopReason(f"job {number} was cancelled by {CLIENT.get()}", "cancelled")
        error = reason.error
        if job is self._ownership.sequence_job:
            stopped = await self._stopping.stop(timeout_s, reason)
            if not stopped.success:
                raise ExecutionError(stopped.message)
        elif not any(each.cancel(job, error) for each in (self._queue, self._gripper, self._studies)):
            self._ownership.cancel(job, error)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(job.ended.wait(), timeout_s)
        if job is self._paused and job.ended.is_set():  # a job in the queue; the queue continues without it
            await self._resume()
        return job.record()

    async def pause(self, number: str, at_waypoint: int | None = None) -> JobRecord:
        """Pause a job: the arm stops on its path and the job waits. Returns when the arm is at rest.

        Args:
            at_waypoint: waypoint to which a sequence continues and at which it then waits; 0 for the next
                waypoint.

        Raises:
            NotFoundError, ConflictError: there is no such job, the job has already ended or ended before the
                arm could stop, or it is not a sequence.
            InputError: there is no such waypoint.
            ExecutionError, UnavailableError: see `SpeedOverride.pause`.
        """
        job = self.going(number)
        if job.state is JobState.QUEUED:
            raise ConflictError(
                f"job {number} is queued; pause the job before it instead, then this job waits too",
                details={"cause": "queued"},
            )
        if job.kind in WITHOUT_ARM:
            raise ConflictError(
                f"job {number} ({job.kind}) does not move the arm and cannot pause; cancel it"
            )
        if at_waypoint is None:
            await self._pause(job)
        else:
            self._steps(job).hold(at_waypoint)
        return job.record()

    async def _pause(self, job: Job) -> None:
        under_way = job.state is JobState.RUNNING and job is not self._ownership.sequence_job
        self._paused = job
        await self._ownership.speed_override.pause()
        if under_way and job.link.state().mode in RESTING:  # The job ended before it could pause.
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(job.ended.wait(), ENDS_S)
        if job.ended.is_set():
            # Otherwise no client could resume the job, and the next job would start paused.
            await self._resume()
            raise ConflictError(f"job {job.id} has already ended: {job.state}", details={"cause": "ended"})

    async def _resume(self) -> None:
        self._paused = None
        await self._ownership.speed_override.resume()

    async def step(self, number: str) -> JobRecord:
        """Continue a paused sequence for one motion. Raises the same errors as `resume`."""
        job = self.going(number)
        steps = self._steps(job)
        self._require_paused(job)
        if steps.held:
            steps.resume(step=True)
        else:
            steps.hold(NEXT)
        await self._resume()
        return job.record()

    async def resume(self, number: str, waypoint: int | None = None) -> JobRecord:
        """Resume a paused job.

        Args:
            waypoint: next waypoint, for a sequence that waits at a waypoint.

        Raises:
            NotFoundError, ConflictError: there is no such job, it has already ended or is not paused, another
                client has control, or the job is not a sequence that waits at a waypoint.
            InputError: there is no such waypoint.
            UnavailableError: see `SpeedOverride.resume`.
        """
        job = self.going(number)
        self._require_paused(job)
        if job is self._ownership.sequence_job or waypoint is not None:
            self._steps(job).resume(waypoint)
        await self._resume()
        return job.record()

    def _steps(self, job: Job) -> RunnerInstructions:
        if job is not self._ownership.sequence_job:
            raise ConflictError(
                f"job {job.id} ({job.kind}) has no waypoints; only sequences and programs have them"
            )
        return self._sequences.steps

    def _require_paused(self, job: Job) -> None:
        self._ownership.require_control()
        if job.state is not JobState.PAUSED:
            raise ConflictError(f"job {job.id} is {job.state}: only a paused job can be resumed")
        if self._ownership.speed_override.fraction == 0.0:
            raise ConflictError(
                f"job {job.id} is waiting because the speed override is 0; change it with POST "
                "/robot/speed_override",
                details={"cause": "speed_zero"},
            )

    def going(self, number: str) -> Job:
        """Return a job that has not ended.

        Raises:
            NotFoundError, ConflictError: there is no such job, or it has already ended.
        """
        job = self.book.live(number)
        if job is None:
            raise ConflictError(
                f"job {number} has already ended: {self._find(number).state}", details={"cause": "ended"}
            )
        return job

    def _find(self, number: str) -> JobRecord:
        record = self.book.find(number)
        if record is None:
            raise unknown(number)
        return record

    def _forget_task(self, task: asyncio.Task[Any]) -> None:
        self._tasks.discard(task)
        error = None if task.cancelled() else task.exception()
        if error is not None and not isinstance(error, CobotError):
            log.error("a job failed", exc_info=error)
