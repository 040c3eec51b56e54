"""Outputs that wait for the thread that sets them."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Iterator

MAX_WAIT_S = 2.0
"""Maximum time for which an output waits, s. Then the device hangs, and people no longer expect the output
to change when it answers again.
"""

log = logging.getLogger("cobot.rtloop")


class QueuedOutputs:
    """The cycle adds outputs, and a thread takes them."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, str, float]] = deque()

    def add(self, name: str, value: float) -> None:
        """Real-time safe."""
        self._waiting.append((time.monotonic(), name, value))

    def take(self) -> Iterator[tuple[str, float]]:
        """Remove the outputs, the oldest first. Those that have waited too long are logged instead."""
        while self._waiting:
            since_s, name, value = self._waiting.popleft()
            waited_s = time.monotonic() - since_s
            if waited_s <= MAX_WAIT_S:
                yield name, value
            else:
                log.warning(
                    "%s is not set to %g: the device has not answered for %.1f s, allowed: %g s; "
                    "set it again",
                    name,
                    value,
                    waited_s,
                    MAX_WAIT_S,
                )
