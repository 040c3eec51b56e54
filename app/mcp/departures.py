"""Who leaves while the arm moves for it: its connection is closed, or it says that it cancels its request.

The library behind /mcp/mcp notices neither with clients before protocol 2026: it asks a request that is
answered by one JSON document for its body alone, and, as requests are independent of each other, takes a
cancellation for one of another connection's.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from starlette.types import Message, Receive, Scope

from app.api.clients import client_of

GONE = "cobot.gone"
"""Of a request's scope: set when its client has gone."""
DEPARTURES = "cobot.departures"
CANCELLED = "notifications/cancelled"
MAX_BYTES = 4096
"""Of a cancellation: larger ones are not looked into, for that takes the event loop some time."""
Key = tuple[str, str, str]


class Departures:
    """Of the clients of one service."""

    def __init__(self) -> None:
        self._under_way: dict[Key, set[asyncio.Event]] = {}

    @contextmanager
    def watched(self, scope: Scope, body: bytes, receive: Receive) -> Iterator[Receive]:
        """While a request is served: what it receives after its body, which ends what it has begun."""
        self._hear(scope, body)
        gone = scope[GONE] = asyncio.Event()
        scope[DEPARTURES] = self
        watching = asyncio.create_task(_watch(receive, gone))
        first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

        async def received() -> Message:
            if first:
                return first.pop()
            await gone.wait()
            return {"type": "http.disconnect"}

        try:
            yield received
        finally:
            watching.cancel()

    @contextmanager
    def under_way(self, scope: Scope, request_id: Any) -> Iterator[asyncio.Event]:
        """While the arm moves for a request: the event that is set once its client has gone."""
        gone: asyncio.Event = scope[GONE]
        key = _key(scope, request_id)
        events = self._under_way.setdefault(key, set())
        events.add(gone)
        try:
            yield gone
        finally:
            events.discard(gone)
            if not events:
                self._under_way.pop(key, None)

    def _hear(self, scope: Scope, body: bytes) -> None:
        if len(body) > MAX_BYTES or CANCELLED.encode() not in body:
            return
        try:
            message = json.loads(body)
        except ValueError:
            return  # the library says what is wrong with it
        if not isinstance(message, dict) or message.get("method") != CANCELLED:
            return
        about = message.get("params")
        if isinstance(about, dict):
            for gone in self._under_way.get(_key(scope, about.get("requestId")), ()):
                gone.set()


async def _watch(receive: Receive, gone: asyncio.Event) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
    gone.set()


def _key(scope: Scope, request_id: Any) -> Key:
    """Requests have no session: one is known by who asks, from which computer, and its number."""
    client = client_of(scope)
    return client.name, client.address, str(request_id)
