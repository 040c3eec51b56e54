"""The motion queue: moves are accepted at once and executed in order, in the background.

The queue holds the claim on the arm from its first move until it is empty. Waiting moves are executed as one
motion, which is extended while the arm is moving; see the module `motion`. A move with a blend radius that
takes at most `SHORT_S` waits for `BLEND_WAIT_S` before it begins, because otherwise the next move could not
be planned in time. Each further move renews this wait.

Each move can be removed at any time, without waiting for planning. The moves after it are planned again from
their new start. If the move is part of the current motion, the arm first stops on its path.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math

import numpy as np

from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.motion.queue.jobs import QueueJobs
from app.services.motion.queue.line import MAX_JOINED_LEGS, QueueLine
from app.services.motion.queue.motion import IDLE, QueueMotion
from app.services.motion.queue.moves import MovePlanner, QueuedMove, QueueRequest
from app.services.motion.tool_and_limits import RobotSettings
from app.services.rights.claims import Caller, Claim
from app.services.rights.job import Job, JobKind
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from app.services.state.link import POLL_S, RobotLink
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
)

BLEND_WAIT_S = 0.25
SHORT_S = 1.0
SHOWN_S = 0.2
"""Minimum time for which a move is reported as running, s, so that clients that poll notice short moves."""
CAPACITY = 500
"""Maximum number of waiting motions."""
MAX_NUMBER = 2**31 - 1
NAME = "the motion queue"

log = logging.getLogger("cobot.queue")


class MotionQueue:
    """The queue of one robot.

    Attributes:
        last_error: reason why the queue was last emptied; "" once a new move is accepted.
    """

    def __init__(
        self,
        link: RobotLink,
        ownership: Ownership,
        motion: MotionService,
        planning: PlanningService,
        settings: RobotSettings,
    ) -> None:
        self._link = link
        self._ownership = ownership
        self._motion = motion
        self._turn = asyncio.Lock()
        self._claim: Claim | None = None
        self._token: str | None = None
        self._runner: asyncio.Task[None] | None = None
        self._mender: asyncio.Task[None] | None = None
        self._planner = MovePlanner(link.clock, motion, planning, settings)
        self._jobs = QueueJobs(ownership)
        self._line = QueueLine(self._planner, self._jobs.give_up, np.zeros(0))
        self._running = QueueMotion(link, motion, self._planner, self._jobs)
        self._last: QueuedMove | None = None
        self.last_error = ""

    @property
    def idle(self) -> bool:
        """Whether the queue is empty and executes no motion."""
        return self._claim is None

    @property
    def size(self) -> int:
        """Number of accepted moves that have not ended."""
        return len(self._all)

    @property
    def _all(self) -> list[QueuedMove]:
        return [*self._running.left, *self._line.moves]

    @property
    def current(self) -> int:
        """Number of the current or next move; `IDLE` if there is none."""
        if moves := self._all:
            return moves[0].number
        last = self._last
        if last is None:
            return IDLE
        shown = self._link.clock.now_s() <= last.since_s + SHOWN_S
        return IDLE if self.idle and (self.last_error or not shown) else last.number

    def duration_s(self, number: int) -> float | None:
        """Return the duration at full speed of a move that has not ended, s; None if there is no such
        move.
        """
        return next((move.duration_s for move in self._all if move.number == number), None)

    async def add(self, request: QueueRequest, stops: int, token: str | None) -> int:
        """Plan a move from the end of the last move, and queue it.

        Args:
            stops, token: see `Caller`.

        Returns:
            The move's number.

        Raises:
            InputError, PlanningError: the move cannot be planned. Earlier moves continue.
            ConflictError: another client is moving the arm or has control, or the queue is full.
            MotionStopped: a stop was requested in the meantime.
            UnavailableError: see `MotionService.ready`.
        """
        if not request.radius_m >= 0.0:
            raise InputError(f"blend_radius must not be negative, got {request.radius_m:g} m")
        if request.exact and request.radius_m > 0.0:
            raise InputError("blend_radius: a plan cannot be blended, because it is run unchanged; use 0")
        async with self._turn:
            if self._claim is not None:
                self._ownership.require_control()
                if token != self._token:
                    raise ConflictError(f"the robot is in use by {self._ownership.owner}; wait for it")
                waiting = sum(move.request.count for move in self._all)
                if waiting + request.count > CAPACITY:
                    raise ConflictError(
                        f"the motion queue is full: {waiting} moves are waiting, allowed: {CAPACITY}"
                    )
                if stops != self._ownership.stops:
                    raise StopReason("a stop was requested while the move was being read", by="").error
                return await self._accept(self._claim, request)
            with contextlib.ExitStack() as stack:
                job = self._ownership.new_job(JobKind.QUEUE, request.name)
                caller = Caller(NAME, token, stops, math.inf, asyncio.Event(), job)
                claim = stack.enter_context(await self._ownership.claim_motion(caller))
                self._line.put_first([], (await self._motion.require_ready()).commanded_position)
                number = await self._accept(claim, request)
                # From here on, the task that executes the moves owns the claim.
                self._claim, self._token = claim, token
                self._runner = asyncio.create_task(self._run(claim, stack.pop_all()))
            return number

    async def clear(self, reason: str) -> None:
        """Stop the arm on its path and remove all moves. Also ends a pause. Returns when the arm is at
        rest.
        """
        claim = self._claim
        if claim is not None:
            claim.interrupt(StopReason(reason, "cancelled").error)
            claim.speed_override.reset()
            await claim.ended.wait()

    def cancel(self, job: Job, error: MotionStopped) -> bool:
        """Remove a move, even while it is being planned. The moves after it are planned again.

        The job has ended when this returns. If the move is part of the current motion, its job ends only when
        the arm has stopped on its path.

        Returns:
            Whether the queue contains a move of this job.
        """
        claim = self._claim
        if claim is None or claim.interruption is not None:
            return False
        if self._running.drop(claim, job, error):
            return True
        move = self._line.take_out(job)
        if move is None:
            return False
        self._jobs.end(move, error)
        if self._line.is_loose and self._mender is None:
            self._mender = asyncio.create_task(self._replan(claim))
        return True

    async def _accept(self, claim: Claim, request: QueueRequest) -> int:
        number = 1 if self._last is None else self._last.number % MAX_NUMBER + 1
        self._last = found = await self._line.add(claim, number, request)
        self.last_error = ""
        if (job := request.job) is not None:
            job.parent = None if claim.job is None else claim.job.id
            notes = dict.fromkeys(leg.motion.note for leg in found.legs if leg.motion.note)
            job.enqueue(found.duration_s, "; ".join(notes))
        return number

    async def _replan(self, claim: Claim) -> None:
        try:
            async with self._turn:
                await self._line.replan_loose(claim)
        finally:
            self._mender = None

    async def _run(self, claim: Claim, belongings: contextlib.ExitStack) -> None:
        error: BaseException | None = asyncio.CancelledError()
        try:
            while True:
                while await self._next(claim):
                    await self._execute(claim)
                async with self._turn:  # wait for a client that is just adding a move
                    if not self._line:
                        error = None
                        return
        except CobotError as exc:
            error = exc
            self.last_error = str(exc)
            log.warning("%sthe motion queue is emptied: %s", self._link.label, exc)
            claim.fail(exc)
            claim.interrupt(exc if isinstance(exc, ExecutionError) else ExecutionError(str(exc)))
            async with self._turn:  # any move that was being planned has been rejected by now
                self._empty(claim, exc)
        finally:
            if self._mender is not None:
                self._mender.cancel()
            if error is not None:
                self._empty(claim, error)
            self._claim = None
            belongings.close()
            self._running.finish()  # last, because a waiting client may then move the arm

    def _empty(self, claim: Claim, error: BaseException) -> None:
        """End all moves with an error, because the queue has failed or was stopped."""
        moves = [*self._running.unended, *self._line.clear()]
        self._running.moves = []
        stop = claim.interruption
        self._jobs.give_up(moves, error, stop if isinstance(stop, MotionStopped) else None)

    async def _next(self, claim: Claim) -> bool:
        """Wait until a motion may begin with the waiting moves. Return False if no moves are waiting."""
        while self._line:
            claim.proceed()
            chain = self._line.head
            if not chain:
                async with self._turn:
                    await self._line.replan_loose(claim)
                continue
            last, legs = chain[-1], sum(len(move.legs) for move in chain)
            takes_s = sum(move.duration_s for move in chain)
            waited = self._link.clock.now_s() > last.since_s + BLEND_WAIT_S and not self._turn.locked()
            enough = takes_s > SHORT_S or legs >= MAX_JOINED_LEGS
            may_begin = last.request.radius_m == 0.0 or enough or waited
            if may_begin and not claim.speed_override.paused:
                return True
            await asyncio.sleep(POLL_S)
        return False

    async def _execute(self, claim: Claim) -> None:
        """Execute a motion that begins with the waiting moves. Moves that arrive while the motion is running
        extend it.
        """
        left = await self._running.execute(claim, self._line)
        if self._line or self._turn.locked():
            self._running.finish()
        if left is None:
            return
        moves = left.moves
        if left.begun is not None and not left.begun.request.midway:
            at = next(index for index, move in enumerate(moves) if move is left.begun)
            given_up, moves = [*moves[at:], *self._line.clear()], moves[:at]
            error = ConflictError(f"{given_up[0].name}: it cannot begin again in the middle of its path")
            self._jobs.give_up(given_up, error)
        self._line.put_first(moves, left.start)
        async with self._turn:
            await self._line.replan_loose(claim)
