"""Motions one after the other, in the background: accepted at once, executed in their turn.

The queue owns the right to move from the first move that it accepts until it has nothing left. Moves with a
blend radius go on into the next one without a stop. For that the next one has to be there when the motion
begins: a move with a radius is held back for `BLEND_WAIT_S`, and each further one renews that.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from app.services.jobs.job import JobKind
from app.services.motion.execution import MotionService
from app.services.motion.ownership import Caller, Claim, Ownership
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import blended
from app.services.motion.tool_and_limits import RobotSettings
from app.services.state.link import POLL_S, RobotLink
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
    UnavailableError,
)
from cobot.motions.requests import Blended, RatedMove
from cobot.trajectory import Trajectory
from cobot.types import Array

BLEND_WAIT_S = 0.25
SHOWN_S = 0.2
"""An accepted move is shown as under way for so long at least: clients poll, and some moves are none."""
CAPACITY = 500
PLAN_TIMEOUT_S = 20.0
IDLE = -1
LARGEST_NUMBER = 2**31 - 1
NAME = "the motion queue"

log = logging.getLogger("cobot.queue")


@dataclass(frozen=True, slots=True)
class QueuedMove:
    """A planned move; its trajectory is None when the arm is there already."""

    number: int
    name: str
    trajectory: Trajectory | None
    radius_m: float
    since_s: float


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
        self._settings = settings
        self._turn = asyncio.Lock()
        self._claim: Claim | None = None
        self._token: str | None = None
        self._runner: asyncio.Task[None] | None = None
        self._waiting: deque[QueuedMove] = deque()
        self._running: list[tuple[QueuedMove, float]] = []  # with the path time at which each ends
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
        return len(self._waiting) + len(self._running)

    @property
    def current(self) -> int:
        """The number of the move that is under way or next, `IDLE` for none."""
        if self._running:
            return self._executed()
        if self._waiting:
            return self._waiting[0].number
        last = self._last
        if last is None:
            return IDLE
        shown = self._link.clock.now_s() <= last.since_s + SHOWN_S
        return IDLE if self.idle and (self.last_error or not shown) else last.number

    def _executed(self) -> int:
        with contextlib.suppress(UnavailableError):
            now_s = self._link.state().path_time_s
            return next(
                (m.number for m, end_s in self._running if now_s < end_s), self._running[-1][0].number
            )
        return self._running[0][0].number

    def duration_s(self, number: int) -> float | None:
        """How long a move that has not ended takes at full speed; None if there is no such move."""
        for move in (*(move for move, _ in self._running), *self._waiting):
            if move.number == number:
                return 0.0 if move.trajectory is None else move.trajectory.duration_s
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
        trajectory = await self._motion.plan(claim, make(start), PLAN_TIMEOUT_S)
        number = 1 if self._last is None else self._last.number % LARGEST_NUMBER + 1
        self._last = QueuedMove(number, name, trajectory, radius_m, self._link.clock.now_s())
        self._end = start if trajectory is None else trajectory.end
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
        """The moves that are executed as one, first of those that wait; none if none waits."""
        while self._waiting:
            claim.proceed()
            chain = self._chain()
            last = chain[-1]
            waited = self._link.clock.now_s() > last.since_s + BLEND_WAIT_S and not self._turn.locked()
            if (last.radius_m == 0.0 or waited) and not claim.speed_override.paused:
                return chain
            await asyncio.sleep(POLL_S)
        return []

    def _chain(self) -> list[QueuedMove]:
        """The first of those that wait, and all that it may go on into without a stop."""
        chain: list[QueuedMove] = []
        for move in self._waiting:
            chain.append(move)
            if move.radius_m == 0.0:
                break
        return chain

    async def _execute(self, claim: Claim, chain: list[QueuedMove]) -> None:
        moves = [move for move in chain if move.trajectory is not None]
        if moves:
            joined = await self._joined(claim, moves)
            await self._motion.start(claim, joined.trajectory)
            self._running = list(zip(moves, joined.ends_s, strict=True))
        for _ in chain:
            self._waiting.popleft()
        if not moves:
            return
        try:
            await self._motion.arrival(claim)
        finally:
            self._running = []
        names = ", ".join(move.name for move in moves)
        log.info("%smotion %s: arrived and settled (%s)", self._link.label, claim.motion_id, names)

    async def _joined(self, claim: Claim, moves: list[QueuedMove]) -> Blended:
        motions = [move.trajectory for move in moves if move.trajectory is not None]
        if len(motions) == 1:
            return Blended(motions[0], (motions[0].duration_s,), ())
        radii_m = [move.radius_m for move in moves[:-1]]
        work = partial(blended, motions=motions, radii_m=radii_m, envelope=self._settings.envelope)
        joined = await claim.unless_interrupted(self._planning.compute(work, PLAN_TIMEOUT_S))
        for move, rounded in zip(moves, joined.blended, strict=False):
            if not rounded:
                where = f"{self._link.label}move {move.number} ({move.name})"
                log.info("%s: no blend is possible within the limits, the arm stops at its end", where)
        return joined
