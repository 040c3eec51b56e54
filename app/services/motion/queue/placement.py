"""Places the actions and conditions of queued moves on one motion, which is extended while it runs.

The motion follows a series of trajectories. Here, path times start with the motion; for rtloop, they start
with the current trajectory. The part of the motion before a new trajectory stays unchanged, so the TCP path
is extended from there, and the current move keeps its start time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from app.services.motion.execution import MotionService
from app.services.motion.queue.moves import QueuedMove
from app.services.motion.queue.runs import QueueRun
from app.services.motion.queue.signals import later
from app.services.motion.signal_follower import SignalFollower
from app.services.rights.signal_results import NO_RESULTS, SignalResults
from cobot.motions.signal_places import TcpWay
from cobot.motions.signals import NO_PLACED, Placed
from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Placement:
    """The actions and conditions of a motion, placed on one of its trajectories.

    Attributes:
        offset_s: path time of the motion at which the trajectory begins.
        times_s: for each move with signals, by its number, the path time of its start and of the end of
            each leg.
        placed: for each move with signals, by number, the places of its signals.
        way: the TCP path, from the start of the first of these moves; None if there are none.
        signals: all signals in the form that rtloop needs, with path times of the trajectory.
    """

    offset_s: float = 0.0
    times_s: dict[int, list[float]] = field(default_factory=dict)
    placed: dict[int, Placed] = field(default_factory=dict)
    way: TcpWay | None = None
    signals: Placed = NO_PLACED


class QueueSignals:
    """Follows the signals of the queue's current motion."""

    def __init__(self, motion: MotionService, moves: Callable[[], Sequence[QueuedMove]]) -> None:
        """
        Args:
            moves: function that returns the unfinished moves of the current motion, in the order of
                execution.
        """
        self._motion = motion
        self._unended = moves
        self._motion_id = 0
        self._moves: list[QueuedMove] = []
        self._placement = Placement()

    @property
    def results(self) -> SignalResults:
        """The results of the signals, for the move that the arm executes."""
        moves = self._unended()
        return moves[0].signals.results if moves else NO_RESULTS

    @property
    def is_missed(self) -> bool:
        """See `SignalFollower.is_missed`."""
        return any(each.is_missed for each in self._followers)

    @property
    def until(self) -> str:
        """See `SignalFollower.until`."""
        return next((each.until for each in self._followers if each.until), "")

    @property
    def met(self) -> SignalFollower | None:
        """The follower for the move whose condition stopped the motion."""
        return next((each for each in self._followers if each.contact is not None), None)

    @property
    def _followers(self) -> list[SignalFollower]:
        return [each.signals.follower for each in self._unended() if each.signals.follower is not None]

    def look(self) -> None:
        """See `SignalFollower.look`."""
        for index, move in enumerate(list(self._unended())):
            if move.signals.follower is not None:
                move.signals.follower.look(is_current=index == 0)

    def rest(self, tcp: Array) -> None:
        """Record the TCP pose at which the motion has stopped, shape (7,). Each move ends its own
        follower.
        """
        self.look()
        for follower in self._followers:
            follower.note_rest(tcp)

    async def place_first(self, run: QueueRun, moves: Sequence[QueuedMove]) -> Placement:
        """Place the signals of the moves in a motion that will begin."""
        self._motion_id = 0
        return await self._place(Placement(), run, moves, 0.0)

    async def place_next(self, run: QueueRun, moves: Sequence[QueuedMove]) -> Placement:
        """Place the signals on the trajectory that will continue the motion.

        Args:
            moves: the unfinished moves and the added ones.
        """
        before = self._placement
        return await self._place(before, run, moves, before.offset_s + run.stretch.offset_s)

    def take(self, placement: Placement, moves: Sequence[QueuedMove]) -> None:
        """Use a new placement, because the motion now continues on the placement's trajectory."""
        self._placement, self._moves = placement, list(moves)
        self._tell()

    def follow(self, motion_id: int) -> None:
        """Set the number of the motion that has begun."""
        self._motion_id = motion_id
        self._tell()

    def begin_s(self, move: QueuedMove) -> float:
        """Return the trajectory's path time at which a move with signals begins."""
        return self._placement.times_s[move.number][0] - self._placement.offset_s

    def keep_rest(self, move: QueuedMove, path_time_s: float) -> None:
        """Record that the arm has stopped within a move that will be planned again. `path_time_s` is where it
        stopped on the trajectory.
        """
        at = self._placement
        placed = at.placed.get(move.number)
        if placed is not None and at.way is not None and move.request.midway:
            now_s, end_s = at.offset_s + path_time_s, at.times_s[move.number][-1]
            move.signals.keep_rest(placed, now_s, end_s, at.way)

    def has_left(self, move: QueuedMove) -> bool:
        """Whether a move has actions that are not known to have fired."""
        if move.signals.follower is not None:
            move.signals.follower.look()
        return move.signals.pending > 0

    def _tell(self) -> None:
        """Tell each move's follower where on the path the move's signals are."""
        for move in self._moves:
            placed, follower = self._placement.placed.get(move.number), move.signals.follower
            if placed is not None and follower is not None:
                follower.continue_with(placed, self._motion_id, self._placement.times_s[move.number][0])

    async def _place(
        self, before: Placement, run: QueueRun, moves: Sequence[QueuedMove], offset_s: float
    ) -> Placement:
        signalling = [move for move in moves if move.signals]
        if not signalling:
            return Placement(offset_s)
        times_s = _times_s(before, run, offset_s, signalling)
        from_s = min(times_s[move.number][0] for move in signalling)
        way = (await self._motion.way(run.stretch.trajectory)).append_to(before.way, offset_s, from_s)
        placed = {}
        for move in signalling:
            begin_s, ends_s = times_s[move.number][0], [times_s[move.number][count] for count in move.parts]
            placed[move.number] = move.signals.place(move.number, begin_s, ends_s, way, is_cut=True)
        signals = _together(signalling, placed, offset_s, run.stretch.trajectory.duration_s)
        return Placement(offset_s, times_s, placed, way, signals)


