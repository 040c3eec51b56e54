"""Where agents reach the service: POST /mcp/mcp.

The library behind it takes a second of computing time to import, which whoever has no agents shall not pay:
it is imported, in a thread, when the first one asks.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING

from starlette.types import Receive, Scope, Send

from app.api.costly import Costly
from app.mcp.departures import Departures

if TYPE_CHECKING:
    from fastapi import FastAPI
    from mcp.server.streamable_http_manager import StreamableHTTPSessionManager

REST_S = 0.02
"""From the beginning of one request to that of the next: each takes the event loop 10 ms or more."""


class McpEndpoint:
    """An ASGI application; `close` ends whatever it has begun."""

    def __init__(self) -> None:
        self._manager: StreamableHTTPSessionManager | None = None
        self._turn = asyncio.Lock()
        self._starts = Costly()
        self._departures = Departures()
        self._running: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        body = await _whole(receive)
        if body is None:  # the library would take it for a mistake of its own, and log where
            return
        async with self._turn:
            if self._manager is None:
                manager = await asyncio.to_thread(_made, scope["app"])
                entered = asyncio.Event()
                self._running = asyncio.create_task(_run(manager, entered), name="MCP")
                await entered.wait()
                self._manager = manager
        await self._starts.start(REST_S)
        with self._departures.watched(scope, body, receive) as received:
            await self._manager.handle_request(scope, received, send)

    async def close(self) -> None:
        if self._running is not None:
            self._running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._running


async def _whole(receive: Receive) -> bytes | None:
    """The whole body; None if the client goes before it has sent that."""
    pieces: list[bytes] = []
    more = True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return None
        pieces.append(message.get("body", b""))
        more = message.get("more_body", False)
    return b"".join(pieces)


async def _run(manager: StreamableHTTPSessionManager, entered: asyncio.Event) -> None:
    """Until it is cancelled: the library's task group has to be left by the task that has entered it."""
    async with manager.run():
        entered.set()
        await asyncio.Event().wait()


def _made(app: FastAPI) -> StreamableHTTPSessionManager:
    from app.mcp.server import session_manager

    return session_manager(app)
