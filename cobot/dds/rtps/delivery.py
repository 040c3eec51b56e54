"""The thread that calls the user's callbacks, so that a callback cannot delay the network thread."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from queue import SimpleQueue

from cobot.dds.rtps.types import ParticipantStatistics

_log = logging.getLogger(__name__)
_LAST_CALLBACK_S = 5.0


class Delivery:
    """Makes the queued calls one at a time, in order. An error in a callback is logged and counted."""

    def __init__(self, statistics: ParticipantStatistics) -> None:
        self._statistics = statistics
        self._calls: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="rtps-delivery", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def put(self, call: Callable[[], None]) -> None:
        self._calls.put(call)

    def close(self) -> None:
        """Stop after all queued calls. Waits for them for at most 5 s."""
        self._calls.put(None)
        if threading.current_thread() is not self._thread:
            self._thread.join(_LAST_CALLBACK_S)

    def _run(self) -> None:
        while (call := self._calls.get()) is not None:
            try:
                call()
            except Exception:  # noqa: BLE001 - whatever a callback raises, the others must go on
                self._statistics.failed += 1
                _log.exception("an error in a callback of a DDS reader")
