"""Outputs that wait for the thread that sets them."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Iterator

MAX_WAIT_S = 2.0
"""Maximum time that an output waits, s. After that it is dropped: the device hangs, and a late change of the
output would be unexpected.
"""

log = logging.getLogger("cobot.rtloop")


class QueuedOutputs:
    """A queue of outputs to set. The cycle adds outputs, and a thread takes them."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, str, float]] = deque()

    def add(self, name: str, value: float) -> None:
        """Add an output and its value to the queue. Real-time safe."""
        self._waiting.append((time.monotonic(), name, value))

    def take(self) -> Iterator[tuple[str, float]]:
        """Remove all outputs and return them, oldest first. Outputs that have waited too long are logged
        instead of returned.
        """
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
