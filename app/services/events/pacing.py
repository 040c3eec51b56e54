"""Wakes listeners in small groups.

Waking hundreds at once would take too long, because targets from a controller and stops must be handled in
between.
"""

from __future__ import annotations

import asyncio

AT_ONCE = 4
"""Number of listeners that are woken in one iteration of the event loop. This takes a quarter of a
millisecond.
"""


class Pacing:
    """The listeners that wait to be woken, in order of arrival."""

    def __init__(self) -> None:
        self._waiting: dict[asyncio.Event, None] = {}
        self._left = AT_ONCE
        self._renewing = False

    def wake(self, listener: asyncio.Event, loop: asyncio.AbstractEventLoop) -> None:
        """Set a listener's event, now or in a later iteration of the event loop."""
        if self._left > 0 and not self._waiting:
            self._set(listener, loop)
        else:
            self._waiting[listener] = None

    def forget(self, listener: asyncio.Event) -> None:
        self._waiting.pop(listener, None)

    def _set(self, listener: asyncio.Event, loop: asyncio.AbstractEventLoop) -> None:
        self._left -= 1
        if not self._renewing:
            self._renewing = True
            loop.call_soon(self._next_iteration, loop)
        listener.set()

    def _next_iteration(self, loop: asyncio.AbstractEventLoop) -> None:
        self._left, self._renewing = AT_ONCE, False
        while self._waiting and self._left > 0:
            first = next(iter(self._waiting))
            del self._waiting[first]
            self._set(first, loop)
