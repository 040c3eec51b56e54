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
from functools import partial

from app.services.motion.execution import MotionService
from app.services.motion.ownership import Claim
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import begun, prolonged
from app.services.motion.tool_and_limits import RobotSettings
from app.services.state.link import RobotLink
from cobot.errors import CobotError, UnavailableError
from cobot.ipc.layout import MotionResult
from cobot.motions.stretches import Leg, Stretch, alone

PLAN_TIMEOUT_S = 20.0
IDLE = -1
LOOK_S = 0.01
"""So often it is looked for moves that have come."""
AHEAD_S = 8.0
"""A motion that goes on for longer is not prolonged yet, s: so it does not grow with the queue."""
LEAST_LEAD_S, FIRST_LEAD_S, MOST_LEAD_S = 0.15, 0.3, 1.0
"""For so long the motion stays as it is while it is prolonged, s; it follows how long that took last."""

log = logging.getLogger("cobot.queue")


@dataclass(frozen=True, slots=True)
class QueuedMove:
    """A planned move; its leg is None when the arm is there already."""

    number: int
    name: str
    leg: Leg | None
    radius_m: float
    since_s: float


@dataclass(frozen=True, slots=True)
class _Running:
    """What rtloop has or is about to have, and the moves in it, of which there are as many as it has ends."""

    stretch: Stretch
    moves: list[QueuedMove]


class QueueMotion:
    """The motions of one robot's queue, one after the other."""

    def __init__(
        self, link: RobotLink, motion: MotionService, planning: PlanningService, settings: RobotSettings
    ) -> None:
        self._link = link
        self._motion = motion
        self._planning = planning
        self._settings = settings
        self._running: list[_Running] = []  # The one that rtloop has, and the one that it is about to have.
        self._lead_s = FIRST_LEAD_S

    @property
    def left(self) -> list[QueuedMove]:
        """The moves of the motion under way that have not ended."""
        if not self._running:
            return []
        running, now_s = self._running[0], 0.0
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            now_s = state.path_time_s
            for each in self._running:
                if each.stretch.trajectory.duration_s == state.path_duration_s:
                    running = each
        ends = running.stretch.ends_s
        left = [move for move, end_s in zip(running.moves, ends, strict=True) if now_s < end_s]
        return left or running.moves[-1:]

    async def begin(self, claim: Claim, chain: Sequence[QueuedMove]) -> bool:
        """Have a motion started that goes through these moves; whether there is anything to move.

        Raises:
            CobotError: see `MotionService.start`, `PlanningService.compute`.
        """
        moves, legs, radii = _to_go(chain)
        if not legs:
            return False
        if len(legs) == 1 and radii[0] == 0.0:
            stretch = alone(legs[0])
        else:
            work = partial(begun, legs=legs, radii_m=radii, envelope=self._settings.envelope)
            stretch = await claim.unless_interrupted(self._planning.compute(work, PLAN_TIMEOUT_S))
        await self._motion.start(claim, stretch.trajectory)
        self._running = [_Running(stretch, moves)]
        self._tell(stretch, moves)
        return True

    async def follow(
        self,
        claim: Claim,
        waiting: Callable[[], list[QueuedMove]],
        take: Callable[[list[QueuedMove]], None],
    ) -> None:
        """Until the motion has ended; what waits meanwhile prolongs it.

        Args:
            waiting: the moves that come next.
            take: called with those that have become part of the motion.

        Raises:
            CobotError: see `MotionService.arrival`.
        """
        arrival = asyncio.create_task(self._motion.arrival(claim))
        tried: QueuedMove | None = None
        try:
            while not arrival.done():
                chain = waiting()
                news = bool(chain) and chain[-1] is not tried and not claim.speed_override.paused
                if news and self._left_s() < AHEAD_S:
                    tried = chain[-1]
                    if await self._prolong(claim, chain):
                        take(chain)
                await asyncio.wait({arrival}, timeout=LOOK_S)
            await arrival
            names = ", ".join(move.name for move in self._running[0].moves)
            log.info("%smotion %s: arrived and settled (%s)", self._link.label, claim.motion_id, names)
        finally:
            arrival.cancel()
            self._running = []

    def _left_s(self) -> float:
        """How far the motion under way is from its end, in path time."""
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            return state.path_duration_s - state.path_time_s
        return math.inf

    async def _prolong(self, claim: Claim, chain: Sequence[QueuedMove]) -> bool:
        """Have the motion under way go on through these moves; False: it comes to its end before them."""
        running, state = self._running[0], self._link.state()
        moves, legs, radii = _to_go(chain)
        stretch = running.stretch
        left_s = stretch.trajectory.duration_s - state.path_time_s
        if not legs or state.motion_result is not MotionResult.RUNNING or left_s < LEAST_LEAD_S:
            return False
        if chain[0].leg is None:  # who wants to be where the arm gets to, stops there
            stretch = replace(stretch, radii_m=(*stretch.radii_m[:-1], 0.0))
        now_s, begun_s = state.path_time_s, self._link.clock.now_s()
        work = partial(
            prolonged,
            under_way=stretch,
            legs=legs,
            radii_m=radii,
            times_s=(now_s, now_s + self._lead_s),
            envelope=self._settings.envelope,
        )
        try:
            longer = await claim.unless_interrupted(self._planning.compute(work, PLAN_TIMEOUT_S))
            planned_s = self._link.clock.now_s()
            self._lead_s = min(max(2.0 * (planned_s - begun_s) + 0.1, LEAST_LEAD_S), MOST_LEAD_S)
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
            return False
        self._running = [after]
        self._tell(longer, moves, running.moves[-1])
        return True

    def _tell(self, stretch: Stretch, moves: Sequence[QueuedMove], before: QueuedMove | None = None) -> None:
        """Say at which moves with a radius the arm stops all the same."""
        for move, used_m in zip([before, *moves[:-1]], stretch.used_m, strict=True):
            if move is not None and move.radius_m > 0.0 and used_m == 0.0:
                where = f"{self._link.label}move {move.number} ({move.name})"
                log.info("%s: no blend is possible within the limits, the arm stops at its end", where)


def _to_go(chain: Sequence[QueuedMove]) -> tuple[list[QueuedMove], list[Leg], list[float]]:
    """The moves that move anything, how, and with which radius; before one that does not, the arm stops."""
    moves: list[QueuedMove] = []
    legs: list[Leg] = []
    radii: list[float] = []
    for move in chain:
        if move.leg is not None:
            moves.append(move)
            legs.append(move.leg)
            radii.append(move.radius_m)
        elif radii:
            radii[-1] = 0.0
    return moves, legs, radii
