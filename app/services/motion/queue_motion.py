"""A motion of the queue: begun with the moves that wait, prolonged by those that come while it is under way.

A planning process joins the next moves to the motion, which stays the same for as long as that may take, and
rtloop goes on with what comes of it: so the arm does not stop at a move with a radius, and not longer than it
has to at one without. When they come too late, the arm rests at the end of the last move, and a new motion
begins.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from app.services.motion.execution import MotionService
from app.services.motion.ownership import Claim, Ownership
from app.services.motion.queue_moves import Left, MovePlanner, QueuedMove, to_go
from app.services.state.link import RobotLink
from cobot.errors import CobotError, MotionStopped, UnavailableError
from cobot.ipc.layout import MotionResult
from cobot.motions.stretches import Stretch, alone

IDLE = -1
LOOK_S = 0.01
"""So often it is looked for moves that have come."""
AHEAD_S = 8.0
"""A motion that goes on for longer is not prolonged yet, s: so it does not grow with the queue."""
MIN_LEAD_S, FIRST_LEAD_S, MAX_LEAD_S = 0.15, 0.3, 1.0
"""For so long the motion stays as it is while it is prolonged, s; it follows how long that took last."""

log = logging.getLogger("cobot.queue")


@dataclass(frozen=True, slots=True)
class _Running:
    """What rtloop has or is about to have, and of each of its ends the move that it belongs to."""

    stretch: Stretch
    moves: list[QueuedMove]


class QueueMotion:
    """The motions of one robot's queue, one after the other.

    Attributes:
        moves: of the motion under way, or of the last one: those that have not ended, in their order.
        joining: held while moves that wait become part of a motion.
    """

    def __init__(
        self,
        link: RobotLink,
        ownership: Ownership,
        motion: MotionService,
        planner: MovePlanner,
    ) -> None:
        self._link = link
        self._ownership = ownership
        self.moves: list[QueuedMove] = []
        self.joining = asyncio.Lock()
        self._dropped: tuple[QueuedMove, MotionStopped] | None = None
        self._motion = motion
        self._planner = planner
        self._running: list[_Running] = []  # The one that rtloop has, and the one that it is about to have.
        self._lead_s = FIRST_LEAD_S

    @property
    def left(self) -> list[QueuedMove]:
        """The moves of the motion under way that have not ended."""
        if not self._running:
            return []
        running, now_s = self._place()
        ends = running.stretch.ends_s
        left = [move for move, end_s in zip(running.moves, ends, strict=True) if now_s < end_s]
        once = {move.number: move for move in left or running.moves[-1:]}
        return list(once.values())

    def _place(self) -> tuple[_Running, float]:
        """What rtloop has, and where on it the arm is, as path time."""
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            for each in reversed(self._running):
                if each.stretch.trajectory.duration_s == state.path_duration_s:
                    return each, state.path_time_s
        return self._running[0], 0.0

    async def begin(self, claim: Claim, chain: Sequence[QueuedMove]) -> bool:
        """Have a motion started that goes through these moves; whether there is anything to move.

        Raises:
            CobotError: see `MotionService.start`, `PlanningService.compute`.
        """
        moves, legs, radii = to_go(chain)
        if not legs:
            self.moves = list(chain)
            return False
        if len(legs) == 1 and radii[0] == 0.0:
            stretch = alone(legs[0])
        else:
            stretch = await self._planner.begun(claim, legs, radii)
        await self._motion.start(claim, stretch.trajectory)
        self._running = [_Running(stretch, moves)]
        self.moves = list(chain)
        self._follow_jobs(claim)
        self._tell(stretch, moves, [0.0, *radii])
        return True

    async def follow(
        self,
        claim: Claim,
        waiting: Callable[[], list[QueuedMove]],
        take: Callable[[list[QueuedMove]], None],
    ) -> Left | None:
        """Until the motion has arrived; what waits meanwhile prolongs it. `finish` says so to its jobs.

        Args:
            waiting: the moves that come next.
            take: called with those that have become part of the motion.

        Returns:
            What is left of a motion from which a move was dropped; None when the motion has arrived.

        Raises:
            CobotError: see `MotionService.arrival`.
        """
        arrival = asyncio.create_task(self._motion.arrival(claim))
        tried: QueuedMove | None = None
        try:
            while not arrival.done():
                async with self.joining:
                    chain = waiting()
                    news = bool(chain) and chain[-1] is not tried and not claim.speed_override.paused
                    if news and self._dropped is None and self._left_s() < AHEAD_S:
                        tried = chain[-1]
                        take(await self._prolong(claim, chain))
                self._follow_jobs(claim)
                await asyncio.wait({arrival}, timeout=LOOK_S)
            await arrival
            names = ", ".join({move.number: move.name for move in self._running[0].moves}.values())
            log.info("%smotion %s: arrived and settled (%s)", self._link.label, claim.motion_id, names)
        except MotionStopped:
            if self._dropped is None or claim.interruption is not None:
                raise
            dropped, error = self._dropped
            self._follow_jobs(claim)
            begun = self.moves[0] is not dropped
            self.end(dropped, error)
            log.info("%smove %d: %s", self._link.label, dropped.number, error)
            left, self.moves = self.moves, []
            return Left(left, begun)
        finally:
            arrival.cancel()
            self._running = []
            self._dropped = None
        return None

    def drop(self, claim: Claim, move: QueuedMove, error: MotionStopped) -> None:
        """Have the arm rest on its path: a move that the motion leads to shall not be."""
        self._dropped = move, error
        self._link.request_stop()
        claim.stops += 1  # of this motion alone: one that anybody else asks for is one more

    def finish(self) -> None:
        """The motion has arrived: so have its moves."""
        for move in list(self.moves):
            self.end(move)

    def end(self, move: QueuedMove, error: BaseException | None = None) -> None:
        """A move has ended."""
        if move in self.moves:
            self.moves.remove(move)
        job = move.request.job
        if job is not None and not job.ended.is_set():
            self._ownership.end(job, error, stopped=isinstance(error, MotionStopped))

    def give_up(
        self, moves: Sequence[QueuedMove], error: BaseException, behind: MotionStopped | None = None
    ) -> None:
        """None of these moves can be any more: the first for this error, the others for that behind it."""
        if behind is None and isinstance(error, CobotError):
            behind = MotionStopped(f"the move before it failed: {error}")
        for move in list(moves):
            self.end(move, error)
            error = behind or error

    def _follow_jobs(self, claim: Claim) -> None:
        """Tell the jobs how far the arm is. The last one ends where the motion does."""
        running, now_s = self._place()
        ends = dict(zip((move.number for move in running.moves), running.stretch.ends_s, strict=True))
        for move in list(self.moves[:-1]):
            if ends.get(move.number, now_s) > now_s:
                break
            self.end(move)
        move = self.moves[0]
        job, left_s = move.request.job, ends.get(move.number, now_s) - now_s
        if job is None:
            return
        if job.motion_id != claim.motion_id:
            job.its_turn(claim.speed_override, claim.motion_id, left_s)
        job.left(left_s)

    def _left_s(self) -> float:
        """How far the motion under way is from its end, in path time."""
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            return state.path_duration_s - state.path_time_s
        return math.inf

    async def _prolong(self, claim: Claim, waiting: Sequence[QueuedMove]) -> list[QueuedMove]:
        """Have the motion under way go on through those of these moves that are possible; which it does.

        It comes to its end before the others.
        """
        try:
            chain = await self._planner.valid(waiting)
        except CobotError:  # said when it would begin
            return []
        running, state = self._running[0], self._link.state()
        moves, legs, radii = to_go(chain)
        stretch = running.stretch
        left_s = stretch.trajectory.duration_s - state.path_time_s
        if not legs or state.motion_result is not MotionResult.RUNNING or left_s < MIN_LEAD_S:
            return []
        if chain[0].stops_before:  # who wants to be where the arm gets to, stops there
            stretch = replace(stretch, radii_m=(*stretch.radii_m[:-1], 0.0))
        now_s, begun_s = state.path_time_s, self._link.clock.now_s()
        times_s = now_s, now_s + self._lead_s
        try:
            longer = await self._planner.prolonged(claim, stretch, legs, radii, times_s)
            planned_s = self._link.clock.now_s()
            self._lead_s = min(max(2.0 * (planned_s - begun_s) + 0.1, MIN_LEAD_S), MAX_LEAD_S)
            both = [*running.moves, *moves]
            after = _Running(longer, both[len(both) - len(longer.ends_s) :])
            self._running.append(after)
            await self._motion.replace(claim, longer.trajectory, longer.offset_s, planned_s)
        except CobotError as exc:  # the motion goes on as it was, and says by itself if it is to end
            self._running = [running]
            if claim.interruption is None:
                log.info(
                    "%smove %d (%s): the arm rests before it: %s",
                    self._link.label,
                    moves[0].number,
                    moves[0].name,
                    exc,
                )
            return []
        self._running = [after]
        self.moves += chain
        self._tell(longer, moves, [stretch.radii_m[-1], *radii], running.moves[-1])
        return chain

    def _tell(
        self,
        stretch: Stretch,
        moves: Sequence[QueuedMove],
        radii_m: Sequence[float],
        before: QueuedMove | None = None,
    ) -> None:
        """Say at which moves with a radius the arm stops all the same."""
        for move, radius_m, used_m in zip([before, *moves[:-1]], radii_m[:-1], stretch.used_m, strict=True):
            if move is not None and radius_m > 0.0 and used_m == 0.0:
                where = f"{self._link.label}move {move.number} ({move.name})"
                log.info("%s: no blend is possible within the limits, the arm stops at its end", where)
