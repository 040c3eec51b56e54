"""Actions and conditions of one queued move, and their results.

They belong to the move, not to the motion that executes it. If the move is planned again, actions that have
fired do not fire again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from app.services.motion.signal_follower import SignalFollower
from app.services.rights.signal_results import NO_RESULTS, SignalResults
from cobot.motions.signal_places import TcpWay, place_signals, rest_of
from cobot.motions.signals import NO_PLACED, NO_SIGNALS, PathPlace, PathSignals, Placed
from cobot.types import MAX_ACTIONS

AT_ONCE = PathPlace("fraction", 0.0)


class MoveSignals:
    """The actions and conditions of one move.

    Attributes:
        placed: places of the actions and conditions on the last planned path.
        follower: follower of the actions and conditions; None while the move is not planned.
    """

    def __init__(self, segments: Sequence[PathSignals] = (), exact: Placed = NO_PLACED) -> None:
        """
        Args:
            segments: the signals of each motion in the move.
            exact: the signals of a plan, which is run unchanged.
        """
        self._segments = tuple(segments)
        self._exact = exact
        self.placed = NO_PLACED
        self.follower: SignalFollower | None = None

    def __bool__(self) -> bool:
        return any(each != NO_SIGNALS for each in self._segments) or self._exact != NO_PLACED

    @property
    def results(self) -> SignalResults:
        """Results of the actions and conditions so far."""
        return NO_RESULTS if self.follower is None else self.follower.results

    @property
    def settled(self) -> frozenset[int]:
        """Numbers of the actions that are known to have fired or to have been rejected."""
        return frozenset() if self.follower is None else self.follower.settled

    @property
    def pending(self) -> int:
        """Number of actions that have not fired."""
        return len(self.placed.actions) - len(self.settled)

    def pauses_as(self, other: MoveSignals) -> bool:
        """Whether both moves have the same `pause_while` condition, which applies to their whole paths."""
        alone = len(self._segments) == len(other._segments) == 1
        return alone and self.placed.pause_while == other.placed.pause_while

    def place(
        self, number: int, begin_s: float, ends_s: Sequence[float], way: TcpWay, *, is_cut: bool = False
    ) -> Placed:
        """Find the places of the signals on a path.

        Args:
            number: number of the move, which makes the numbers of its actions unique in the queue.
            begin_s, ends_s: path times of the move's start and of the end of each of its motions.
            way, is_cut: see `place_signals`.

        Raises:
            InputError: see `place_signals`.
        """
        if self._exact != NO_PLACED:
            found = later(self._exact, begin_s)
        else:
            found = place_signals(self._segments, ends_s, way, begin_s, is_cut=is_cut)
        first = number * (MAX_ACTIONS + 1)
        actions = tuple(replace(each, number=first + each.number) for each in found.actions)
        return replace(found, actions=actions)

    def follow(self, placed: Placed, make: Callable[[], SignalFollower]) -> None:
        """Set the places on a new path, which the arm has not reached yet. `make` creates the follower the
        first time.
        """
        self.placed = placed
        if self.follower is None:
            self.follower = make()
        self.follower.continue_with(placed, 0, 0.0)

    def keep_rest(self, placed: Placed, now_s: float, end_s: float, way: TcpWay) -> None:
        """Keep only the places that the arm has not reached, because the move was interrupted at `now_s` and
        its remaining part will be planned again. The move must consist of a single motion.
        """
        ordered = sorted(placed.actions, key=lambda each: each.number)
        times_s = [each.path_time_s for each in ordered]
        self._segments = (rest_of(self._segments[0], times_s, now_s, end_s, way),)

    def make_due(self) -> None:
        """Make all remaining actions due at once, because the arm has passed the end of the move."""
        ordered = sorted(self.placed.actions, key=lambda each: each.number)
        self._exact = NO_PLACED
        self._segments = (PathSignals(tuple(replace(each.action, place=AT_ONCE) for each in ordered)),)

    def end(self) -> None:
        """Record that the move has ended."""
        if self.follower is not None:
            self.follower.look()
            self.follower.end()


def later(placed: Placed, by_s: float) -> Placed:
    """Return a copy of the placed signals in which all path times are later by `by_s`."""
    return replace(
        placed,
        actions=tuple(replace(each, path_time_s=each.path_time_s + by_s) for each in placed.actions),
        pause_s=(placed.pause_s[0] + by_s, placed.pause_s[1] + by_s),
        until_s=placed.until_s + by_s,
    )
