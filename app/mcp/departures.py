"""Detects agents that leave while the arm is moving for them, by closing the connection or cancelling the
request.

With clients that use a protocol before 2026, the library behind /mcp/mcp detects neither. If the answer is
one JSON document, the library reads only the request body, so it misses the end of the connection. It also
cannot match a cancellation to its request, because requests are independent of each other.
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
    """The clients of one service that leave before their request is answered."""

    def __init__(self) -> None:
        self._under_way: dict[Key, set[asyncio.Event]] = {}

    @contextmanager
    def watch(self, scope: Scope, message: object, body: bytes, receive: Receive) -> Iterator[Receive]:
        """Detect that the client cancels this request or disconnects. `scope[GONE]` is then set, which ends
        the motion. Yields the `receive` to pass to the application.

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
    """Return the key of a request: its client, the client's computer and the number of the request. This is
    needed because there are no sessions.
    """
    client = client_of(scope)
    return client.name, client.address, str(request_id)
