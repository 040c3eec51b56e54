"""The trajectories of the queue in the real-time loop, and the position of the arm along them."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass

from app.services.motion.queue.moves import QueuedMove
from app.services.state.link import RobotLink
from cobot.errors import UnavailableError
from cobot.motions.stretches import Stretch


@dataclass(frozen=True, slots=True)
class QueueRun:
    """A trajectory that the real-time loop executes, or will execute next.

    Attributes:
        moves: for each point of the stretch at which a motion ends, the move that ends there.
    """

    stretch: Stretch
    moves: list[QueuedMove]


class Runs:
    """The run that the real-time loop executes, and the run that will replace it.

    Attributes:
        all: the runs, the current one first; empty between motions.
    """

    def __init__(self, link: RobotLink) -> None:
        self._link = link
        self.all: list[QueueRun] = []

    def place(self) -> tuple[QueueRun, float]:
        """Return the current run, and the path time that the arm has reached on it."""
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            for each in reversed(self.all):
                if each.stretch.trajectory.duration_s == state.path_duration_s:
                    return each, state.path_time_s
        return self.all[0], 0.0

    def left(self) -> list[QueuedMove]:
        """List the moves that have not ended. The last move is always included."""
        if not self.all:
            return []
        run, now_s = self.place()
        left = [move for move, end_s in zip(run.moves, run.stretch.ends_s, strict=True) if now_s < end_s]
        return left or run.moves[-1:]

    def passed(self) -> list[QueuedMove]:
        """List the moves whose ends the arm has passed, except the last move."""
        if not self.all:
            return []
        left = {move.number for move in self.left()}
        return [move for move in self.all[0].moves if move.number not in left]

    def left_s(self) -> float:
        """Remaining path time of the current motion, s."""
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            return state.path_duration_s - state.path_time_s
        return math.inf