def _times_s(
    before: Placement, run: QueueRun, offset_s: float, signalling: Sequence[QueuedMove]
) -> dict[int, list[float]]:
    """Return the path times of the start of each move with signals, and of the end of each of its legs.

    An unfinished move may end before the new trajectory begins, because the arm passes its end on the old
    one.
    """
    known = before.times_s
    found = {each.number: list(known[each.number]) for each in signalling if each.number in known}
    ends_s = run.stretch.ends_s
    numbers = [move.number for move in run.moves]
    for index, (move, end_s) in enumerate(zip(run.moves, ends_s, strict=True)):
        if not move.signals:
            continue
        left = numbers[index:].count(move.number)
        if numbers.index(move.number) == index:
            found.setdefault(move.number, [offset_s] * (len(move.legs) + 1))
            if index > 0:
                found[move.number][-1 - left] = offset_s + ends_s[index - 1]
        found[move.number][-left] = offset_s + end_s
    return found


def _together(
    moves: Sequence[QueuedMove], placed: dict[int, Placed], offset_s: float, duration_s: float
) -> Placed:
    """Return the signals of all moves, with path times of a trajectory that begins at `offset_s`.

    Path times are limited to the duration, because rounding could place an action after the end, where it
    would never fire.
    """
    each = [placed[move.number] for move in moves]
    settled = frozenset[int]().union(*(move.signals.settled for move in moves))
    actions = [action for one in each for action in one.actions if action.number not in settled]
    pausing = [one for one in each if one.pause_while is not None]
    until = next((one for one in each if one.until is not None), NO_PLACED)
    found = Placed(
        tuple(sorted(actions, key=lambda action: (action.path_time_s, action.number))),
        each[0].start_when if len(each) else None,
        pausing[0].pause_while if pausing else None,
        (pausing[0].pause_s[0], pausing[-1].pause_s[1]) if pausing else (0.0, math.inf),
        until.until,
        until.until_s,
    )
    found = later(found, -offset_s)
    within = (replace(each, path_time_s=min(each.path_time_s, duration_s)) for each in found.actions)
    return replace(found, actions=tuple(within))
