"""The waiting moves of a queue, in order.

The first moves are planned, each from the end of the previous one. When a move is removed, the moves after it
become loose: they must be planned again. Removing a move never waits for planning. If a later move is being
planned, its planning is cancelled and begins again from the new start.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from app.services.motion.queue.chains import head
from app.services.motion.queue.moves import MovePlanner, QueuedMove, QueueRequest
from app.services.rights.claims import Claim
from app.services.rights.job import Job
from cobot.errors import CobotError, ConflictError
from cobot.types import Array

MAX_JOINED_LEGS = 8
"""Maximum number of motions that are joined in one planning task. A sequence is always joined as a whole."""
GiveUp = Callable[[Sequence[QueuedMove], BaseException], None]


class QueueLine:
    """The waiting moves of one queue. Only one task at a time may call `add` and `replan_loose`.

    Args:
        give_up: function that is called with the moves that can no longer be planned, and with the error of
            the first one.

    Attributes:
        end: joint positions at the end of the last planned move, shape (dof,), rad; if no planned move is
            waiting, at the end of the current motion.
    """

    def __init__(self, planner: MovePlanner, give_up: GiveUp, end: Array) -> None:
        self.end = end
        self._planner = planner
        self._give_up = give_up
        self._planned: deque[QueuedMove] = deque()
        self._loose: deque[QueuedMove] = deque()
        self._planning: asyncio.Task[QueuedMove] | None = None
        # number of times that `end` was set to a position other than the end of the last planned move
        self._cuts = 0

    def __bool__(self) -> bool:
        return bool(self._planned or self._loose)

    @property
    def moves(self) -> list[QueuedMove]:
        """List all waiting moves."""
        return [*self._planned, *self._loose]

    @property
    def head(self) -> list[QueuedMove]:
        """Return the first planned moves, which begin or continue a motion."""
        return head(self._planned, MAX_JOINED_LEGS)

    @property
    def is_loose(self) -> bool:
        """Whether some moves must be planned again."""
        return bool(self._loose)

    def begins_with(self, chain: Sequence[QueuedMove]) -> bool:
        """Whether the moves in `chain` are still the first planned moves."""
        first = list(self._planned)[: len(chain)]
        return len(first) == len(chain) and all(a is b for a, b in zip(first, chain, strict=True))

    def take(self, chain: Sequence[QueuedMove]) -> bool:
        """Remove the moves in `chain` if they are still the first ones. Return whether they were."""
        if not self.begins_with(chain):
            return False
        for _ in chain:
            self._planned.popleft()
        return True

    def give_back(self, chain: Sequence[QueuedMove]) -> None:
        """Put back moves that were removed with `take`."""
        self._planned.extendleft(reversed(chain))

    def put_first(self, moves: Sequence[QueuedMove], start: Array) -> None:
        """Put moves before all others. All must be planned again, because the first one now begins at
        `start`.
        """
        self._loose.extendleft(reversed([*moves, *self._planned]))
        self._planned.clear()
        self._end_at(start)

    def clear(self) -> list[QueuedMove]:
        """Remove all moves, and return them."""
        moves = self.moves
        self._planned.clear()
        self._loose.clear()
        return moves

    def take_out(self, job: Job) -> QueuedMove | None:
        """Remove the move of a job, if it is waiting. The moves after it become loose."""
        for index, move in enumerate(self._planned):
            if move.request.job is job:
                behind = list(self._planned)[index:]
                for _ in behind:
                    self._planned.pop()
                self._loose.extendleft(reversed(behind[1:]))
                self._end_at(next((each.legs[0].motion.start for each in behind if each.legs), self.end))
                return move
        for move in self._loose:
            if move.request.job is job:
                self._loose.remove(move)
                self._end_at(self.end)
                return move
        return None

    async def add(self, claim: Claim, number: int, request: QueueRequest) -> QueuedMove:
        """Plan a move from the end of the last move, and append it.

        Raises:
            CobotError: see `MovePlanner.plan_move`.
        """
        while True:
            await self.replan_loose(claim)
            found = await self._plan_from_end(claim, number, request)
            if found is not None:
                self._append(found)
                return found

    async def replan_loose(self, claim: Claim) -> None:
        """Plan the loose moves again. If a move cannot be planned, it fails together with all moves after
        it.
        """
        while self._loose:
            move = self._loose[0]
            try:
                found: QueuedMove | None = move
                if not (move.legs and np.array_equal(move.legs[0].motion.start, self.end)):
                    if not move.request.anywhere:
                        raise ConflictError(
                            f"{move.name}: its goal is relative to its start, which has changed"
                        )
                    found = await self._plan_from_end(claim, move.number, move.request)
            except CobotError as exc:
                if claim.interruption is None:
                    behind = list(self._loose)
                    self._loose.clear()
                    self._give_up(behind, exc)
                return
            if found is not None:
                self._loose.popleft()
                self._append(found)

    def _append(self, move: QueuedMove) -> None:
        self._planned.append(move)
        if move.legs:
            self.end = move.legs[-1].motion.end

    def _end_at(self, place: Array) -> None:
        """Set the start of the next move, and cancel the planning of a move that begins elsewhere."""
        self.end = place
        self._cuts += 1
        if self._planning is not None:
            self._planning.cancel()

    async def _plan_from_end(self, claim: Claim, number: int, request: QueueRequest) -> QueuedMove | None:
        """Plan a move that begins at `end`; None if a move was removed in the meantime."""
        cuts = self._cuts
        planning = asyncio.create_task(self._planner.plan_move(claim, number, request, self.end))
        self._planning = planning
        try:
            await asyncio.wait({planning})
        finally:
            planning.cancel()
            self._planning = None
        if self._cuts == cuts:
            return planning.result()
        if not planning.cancelled():
            planning.exception()  # so that asyncio does not report it as unhandled
        return None
