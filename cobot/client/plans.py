"""A motion of the service, carried out while the caller goes on."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable

from cobot.client import Client
from cobot.client.connection import Json
from cobot.clock import SYSTEM, Clock
from cobot.errors import CobotError

BEGIN_S = 15.0
"""How long a plan is waited for until it moves the arm: its planning included."""
POLL_S = 0.005
Run = Callable[[Client], Json]


class BackgroundPlan:
    """The plan that was begun last. Its failure after its beginning is raised by the next `begin`."""

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
        """Return when it moves the arm.

        Args:
            run: carries the plan out; returns on arrival.
            motion_id: of the arm's newest motion.

        Raises:
            CobotError: why it does not, or why the one before has failed.
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
