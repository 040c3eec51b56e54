"""The service's signs of life to rtloop, and what it notices between two of them."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import AsyncIterator, Callable

from cobot.clock import Clock
from cobot.errors import UnavailableError
from cobot.ipc.shm import RobotMemory

HEARTBEAT_S = 0.05
PAUSE_S = 1.0
"""A pause of the service that is longer than this counts: rtloop has stopped the arm by then."""
CATCH_UP_S = 0.25
"""Time after a pause in which the service reads all requests that waited, s."""

log = logging.getLogger("cobot.service")


class Heartbeat:
    """Comes from the event loop itself: a stuck one is a dead one.

    Attributes:
        on_outside_stop: called when the arm was stopped through shared memory, as `cobot stop` does.
    """

    def __init__(self, memory: RobotMemory, clock: Clock, label: str) -> None:
        self._memory = memory
        self._clock = clock
        self._label = label
        self.on_outside_stop: Callable[[], None] | None = None
        self._beaten_s: float | None = None
        self._paused_s, self._resumed_s = 0.0, float("-inf")

    @contextlib.asynccontextmanager
    async def beating(self) -> AsyncIterator[None]:
        """Tell rtloop that the service is alive, for as long as the context lasts."""
        task = asyncio.create_task(self.beat(), name="heartbeat")
        try:
            yield
        finally:
            task.cancel()

    async def beat(self) -> None:
        """Until it is cancelled."""
        block = self._memory.heartbeat
        block.data["pid"] = os.getpid()
        outside = self._memory.outside_stops.value
        while True:
            if (newest := self._memory.outside_stops.value) != outside:
                outside = newest
                if self.on_outside_stop is not None:
                    self.on_outside_stop()
            if self._beaten_s is not None:
                self._note_pause()
                self._beaten_s = self._clock.now_s()
            block.data["monotonic_ns"] = self._clock.now_ns()
            block.publish()
            await asyncio.sleep(HEARTBEAT_S)

    def watch_for_pauses(self) -> None:
        """The service has started, which may take long and is no pause; from now on `require_awake` tells."""
        self._beaten_s = self._clock.now_s()

    def _note_pause(self) -> None:
        """See whether this process has just gone on after a pause."""
        now_s = self._clock.now_s()
        if self._beaten_s is not None and now_s - self._beaten_s > PAUSE_S:
            self._paused_s, self._resumed_s = now_s - self._beaten_s, now_s
            self._beaten_s = now_s
            log.warning("%sthe service stood still for %.1f s", self._label, self._paused_s)

    def require_awake(self) -> None:
        """Reject requests that may be old, because they waited while this process stood still.

        Raises:
            UnavailableError: it stood still until just now.
        """
        self._note_pause()
        if self._clock.now_s() - self._resumed_s < CATCH_UP_S:
            raise UnavailableError(
                f"the service stood still for {self._paused_s:.1f} s until just now: what was asked for "
                "meanwhile moves nothing; ask again"
            )
