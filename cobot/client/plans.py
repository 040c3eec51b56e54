"""Runs a motion in the service in the background."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable

from cobot.client import Client
from cobot.client.connection import Json
from cobot.clock import SYSTEM, Clock
from cobot.errors import CobotError

BEGIN_S = 15.0
"""Timeout for a plan to begin to move the arm, including planning, s."""
POLL_S = 0.005
Run = Callable[[Client], Json]


class BackgroundPlan:
    """The plan that was started last. If it fails after its start, the next call of `begin` raises the
    error.
    """

    def __init__(self, clock: Clock = SYSTEM) -> None:
        self._clock = clock
        self._thread: threading.Thread | None = None
        self._error: CobotError | None = None

    @property
    def running(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def begin(
        self,
        run: Run,
        connect: Callable[[], contextlib.AbstractContextManager[Client]],
        motion_id: Callable[[], int],
    ) -> None:
        """Start a plan, and return when it begins to move the arm.

        Args:
            run: executes the plan; returns when its goal is reached.
            motion_id: returns the id of the arm's latest motion.

        Raises:
            CobotError: the plan cannot be started, or the previous one has failed.
        """
        self._raise_error()
        before = motion_id()

        def work() -> None:
            try:
                with connect() as client:
                    run(client)
            except CobotError as exc:
                self._error = exc

        thread = self._thread = threading.Thread(target=work, daemon=True)
        thread.start()
        deadline_s = self._clock.now_s() + BEGIN_S
        while thread.is_alive() and motion_id() == before and self._clock.now_s() < deadline_s:
            self._clock.sleep(POLL_S)
        if not thread.is_alive():
            self._raise_error()

    def _raise_error(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error
