"""The endpoint for agents: POST /mcp/mcp.

Importing the MCP library takes a second of computing time, so a thread does it when the first agent connects.
Services without agents never import it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from typing import TYPE_CHECKING

from starlette.types import Receive, Scope, Send

from app.api.costly import Costly
from app.api.errors import answer_to
from app.mcp.departures import Departures
from app.mcp.own_rest import OwnRest
from cobot.errors import NotFoundError, PayloadError

if TYPE_CHECKING:
    from fastapi import FastAPI
    from mcp.server.streamable_http_manager import StreamableHTTPSessionManager

MAX_BODY_BYTES = 32_768
"""Maximum size of a request, bytes. The arguments of a tool take a few hundred bytes, and the library blocks
the event loop for about a microsecond per byte.
"""
STOPPED = "cobot.stopped"
"""Key in a request's scope for the result of the stop that it requested: status and document."""
REST_S = 0.02
"""Minimum time between the starts of two requests, s. Each request occupies the event loop for 10 ms or
more.
"""


class McpEndpoint:
    """The ASGI application for agents. `close` ends everything that it has begun."""

    def __init__(self) -> None:
        self._manager: StreamableHTTPSessionManager | None = None
        self._turn = asyncio.Lock()
        self._starts = Costly()
        self._departures = Departures()
        self._running: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            body = await _body(receive)
        except PayloadError as exc:
            await answer_to(exc)(scope, receive, send)
            return
        # otherwise the library would treat it as an internal error, and log where it occurred
        if body is None:
            return
        message = _decoded(body)
        with self._departures.watch(scope, message, body, receive) as received:
            await _stop(scope, message)
            async with self._turn:
                if self._manager is None:
                    manager = await asyncio.to_thread(_made, scope["app"])
                    entered = asyncio.Event()
                    self._running = asyncio.create_task(_run(manager, entered), name="MCP")
                    await entered.wait()
                    self._manager = manager
            await self._starts.start(REST_S)
            await self._manager.handle_request(scope, received, send)

    async def close(self) -> None:
        if self._running is not None:
            self._running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._running


async def _body(receive: Receive) -> bytes | None:
    """Read the whole body; None if the client disconnects before it has sent all of it.

    Raises:
        PayloadError: the body is too large.
    """
    body = bytearray()
    more = True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return None
        body += message.get("body", b"")
        if len(body) > MAX_BODY_BYTES:
            raise PayloadError(f"the body is larger than the limit of {MAX_BODY_BYTES} bytes for agents")
        more = message.get("more_body", False)
    return bytes(body)


async def _stop(scope: Scope, message: object) -> None:
    """If the request is a stop, stop the arm before the request waits for its turn. The result is stored in
    the scope, for the tool's answer.
    """
    match message:
        case {"method": "tools/call", "params": {"name": "stop", **asked}}:
            arguments = asked.get("arguments")
            robot = arguments.get("robot") if isinstance(arguments, dict) else ""
            with contextlib.suppress(NotFoundError):  # there is no such robot; the tool reports this too
                scope[STOPPED] = await OwnRest(scope, str(robot or "")).ask("POST", "/stop")


def _decoded(body: bytes) -> object:
    """Decode JSON; None if the body is not JSON, because the library then answers with a better error."""
    try:
        return json.loads(body)
    except (ValueError, RecursionError):
        return None


async def _run(manager: StreamableHTTPSessionManager, entered: asyncio.Event) -> None:
    """Run the session manager until cancelled, in one task, because the task that enters the library's task
    group must also leave it.
    """
    async with manager.run():
        entered.set()
        await asyncio.Event().wait()


def _made(app: FastAPI) -> StreamableHTTPSessionManager:
    from app.mcp.server import session_manager

    return session_manager(app)
