"""Controls a sequence between its steps: whether it continues, and at which waypoint.

The runner asks before each step and waits for the answer, a line of JSON in a pipe. A waypoint is the number
of a step in the outermost list.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable

from cobot.errors import ConflictError, InputError

NEXT = 0
"""Value for "the next waypoint that is reached"."""


class RunnerInstructions:
    """The instructions for one runner.

    Args:
        descriptor: descriptor of the pipe that the runner reads; `close` closes it.
        first: the first waypoint; None for the beginning.
        changed: function that is called with true when the runner is held, and with false when it is
            released.
        hold: whether the runner waits before its first motion.
    """

    def __init__(
        self, descriptor: int, first: int | None, changed: Callable[[bool], None], *, hold: bool = False
    ) -> None:
        self._descriptor = descriptor
        self._first = first
        self._changed = changed
        self._hold_first = hold
        self._hold_next = False
        self._hold_at: int | None = None
        self._behind = 0
        self._n_waypoints: int | None = None  # until the runner has asked for the first time
        self.held = False

    def ask(self, behind: int, n_waypoints: int) -> bool:
        """Handle a request from the runner, which asks whether it may continue.

        Args:
            behind: the last waypoint that was reached; 0 if none was reached.
            n_waypoints: number of waypoints, 0 for a program.

        Returns:
            Whether the runner may continue. If so, call `answer` as soon as nothing is paused.
        """
        self._n_waypoints, self._behind = n_waypoints, behind
        has_begun = self._first is None  # if it has not begun, its next step is the first one
        is_there = has_begun and self._hold_at is not None and behind >= self._hold_at
        if is_there:
            self._hold_at = None
        if self._hold_first or is_there or (has_begun and self._hold_next):
            self._hold_first, self._hold_next, self.held = False, False, True
            self._changed(True)
            return False
        return True

    def answer(self) -> None:
        """Make the waiting runner continue."""
        self._answer(None)

    def answer_time(self, paused_s: float) -> None:
        """Answer a runner that asks, during a step, for the total duration of its pauses, s."""
        self._write({"paused_s": paused_s})

    def hold(self, waypoint: int) -> None:
        """Hold the runner at this waypoint or, if it passes this waypoint without a stop, at the next one.

        This is in addition to earlier holds.

        Raises:
            InputError: there is no such waypoint.
        """
        if self._n_waypoints == 0 and waypoint != NEXT:
            raise InputError(
                "at_waypoint: a program has no waypoints; give 0 to hold it before its next motion"
            )
        self._require(waypoint, NEXT)
        if self.held and waypoint <= self._behind:
            return
        if waypoint == NEXT:
            self._hold_next = True
        else:
            self._hold_at = waypoint

    def resume(self, waypoint: int | None = None, *, step: bool = False) -> None:
        """Make the runner continue, if it is waiting or would wait at the next waypoint.

        Args:
            waypoint: waypoint to continue with; None for the next one.
            step: whether the runner waits again at the next waypoint.

        Raises:
            ConflictError: the runner does not wait at a waypoint, so it cannot continue with another one.
            InputError: there is no such waypoint.
        """
        if waypoint is not None:
            if not self.held:
                raise ConflictError("the sequence is not at a waypoint: pause it with at_waypoint first")
            self._require(waypoint, 1)
        self._hold_first, self._hold_next = False, step
        if self.held:
            self.held = False
            self._changed(False)
            self._answer(waypoint)

    def close(self) -> None:
        """Close the pipe, because the runner has ended."""
        os.close(self._descriptor)
        self._descriptor = -1

    def _require(self, waypoint: int, least: int) -> None:
        if self._n_waypoints is not None and not least <= waypoint <= self._n_waypoints:
            raise InputError(
                f"waypoint: there are {self._n_waypoints} waypoints, numbered from 1; got {waypoint}"
            )

    def _answer(self, waypoint: int | None) -> None:
        first, self._first = self._first, None
        waypoint = first if waypoint is None else waypoint
        self._write({"waypoint": waypoint})

    def _write(self, answer: dict[str, float | None]) -> None:
        with contextlib.suppress(OSError):  # the runner has ended
            os.write(self._descriptor, json.dumps(answer).encode() + b"\n")
