"""Computes answers that take milliseconds one at a time, with pauses in which other requests are served.

The event loop must stay free for clients that stop the arm. `app.listeners` limits the time spent on reading
one connection; this module limits the time spent on short requests with answers that take long to compute.
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
    """The queue of costly answers of one application."""

    def __init__(self) -> None:
        self._one = asyncio.Lock()

    @asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """Context manager that waits its turn, because only one costly answer is computed at a time."""
        await self._one.acquire()
        begun_s = time.perf_counter()
        try:
            yield
        finally:
            rest_s = min(REST * (time.perf_counter() - begun_s), MAX_REST_S)
            asyncio.get_running_loop().call_later(rest_s, self._one.release)

    async def start(self, rest_s: float) -> None:
        """Wait until work of unknown duration may begin. Other costly work can begin at least `rest_s`
        later.
        """
        await self._one.acquire()
        asyncio.get_running_loop().call_later(rest_s, self._one.release)


def costly_turn(request: Request) -> AbstractAsyncContextManager[None]:
    """Return the context of a turn in the application's queue of costly answers."""
    return cast(Costly, request.app.state.costly).turn()
