"""Motions one after the other, in the background: accepted at once, executed in their turn.

The queue owns the right to move from the first move that it accepts until it has nothing left. What waits is
executed as one motion, which is prolonged while the arm moves, see `queue_motion`. A move with a blend radius
that takes no more than `SHORT_S` is held back for `BLEND_WAIT_S`, and each further one renews that: the next
one could not be planned in time.

A move that has not begun can be taken out. What waits behind it is planned anew from where it begins then.
Where the motion under way leads to it already, the arm rests on its path first.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from app.services.jobs.job import Job, JobKind
from app.services.motion.execution import MotionService
from app.services.motion.ownership import Caller, Claim, Ownership
from app.services.motion.planning import PlanningService
from app.services.motion.queue_motion import IDLE, QueueMotion
from app.services.motion.queue_moves import Left, MovePlanner, QueuedMove, QueueRequest, head
from app.services.motion.tool_and_limits import RobotSettings
from app.services.state.link import POLL_S, RobotLink
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
)
from cobot.types import Array

BLEND_WAIT_S = 0.25
SHORT_S = 1.0
AT_ONCE = 8
"""So many motions are joined at the most in one task of a planning process; of a sequence all that it has."""
SHOWN_S = 0.2
"""An accepted move is shown as under way for so long at least: clients poll, and some moves are none."""
CAPACITY = 500
"""So many motions wait at the most."""
LARGEST_NUMBER = 2**31 - 1
NAME = "the motion queue"

log = logging.getLogger("cobot.queue")


class MotionQueue:
    """The queue of one robot.

    Attributes:
        last_error: why the queue was emptied last; "" once another move is accepted.
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
        self._waiting: deque[QueuedMove] = deque()
        self._planner = MovePlanner(link.clock, motion, planning, settings)
        self._running = QueueMotion(link, ownership, motion, self._planner)
        self._last: QueuedMove | None = None
        self._end: Array | None = None
        self.last_error = ""

    @property
    def idle(self) -> bool:
        """Whether there is nothing to do, nor anything under way."""
        return self._claim is None

    @property
    def size(self) -> int:
        """How many moves have been accepted and have not ended."""
        return len(self._all)

    @property
    def _all(self) -> list[QueuedMove]:
        return [*self._running.left, *self._waiting]

    @property
    def current(self) -> int:
        """The number of the move that is under way or next, `IDLE` for none."""
        if moves := self._all:
            return moves[0].number
        last = self._last
        if last is None:
            return IDLE
        shown = self._link.clock.now_s() <= last.since_s + SHOWN_S
        return IDLE if self.idle and (self.last_error or not shown) else last.number

    def duration_s(self, number: int) -> float | None:
        """How long a move that has not ended takes at full speed; None if there is no such move."""
        return next((move.duration_s for move in self._all if move.number == number), None)

    async def add(self, request: QueueRequest, stops: int, token: str | None) -> int:
        """Plan a move from where the last one ends, and have it executed in its turn.

        Args:
            stops, token: see `Caller`.

        Returns:
            The move's number.

        Raises:
            InputError, PlanningError: it is no possible motion. The moves before it go on.
            ConflictError: somebody else owns the motion, or may alone; or the queue is full.
            MotionStopped: a stop was requested meanwhile.
            UnavailableError: see `MotionService.ready`.
        """
        if not request.radius_m >= 0.0:
            raise InputError(f"blend_radius must not be negative, got {request.radius_m:g} m")
        if request.exact and request.radius_m > 0.0:
            raise InputError("blend_radius: a round corner would spoil a plan; use 0")
        async with self._turn:
            if self._claim is not None:
                self._ownership.require_control()
                if token != self._token:
                    raise ConflictError(f"the robot is in use by {self._ownership.owner}; wait for it")
                waiting = sum(move.request.count for move in self._all)
                if waiting + request.count > CAPACITY:
                    raise ConflictError(
                        f"the motion queue is full: {waiting} moves are waiting already, {CAPACITY} may"
                    )
                if stops != self._ownership.stops:
                    raise MotionStopped("a stop was requested while the move was being read")
                assert self._end is not None
                return await self._accept(self._claim, request, self._end)
            with contextlib.ExitStack() as stack:
                job = self._ownership.new_job(JobKind.QUEUE, request.name)
                caller = Caller(NAME, token, stops, math.inf, asyncio.Event(), job)
                claim = stack.enter_context(self._ownership.claim(caller))
                state = await self._motion.ready()
                number = await self._accept(claim, request, state.commanded_position)
                # From here the claim belongs to the task that executes the moves.
                self._claim, self._token = claim, token
                self._runner = asyncio.create_task(self._run(claim, stack.pop_all()))
            return number

    async def clear(self, reason: str) -> None:
        """Come to rest on the path and forget all moves, and a pause too; returns when the arm rests."""
        claim = self._claim
        if claim is not None:
            claim.interrupt(MotionStopped(reason))
            claim.speed_override.reset()
            await claim.ended.wait()

    async def cancel(self, job: Job, error: MotionStopped) -> bool:
        """Take a move out that has not begun; what waits behind it is planned anew.

        Returns:
            Whether there is such a move.
        """
        async with self._turn, self._running.joining:
            claim = self._claim
            if claim is None or claim.interruption is not None:
                return False
            for move in self._running.moves[1:]:
                if move.request.job is job:
                    self._running.drop(claim, move, error)
                    return True
            for index, move in enumerate(self._waiting):
                if move.request.job is job:
                    del self._waiting[index]
                    self._running.end(move, error)
                    start = move.legs[0].motion.start if move.legs else self._end
                    assert start is not None
                    await self._plan_anew(claim, index, start)
                    return True
        return False

    async def _accept(self, claim: Claim, request: QueueRequest, start: Array) -> int:
        number = 1 if self._last is None else self._last.number % LARGEST_NUMBER + 1
        self._last = found = await self._planner.planned(claim, number, request, start)
        self._end = found.legs[-1].motion.end if found.legs else start
        self._waiting.append(found)
        self.last_error = ""
        if (job := request.job) is not None:
            job.parent = None if claim.job is None else claim.job.id
            notes = dict.fromkeys(leg.motion.note for leg in found.legs if leg.motion.note)
            job.queued(found.duration_s, "; ".join(notes))
        return number

    async def _plan_anew(self, claim: Claim, index: int, start: Array) -> None:
        """What waits from here on begins elsewhere; a move that cannot fails, with all behind it."""
        while index < len(self._waiting):
            move = self._waiting[index]
            if move.legs and np.array_equal(move.legs[0].motion.start, start):
                return
            try:
                if not move.request.anywhere:
                    raise ConflictError(f"{move.name}: it is given relative to where it was to begin")
                found = await self._planner.planned(claim, move.number, move.request, start)
            except CobotError as exc:
                behind = [self._waiting.pop() for _ in range(len(self._waiting) - index)][::-1]
                self._running.give_up(behind, exc)
                break
            self._waiting[index] = found
            start = found.legs[-1].motion.end if found.legs else start
            index += 1
        self._end = start

    async def _run(self, claim: Claim, belongings: contextlib.ExitStack) -> None:
        error: BaseException | None = asyncio.CancelledError()
        try:
            while True:
                while await self._next(claim):
                    await self._execute(claim)
                async with self._turn:  # somebody may have been about to add one
                    if not self._waiting:
                        error = None
                        return
        except CobotError as exc:
            error = exc
            self.last_error = str(exc)
            log.warning("%sthe motion queue is emptied: %s", self._link.label, exc)
            claim.fail(exc)
            claim.interrupt(exc if isinstance(exc, ExecutionError) else ExecutionError(str(exc)))
            async with self._turn:  # a move that is being planned is refused by now
                self._empty(claim, exc)
        finally:
            if error is not None:
                self._empty(claim, error)
            self._claim = None
            belongings.close()
            self._running.finish()  # last: who has waited for it may move the arm then

    def _empty(self, claim: Claim, error: BaseException) -> None:
        """Nothing of the queue moves any more."""
        moves = [*self._running.moves, *self._waiting]
        self._waiting.clear()
        stop = claim.interruption
        self._running.give_up(moves, error, stop if isinstance(stop, MotionStopped) else None)

    def _head(self) -> list[QueuedMove]:
        """Of those that wait the first: what a motion begins with, or goes on with."""
        return head(self._waiting, AT_ONCE)

    async def _next(self, claim: Claim) -> bool:
        """Wait until a motion may begin with what waits; False if nothing does."""
        while self._waiting:
            claim.proceed()
            chain = self._head()
            last, legs = chain[-1], sum(len(move.legs) for move in chain)
            takes_s = sum(move.duration_s for move in chain)
            waited = self._link.clock.now_s() > last.since_s + BLEND_WAIT_S and not self._turn.locked()
            may_begin = last.request.radius_m == 0.0 or takes_s > SHORT_S or waited or legs >= AT_ONCE
            if may_begin and not claim.speed_override.paused:
                return True
            await asyncio.sleep(POLL_S)
        return False

    async def _execute(self, claim: Claim) -> None:
        """A motion that begins with what waits, and goes on with what comes while it is under way."""
        async with self._running.joining:  # nobody takes out any of it meanwhile
            self._running.finish()
            chain = await self._planner.valid(self._head())
            begins = await self._running.begin(claim, chain) if chain else False
            self._take(chain)
        if not begins:
            return
        left = await self._running.follow(claim, self._head, self._take)
        if self._waiting or self._turn.locked():
            self._running.finish()
        if left is not None:
            async with self._turn:
                self._waiting.extendleft(reversed(left.moves))
                await self._go_on_from_here(claim, left)

    async def _go_on_from_here(self, claim: Claim, left: Left) -> None:
        """The arm rests on its path, and what is left begins there."""
        start = (await self._motion.ready()).commanded_position
        if not left.begun or left.moves[0].request.midway:
            await self._plan_anew(claim, 0, start)
            return
        name, moves = left.moves[0].name, list(self._waiting)
        self._waiting.clear()
        self._running.give_up(moves, ConflictError(f"{name}: it cannot be begun once more amid its path"))
        self._end = start

    def _take(self, chain: Sequence[QueuedMove]) -> None:
        """These moves wait no more."""
        for _ in chain:
            self._waiting.popleft()
