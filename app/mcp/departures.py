"""Detects agents that close the connection or cancel the request while the arm is moving for them.

With clients that use a protocol version from before 2026, the library behind /mcp/mcp detects neither. For an
answer that is one JSON document, it reads only the request body and so misses the end of the connection. Nor
can it match a cancellation to its request, because it has no sessions.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from starlette.types import Message, Receive, Scope

from app.api.middleware.clients import client_of

GONE = "cobot.gone"
"""Key in a request's scope for an event that is set when the client has left."""
CANCELLED = "notifications/cancelled"
Key = tuple[str, str, str]


class Departures:
    """Detects clients of one service that leave before their request is answered."""

    def __init__(self) -> None:
        self._under_way: dict[Key, set[asyncio.Event]] = {}

    @contextmanager
    def watch(self, scope: Scope, message: object, body: bytes, receive: Receive) -> Iterator[Receive]:
        """Detect that the client cancels this request or disconnects. `scope[GONE]` is then set, which ends
        the motion. Yields the `receive` function to pass to the application.

        Args:
            message: the decoded JSON body.
        """
        asked = message if isinstance(message, dict) else {}
        self._hear(scope, asked)
        gone = scope[GONE] = asyncio.Event()
        key = _key(scope, asked.get("id"))
        events = self._under_way.setdefault(key, set())
        events.add(gone)
        watching = asyncio.create_task(_watch(receive, gone))
        first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def receive_and_watch() -> Message:
            if first:
                return first.pop()
            await gone.wait()
            return {"type": "http.disconnect"}

        try:
            yield receive_and_watch
        finally:
            watching.cancel()
            events.discard(gone)
            if not events:
                self._under_way.pop(key, None)

    def _hear(self, scope: Scope, message: dict[str, Any]) -> None:
        about = message.get("params")
        if message.get("method") == CANCELLED and isinstance(about, dict):
            for gone in self._under_way.get(_key(scope, about.get("requestId")), ()):
                gone.set()


async def _watch(receive: Receive, gone: asyncio.Event) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
    gone.set()


def _key(scope: Scope, request_id: Any) -> Key:
    """Return the key of a request: its client, the client's computer and the request's number. These must be
    enough, because there is no session.
    """
    client = client_of(scope)
    return client.name, client.address, str(request_id)
