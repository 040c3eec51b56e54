"""The motion that the queue executes. It begins with the waiting moves, and is extended with moves that
arrive while it is running.

A planning process joins the next moves to the motion, and rtloop continues with the result. The part that the
arm executes during planning stays unchanged. So the arm does not stop at the end of a move with a blend
radius, and only briefly at the end of a move without one. If moves arrive too late, the arm stops at the end
of the last move, and a new motion begins.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum, auto

from app.services.motion.execution import MotionService
from app.services.motion.queue.chains import joinable, to_go
from app.services.motion.queue.jobs import QueueJobs, report_stops
from app.services.motion.queue.line import QueueLine
from app.services.motion.queue.moves import PLAN_TIMEOUT_S, Left, MovePlanner, QueuedMove, passed
from app.services.motion.queue.placement import QueueSignals
from app.services.motion.queue.runs import QueueRun, Runs
from app.services.rights.claims import Claim
from app.services.rights.job import Job
from app.services.rights.stop_reason import StopReason
from app.services.state.link import RobotLink
from cobot.errors import CobotError, ExecutionError, MotionStopped
from cobot.ipc.layout import MotionResult
from cobot.motions.stretches import Leg, Stretch, single_leg

IDLE = -1
LOOK_S = 0.01
"""Interval between checks for new moves, s."""
AHEAD_S = 8.0
"""A motion is extended only if its remaining time is at most this, s. So its length does not depend on the
length of the queue.
"""
MIN_LEAD_S, FIRST_LEAD_S, MAX_LEAD_S = 0.15, 0.3, 1.0
"""How far ahead of the arm the motion stays unchanged while it is extended, s: minimum, initial and maximum.
The value is adapted to the duration of the last planning.
"""

log = logging.getLogger("cobot.queue")


class _Phase(Enum):
    """Phase of a motion that the queue executes."""

    NONE = auto()
    STARTING = auto()
    UNDER_WAY = auto()


class QueueMotion:
    """Executes the motions of one robot's queue, one at a time.

    Attributes:
        moves: the moves of the current or the last motion that have not ended, in execution order.
    """

    def __init__(self, link: RobotLink, motion: MotionService, planner: MovePlanner, jobs: QueueJobs) -> None:
        self._link = link
        self._motion = motion
        self._planner = planner
        self._jobs = jobs
        self.moves: list[QueuedMove] = []
        self._phase = _Phase.NONE
        self._joining: list[QueuedMove] = []  # moves that are being sent to rtloop
        self._dropped: list[tuple[QueuedMove, MotionStopped]] = []
        self._planning: asyncio.Task[Stretch] | None = None  # moves with which the motion will be extended
        self._runs = Runs(link)
        self._signals = QueueSignals(motion, lambda: self.moves)
        self._lead_s = FIRST_LEAD_S

    @property
    def unended(self) -> list[QueuedMove]:
        """List all moves that have left the queue and have not ended."""
        return [*self.moves, *self._joining]

    @property
    def left(self) -> list[QueuedMove]:
        """List the moves of the current motion that have not ended."""
        return list({move.number: move for move in [*self._runs.left(), *self._joining]}.values())

    async def execute(self, claim: Claim, line: QueueLine) -> Left | None:
        """Execute a motion that begins with the waiting moves, and continues with those that arrive while it
        is running.

        Returns:
            The rest of the motion, once the arm is at rest, if a move was dropped from it. None if the motion
                has reached its end, or if no move can begin now.

        Raises:
            CobotError: see `MotionService.start`, `MotionService.arrival`, `PlanningService.compute`.
        """
        self.finish()
        chain = line.head
        try:
            chain = await self._planner.valid(chain)
            moves, legs, radii = to_go(chain)
            stretch = await self._plan(claim, legs, radii)
        except CobotError:
            if claim.interruption is None and not line.begins_with(chain):
                return None  # the error is about a move that has since been removed
            raise
        if claim.speed_override.paused or not line.take(chain):
            return None
        if stretch is None:
            self.moves = list(chain)
            return None
        self._joining, self._phase = list(chain), _Phase.STARTING
        try:
            return await self._run(claim, line, QueueRun(stretch, moves), radii)
        finally:
            self.moves += self._joining
            self._joining, self._dropped, self._runs.all = [], [], []
            self._phase = _Phase.NONE

    async def _run(
        self, claim: Claim, line: QueueLine, running: QueueRun, radii: Sequence[float]
    ) -> Left | None:
        """Start a planned motion and follow it to its end; see `execute`."""
        try:
            if not await self._start(claim, running):
                return await self._cut_off(None)
            report_stops(self._link.label, running.stretch, running.moves, [0.0, *radii])
            await self._follow(claim, line)
            return await self._go_back(claim)
        except MotionStopped:
            if not self._dropped or claim.interruption is not None:
                raise
            self._follow_jobs(claim)
            has_moved = self._runs.place()[1] > 0.0 or len(self._runs.all) > 1
            return await self._cut_off(self._current_move if has_moved else None)

    async def _plan(self, claim: Claim, legs: Sequence[Leg], radii: Sequence[float]) -> Stretch | None:
        """Plan a stretch through these legs; None if there are no legs."""
        if not legs:
            return None
        if len(legs) == 1 and radii[0] == 0.0:
            return single_leg(legs[0])
        return await self._planner.begin_stretch(claim, legs, radii)

    async def _start(self, claim: Claim, running: QueueRun) -> bool:
        """Start the motion. Returns False if a move was dropped before anything moved."""
        try:
            placement = await self._signals.place_first(running, self._joining)
            self._signals.take(placement, self._joining)
            trajectory = running.stretch.trajectory
            await self._motion.start(
                claim, trajectory, signals=placement.signals, followed=self._signals.follow
            )
        except ExecutionError:
            if not self._dropped or claim.interruption is not None:
                raise
            return False
        finally:
            claim.stops += len(self._dropped)  # see `drop`
            self._phase = _Phase.UNDER_WAY
        self._runs.all, self.moves, self._joining = [running], self._joining, []
        self._follow_jobs(claim)
        return True

    async def _follow(self, claim: Claim, line: QueueLine) -> None:
        """Follow the motion to its end, and extend it with waiting moves. Call `finish` to end its jobs.

        Raises:
            CobotError: see `MotionService.arrival`.
        """
        arrival = asyncio.create_task(self._motion.arrival(claim, self._signals))
        tried: QueuedMove | None = None
        try:
            while not arrival.done():
                chain = line.head
                news = bool(chain) and chain[-1] is not tried and not claim.speed_override.paused
                if news and not self._dropped and self._runs.left_s() < AHEAD_S:
                    tried = chain[-1]
                    await self._prolong(claim, line)
                self._follow_jobs(claim)
                await asyncio.wait({arrival}, timeout=LOOK_S)
            self._follow_jobs(claim)
            await arrival
            names = ", ".join({move.number: move.name for move in self._runs.all[0].moves}.values())
            log.info("%smotion %s: arrived and settled (%s)", self._link.label, claim.motion_id, names)
        finally:
            arrival.cancel()

    async def _go_back(self, claim: Claim) -> Left | None:
        """If a contact has ended the motion, move back from it. The next move begins at the new position.

        Raises:
            CobotError: see `MotionService.retract`.
        """
        follower = self._signals.met
        if follower is None:
            return None
        if follower.retract_m > 0.0:
            running, begin_s = self._runs.all[0], self._signals.begin_s(self.moves[-1])
            await self._motion.retract(
                claim, running.stretch.trajectory, follower, PLAN_TIMEOUT_S, begin_s=begin_s
            )
        return Left([], None, (await self._motion.require_ready()).commanded_position)

    async def _cut_off(self, begun: QueuedMove | None) -> Left:
        """End the dropped moves once the arm is at rest. `begun` is the move during which the arm stopped.

        Raises:
            CobotError: see `MotionService.ready`.
        """
        self.moves += self._joining
        self._joining = []
        self._end_dropped()
        start = (await self._motion.require_ready()).commanded_position
        self._end_dropped()  # more moves may have been dropped in the meantime
        left, self.moves = self.moves, []
        if not any(each is begun for each in left):
            begun = None
        if begun is not None:
            self._signals.keep_rest(begun, self._runs.place()[1])
        behind = {move.number for move in self._passed}
        return Left([passed(each) if each.number in behind else each for each in left], begun, start)

    @property
    def _passed(self) -> list[QueuedMove]:
        """Return the moves whose ends the arm has passed while it was stopping, and whose actions have not
        all fired.
        """
        return [move for move in self._runs.passed() if move.signals.pending]

    @property
    def _current_move(self) -> QueuedMove | None:
        """Return the first move whose end the arm has not passed."""
        over = {move.number for move in self._runs.passed()}
        return next((move for move in self.moves if move.number not in over), None)

    def _end_dropped(self) -> None:
        for move, error in self._dropped:
            if not any(each is move for each in self.moves):
                continue  # the arm has passed the move's end while it was stopping
            self._end(move, error)
            log.info("%smove %d: %s", self._link.label, move.number, error)
        self._dropped = []

    def drop(self, claim: Claim, job: Job, error: MotionStopped) -> bool:
        """Stop the arm on its path, because a move of the current motion was cancelled.

        The motion then continues with the other moves: see `execute`.

        Returns:
            Whether the job belongs to one of the moves and has not ended.
        """
        if self._phase is _Phase.NONE:
            self.finish()
        self._follow_jobs(claim)
        move = next((each for each in self.unended if each.request.job is job), None)
        if move is None:
            return False
        self._dropped.append((move, error))
        self._link.request_stop()
        if self._phase is _Phase.UNDER_WAY:
            claim.stops += 1  # so that this stop does not end the motion; a stop by another client still does
        # Before its start, rtloop would reject the motion because of this stop, which `_start` counts.
        if self._planning is not None:
            self._planning.cancel()
        return True

    def finish(self) -> None:
        """End all moves of the motion, because it has reached its end."""
        for move in list(self.moves):
            self._end(move)

    def _end(self, move: QueuedMove, error: BaseException | None = None) -> None:
        self.moves.remove(move)
        self._jobs.end(move, error)

    def _follow_jobs(self, claim: Claim) -> None:
        """Report the arm's progress to the jobs. The last job ends with the motion."""
        if not self._runs.all:
            return
        running, now_s = self._runs.place()
        ends = dict(zip((move.number for move in running.moves), running.stretch.ends_s, strict=True))
        for move in list(self.moves[:-1]):
            if ends.get(move.number, now_s) > now_s:
                break
            if self._dropped and self._signals.has_left(move):
                continue  # the job ends once the arm is at rest
            self._end(move)
        move = self.moves[0]
        job, left_s = move.request.job, ends.get(move.number, now_s) - now_s
        if job is None:
            return
        if job.motion_id != claim.motion_id:
            job.its_turn(claim.speed_override, claim.motion_id, left_s)
        job.set_left_s(left_s)

    async def _prolong(self, claim: Claim, line: QueueLine) -> None:
        """Extend the current motion with those of the next moves that can be joined to it.

        If the extension cannot be planned, the error is reported when the moves would begin.
        """
        try:
            chain = await self._planner.valid(line.head)
        except CobotError:  # reported when the moves would begin
            return
        running, state = self._runs.all[0], self._link.state()
        chain = joinable(self.moves, chain)
        moves, legs, radii = to_go(chain)
        stretch = running.stretch
        left_s = stretch.trajectory.duration_s - state.path_time_s
        if not legs or state.motion_result is not MotionResult.RUNNING or left_s < MIN_LEAD_S:
            return
        if chain[0].stops_before:  # the arm stops before this move
            stretch = replace(stretch, radii_m=(*stretch.radii_m[:-1], 0.0))
        now_s, begun_s = state.path_time_s, self._link.clock.now_s()
        times_s = now_s, now_s + self._lead_s
        try:
            longer = await self._longer(claim, stretch, legs, radii, times_s)
            planned_s = self._link.clock.now_s()
            took_s = (planned_s - begun_s) * self._link.hurry
            self._lead_s = min(max(2.0 * took_s + 0.1, MIN_LEAD_S), MAX_LEAD_S)
            if longer is None or not line.take(chain):
                return
            self._joining = list(chain)
            both = [*running.moves, *moves]
            after = QueueRun(longer, both[len(both) - len(longer.ends_s) :])
            self._runs.all.append(after)
            placement = await self._signals.place_next(after, [*self.moves, *chain])
            if self._dropped:
                raise StopReason("a move has been removed in the meantime", "cancelled", "").error
            await self._motion.replace(
                claim, longer.trajectory, longer.offset_s, planned_s, placement.signals
            )
            self._signals.take(placement, [*self.moves, *chain])
        except CobotError as exc:  # the motion continues unchanged; if it must end, it reports this itself
            self._runs.all = [running]
            if claim.interruption is None and not self._dropped:
                line.give_back(self._joining)
                self._joining = []
                place = f"{self._link.label}move {moves[0].number} ({moves[0].name})"
                log.info("%s: the arm stops before this move: %s", place, exc)
            return
        self._runs.all = [after]
        self.moves += self._joining
        self._joining = []
        report_stops(self._link.label, longer, moves, [stretch.radii_m[-1], *radii], running.moves[-1])

    async def _longer(
        self,
        claim: Claim,
        stretch: Stretch,
        legs: Sequence[Leg],
        radii: Sequence[float],
        times_s: tuple[float, float],
    ) -> Stretch | None:
        """Plan the current motion extended with the new moves; None if a move was dropped in the meantime."""
        work = self._planner.prolong(claim, stretch, legs, radii, times_s)
        planning = self._planning = asyncio.create_task(work)
        try:
            await asyncio.wait({planning})
        finally:
            planning.cancel()
            self._planning = None
        return None if self._dropped or planning.cancelled() else planning.result()
