"""Sends the service's heartbeat to rtloop. Between two heartbeats, it detects suspensions of the service, and
stops from outside.
"""

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
"""An interruption of the service of at least this duration is a pause, s. By then rtloop has stopped the
arm.
"""
CATCH_UP_S = 0.25
"""Time after a pause within which the service reads all requests that arrived during it, s."""

log = logging.getLogger("cobot.service")


class Heartbeat:
    """Sends the heartbeat from the event loop, so that it stops if the event loop is blocked.

    Attributes:
        on_outside_stop: function that is called when another process, such as `cobot stop`, has stopped the
            arm through shared memory.
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
        """Send the heartbeat to rtloop while the context is open."""
        task = asyncio.create_task(self.beat(), name="heartbeat")
        try:
            yield
        finally:
            task.cancel()

    async def beat(self) -> None:
        """Send the heartbeat until cancelled."""
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
        """Begin to watch for pauses. Called once the service has started, because its start can take long but
        is not a pause.
        """
        self._beaten_s = self._clock.now_s()

    def _note_pause(self) -> None:
        """Record whether this process has just resumed after a pause."""
        now_s = self._clock.now_s()
        if self._beaten_s is not None and now_s - self._beaten_s > PAUSE_S:
            self._paused_s, self._resumed_s = now_s - self._beaten_s, now_s
            self._beaten_s = now_s
            log.warning("%sthe service was suspended for %.1f s", self._label, self._paused_s)

    def require_awake(self) -> None:
        """Reject requests that may be old because this process was suspended.

        Raises:
            UnavailableError: the process was suspended until just now.
        """
        self._note_pause()
        if self._clock.now_s() - self._resumed_s < CATCH_UP_S:
            raise UnavailableError(
                f"the service was suspended for {self._paused_s:.1f} s until just now: requests from that "
                f"time are rejected; send the request again"
            )
