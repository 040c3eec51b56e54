"""Passes samples from the network thread to the event loop, in order and through a bounded queue."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Awaitable, Callable

from cobot.dds.rtps import Sample

MAX_BYTES = 64 << 20
BATCH = 64
"""Maximum number of samples that are delivered before other work of the event loop has its turn."""

log = logging.getLogger("cobot.ros2")


class LossCounter:
    """Counts lost messages, and logs the first, the second, the fourth, the eighth and so on.

    Args:
        what: the messages that are lost and the reason, for example "messages on /demo that came too fast".
    """

    def __init__(self, what: str) -> None:
        self.count = 0
        self._what = what

    def add(self, reason: str = "") -> None:
        """Count one more lost message.

        Args:
            reason: the reason why this message was lost, if several reasons are possible.
        """
        self.count += 1
        if self.count & (self.count - 1) == 0:
            log.warning("lost %d: %s%s", self.count, self._what, reason and f": {reason}")


class SampleInbox:
    """Passes the samples of one reader to a callback in the event loop, in order of arrival.

    Args:
        name: name of the topic or service.
        deliver: called in the event loop. If it returns an awaitable, the inbox awaits it before it delivers
            the next sample.
        most: maximum number of waiting samples. Samples above this number are lost and counted.
    """

    def __init__(
        self,
        name: str,
        loop: asyncio.AbstractEventLoop,
        deliver: Callable[[Sample], Awaitable[None] | None],
        most: int = 10_000,
    ) -> None:
        self.name = name
        self.losses = LossCounter(f"messages on {name} that came too fast to be passed on")
        self._loop = loop
        self._deliver = deliver
        self._most = most
        self._samples: deque[Sample] = deque()
        self._bytes = 0
        self._lock = threading.Lock()
        self._pump: asyncio.Task[None] | None = None

    def put(self, sample: Sample) -> None:
        """Add a sample. May be called from any thread."""
        with self._lock:
            if len(self._samples) >= self._most or self._bytes + len(sample.payload) > MAX_BYTES:
                self.losses.add()
                return
            first = not self._samples
            self._samples.append(sample)
            self._bytes += len(sample.payload)
        if first and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._start)

    def _start(self) -> None:
        if self._pump is None or self._pump.done():
            self._pump = self._loop.create_task(self._deliver_all(), name=self.name)

    async def _deliver_all(self) -> None:
        while batch := self._take():
            for sample in batch:
                try:
                    if (work := self._deliver(sample)) is not None:
                        await work
                except Exception as exc:
                    log.error("a message on %s failed", self.name, exc_info=exc)
            await asyncio.sleep(0)

    def _take(self) -> list[Sample]:
        with self._lock:
            batch = [self._samples.popleft() for _ in range(min(BATCH, len(self._samples)))]
            self._bytes -= sum(len(sample.payload) for sample in batch)
        return batch
