"""From the wire's thread to the event loop: in order, without waiting, and never without bound."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable

from ros2.rtps import Sample

MAX_BYTES = 64 << 20

log = logging.getLogger("cobot.ros2")


class Losses:
    """Counts what was lost, and says so when it is the first, the second, the fourth, the eighth and so on.

    Args:
        what: "messages of /demo came too fast".
    """

    def __init__(self, what: str) -> None:
        self.count = 0
        self._what = what

    def add(self) -> None:
        self.count += 1
        if self.count & (self.count - 1) == 0:
            log.warning("lost %d: %s", self.count, self._what)


class Inbox:
    """Hands the samples of one reader to a callback in the event loop, in the order in which they came.

    Args:
        name: of the topic or service.
        deliver: called in the event loop.
        most: how many samples may wait there; what comes beyond is lost, and counted.
    """

    def __init__(
        self,
        name: str,
        loop: asyncio.AbstractEventLoop,
        deliver: Callable[[Sample], None],
        most: int = 10_000,
    ) -> None:
        self.losses = Losses(f"what came on {name} faster than it could be passed on")
        self._loop = loop
        self._deliver = deliver
        self._most = most
        self._samples: deque[Sample] = deque()
        self._bytes = 0
        self._lock = threading.Lock()

    def put(self, sample: Sample) -> None:
        """From any thread."""
        with self._lock:
            if len(self._samples) >= self._most or self._bytes + len(sample.payload) > MAX_BYTES:
                self.losses.add()
                return
            first = not self._samples
            self._samples.append(sample)
            self._bytes += len(sample.payload)
        if first and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._empty)

    def _empty(self) -> None:
        with self._lock:
            samples, self._samples, self._bytes = self._samples, deque(), 0
        for sample in samples:
            self._deliver(sample)
