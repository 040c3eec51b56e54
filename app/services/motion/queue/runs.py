"""The trajectories of the queue in the real-time loop, and the arm's place on them."""

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
        moves: for each end in the stretch, the move that ends there.
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
        """The current run, and the path time of the arm on it."""
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            for each in reversed(self.all):
                if each.stretch.trajectory.duration_s == state.path_duration_s:
                    return each, state.path_time_s
        return self.all[0], 0.0

    def left(self) -> list[QueuedMove]:
        """The moves that have not ended; at least the last one."""
        if not self.all:
            return []
        run, now_s = self.place()
        left = [move for move, end_s in zip(run.moves, run.stretch.ends_s, strict=True) if now_s < end_s]
        return left or run.moves[-1:]

    def passed(self) -> list[QueuedMove]:
        """The moves whose ends the arm has passed, except the last one."""
        if not self.all:
            return []
        left = {move.number for move in self.left()}
        return [move for move in self.all[0].moves if move.number not in left]

    def left_s(self) -> float:
        """Path time to the end of the current motion."""
        with contextlib.suppress(UnavailableError):
            state = self._link.state()
            return state.path_duration_s - state.path_time_s
        return math.inf
