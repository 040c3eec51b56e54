"""Motions one after the other, in the background: accepted at once, executed in their turn.

The queue owns the right to move from the first move that it accepts until it has nothing left. What waits is
executed as one motion, which is prolonged while the arm moves, see `queue_motion`. A move with a blend radius
that takes no more than `SHORT_S` is held back for `BLEND_WAIT_S`, and each further one renews that: the next
one could not be planned in time.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import islice

from app.services.jobs.job import JobKind
from app.services.motion.execution import MotionService
from app.services.motion.ownership import Caller, Claim, Ownership
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import rated
from app.services.motion.queue_motion import IDLE, QueuedMove, QueueMotion
from app.services.motion.tool_and_limits import RobotSettings
from app.services.state.link import POLL_S, RobotLink
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
)
from cobot.motions.requests import RatedMove
from cobot.types import Array

BLEND_WAIT_S = 0.25
SHORT_S = 1.0
AT_ONCE = 8
"""So many moves are joined at the most in one task of a planning process."""
SHOWN_S = 0.2
"""An accepted move is shown as under way for so long at least: clients poll, and some moves are none."""
CAPACITY = 500
PLAN_TIMEOUT_S = 20.0
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
        self._planning = planning
        self._turn = asyncio.Lock()
        self._claim: Claim | None = None
        self._token: str | None = None
        self._runner: asyncio.Task[None] | None = None
        self._waiting: deque[QueuedMove] = deque()
        self._running = QueueMotion(link, motion, planning, settings)
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
        return len(self._waiting) + len(self._running.left)

    @property
    def current(self) -> int:
        """The number of the move that is under way or next, `IDLE` for none."""
        if left := self._running.left:
            return left[0].number
        if self._waiting:
            return self._waiting[0].number
        last = self._last
        if last is None:
            return IDLE
        shown = self._link.clock.now_s() <= last.since_s + SHOWN_S
        return IDLE if self.idle and (self.last_error or not shown) else last.number

    def duration_s(self, number: int) -> float | None:
        """How long a move that has not ended takes at full speed; None if there is no such move."""
        for move in (*self._running.left, *self._waiting):
            if move.number == number:
                return 0.0 if move.leg is None else move.leg.motion.duration_s
        return None

    async def add(
        self,
        name: str,
        make: Callable[[Array], RatedMove],
        radius_m: float,
        stops: int,
        token: str | None,
    ) -> int:
        """Plan a move from where the last one ends, and have it executed in its turn.

        Args:
            name: for people.
            make: the move, from where it starts.
            radius_m: how far from its end the arm may leave its path, if another move follows in time.
            stops, token: see `Caller`.

        Returns:
            The move's number.

        Raises:
            InputError, PlanningError: it is no possible motion. The moves before it go on.
            ConflictError: somebody else owns the motion, or may alone; or the queue is full.
            MotionStopped: a stop was requested meanwhile.
            UnavailableError: see `MotionService.ready`.
        """
        if not radius_m >= 0.0:
            raise InputError(f"blend_radius must not be negative, got {radius_m:g} m")
        async with self._turn:
            if self._claim is not None:
                self._ownership.require_control()
                if token != self._token:
                    raise ConflictError(f"the robot is in use by {self._ownership.owner}; wait for it")
                if self.size >= CAPACITY:
                    raise ConflictError(f"{CAPACITY} moves are waiting already")
                if stops != self._ownership.stops:
                    raise MotionStopped("a stop was requested while the move was being read")
                assert self._end is not None
                return await self._accept(self._claim, name, make, self._end, radius_m)
            with contextlib.ExitStack() as stack:
                job = self._ownership.new_job(JobKind.QUEUE, name)
                caller = Caller(NAME, token, stops, math.inf, asyncio.Event(), job)
                claim = stack.enter_context(self._ownership.claim(caller))
                state = await self._motion.ready()
                number = await self._accept(claim, name, make, state.commanded_position, radius_m)
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

    async def _accept(
        self, claim: Claim, name: str, make: Callable[[Array], RatedMove], start: Array, radius_m: float
    ) -> int:
        work = partial(rated, move=make(start))
        leg = await claim.unless_interrupted(self._planning.compute(work, PLAN_TIMEOUT_S))
        number = 1 if self._last is None else self._last.number % LARGEST_NUMBER + 1
        self._last = QueuedMove(number, name, leg, radius_m, self._link.clock.now_s())
        self._end = start if leg is None else leg.motion.end
        self._waiting.append(self._last)
        self.last_error = ""
        return number

    async def _run(self, claim: Claim, belongings: contextlib.ExitStack) -> None:
        try:
            while True:
                while chain := await self._next(claim):
                    await self._execute(claim, chain)
                async with self._turn:  # somebody may have been about to add one
                    if not self._waiting:
                        return
        except CobotError as exc:
            self.last_error = str(exc)
            log.warning("%sthe motion queue is emptied: %s", self._link.label, exc)
            claim.fail(exc)
            claim.interrupt(exc if isinstance(exc, ExecutionError) else ExecutionError(str(exc)))
            async with self._turn:  # a move that is being planned is refused by now
                self._waiting.clear()
        finally:
            self._waiting.clear()
            self._claim = None
            belongings.close()

    async def _next(self, claim: Claim) -> list[QueuedMove]:
        """The moves that a motion begins with, first of those that wait; none if none waits."""
        while self._waiting:
            claim.proceed()
            chain = list(islice(self._waiting, AT_ONCE))
            last = chain[-1]
            takes_s = sum(move.leg.motion.duration_s for move in chain if move.leg is not None)
            waited = self._link.clock.now_s() > last.since_s + BLEND_WAIT_S and not self._turn.locked()
            may_begin = last.radius_m == 0.0 or takes_s > SHORT_S or waited or len(chain) == AT_ONCE
            if may_begin and not claim.speed_override.paused:
                return chain
            await asyncio.sleep(POLL_S)
        return []

    async def _execute(self, claim: Claim, chain: list[QueuedMove]) -> None:
        """A motion that begins with these moves, and goes on with those that come while it is under way."""
        begins = await self._running.begin(claim, chain)
        self._take(chain)
        if begins:
            await self._running.follow(claim, lambda: list(islice(self._waiting, AT_ONCE)), self._take)

    def _take(self, chain: list[QueuedMove]) -> None:
        """These moves wait no more."""
        for _ in chain:
            self._waiting.popleft()
