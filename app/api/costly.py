"""Answers that cost milliseconds: made one after the other, with more time for all others between them.

The event loop also serves the clients that stop the arm. `app.listeners` limits the time that the bytes of
one connection take; a short request whose answer takes long to make needs this module.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import cast

from fastapi import Request

REST = 4.0
"""Pause after an answer, as a multiple of its duration. Costly answers use at most a fifth of the time."""
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


def costly_turn(request: Request) -> AbstractAsyncContextManager[None]:
    """A turn among the costly answers of the whole application."""
    return cast(Costly, request.app.state.costly).turn()
