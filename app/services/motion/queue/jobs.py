"""Ends the jobs of queued moves."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from app.services.motion.queue.moves import QueuedMove
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from cobot.errors import CobotError, MotionStopped
from cobot.motions.stretches import Stretch

log = logging.getLogger("cobot.queue")


class QueueJobs:
    """Ends the jobs of the moves in one queue."""

    def __init__(self, ownership: Ownership) -> None:
        self._ownership = ownership

    def end(self, move: QueuedMove, error: BaseException | None = None) -> None:
        """End the job of a move that has arrived, or has failed with `error`."""
        job = move.request.job
        move.signals.end()
        if job is not None and not job.ended.is_set():
            self._ownership.end(job, error, stopped=isinstance(error, MotionStopped))

    def give_up(
        self, moves: Sequence[QueuedMove], error: BaseException, behind: MotionStopped | None = None
    ) -> None:
        """End the jobs of moves that cannot be executed. The first job ends with `error`, all others with
        `behind`.
        """
        if behind is None and isinstance(error, CobotError):
            behind = StopReason(f"the move before it failed: {error}", "move_before", "").error
        for move in moves:
            self.end(move, error)
            error = behind or error


def report_stops(
    label: str,
    stretch: Stretch,
    moves: Sequence[QueuedMove],
    radii_m: Sequence[float],
    before: QueuedMove | None = None,
) -> None:
    """Log the moves that have a blend radius, but at whose end the arm must stop."""
    for move, radius_m, used_m in zip([before, *moves[:-1]], radii_m[:-1], stretch.used_m, strict=True):
        if move is not None and radius_m > 0.0 and used_m == 0.0:
            where = f"{label}move {move.number} ({move.name})"
            log.info(
                "%s: no blend is possible within the limits, so the arm stops at the end of this move", where
            )
