"""Publishes the service's log lines as events."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Iterator

from app.services.events.ring import Events
from cobot.logs.lines import Line


class _LogEvents(logging.Handler):
    """A log handler that publishes log lines as events. Any thread may use it. `Events` limits the rate of
    these events.
    """

    def __init__(self, events: Events) -> None:
        super().__init__(logging.WARNING)
        self._events = events
        self._loop = asyncio.get_running_loop()

    def emit(self, record: logging.LogRecord) -> None:
        line = Line.of(record, "")
        with contextlib.suppress(RuntimeError):  # the event loop is closed
            self._loop.call_soon_threadsafe(self._publish, line)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Ignore the error, because logging it would cause another event."""

    def _publish(self, line: Line) -> None:
        self._events.publish(
            "log", level=line.level.lower(), logger=line.logger, message=line.message, **line.ids
        )


@contextlib.contextmanager
def log_events(events: Events) -> Iterator[None]:
    """While the context is open, publish log lines of level warning and above as events."""
    handler = _LogEvents(events)
    root = logging.getLogger()
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
