"""Answers that cost milliseconds: made one after the other, with more time for all others between them.

The event loop serves who stops the arm, too. A turn of `app.listeners` keeps one connection's bytes from
taking more than a slice of it; what is asked for in a few bytes and takes long to make needs this.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

REST = 4.0
"""Pause after an answer, as a multiple of its duration: costly answers get a fifth of the time in all."""
MAX_REST_S = 1.0


class Costly:
    """Belongs to an application."""

    def __init__(self) -> None:
        self._one = asyncio.Lock()

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Make an answer within this."""
        await self._one.acquire()
        begun_s = time.perf_counter()
        try:
            yield
        finally:
            rest_s = min(REST * (time.perf_counter() - begun_s), MAX_REST_S)
            asyncio.get_running_loop().call_later(rest_s, self._one.release)

    async def start(self, rest_s: float) -> None:
        """Return when work of unknown duration may begin. The next work begins after a rest."""
        await self._one.acquire()
        asyncio.get_running_loop().call_later(rest_s, self._one.release)
