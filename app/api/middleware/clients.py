"""Stores the client of a request or WebSocket in a context variable that all tasks of the request inherit.

The client's name comes from `scope["cobot.identity"]`, which the middleware `access` sets if it is installed.
"""

from __future__ import annotations

from collections.abc import Awaitable
from functools import partial
from typing import Any

from starlette.types import ASGIApp, Receive, Scope, Send

from app.services.clients import CLIENT, RequestClient
from cobot.addresses import CONTROL_TOKEN

IDENTITY = "cobot.identity"
ANONYMOUS = "anonymous"
MOTION_TOKEN = "X-Motion-Token"
_CONTROL, _MOTION = CONTROL_TOKEN.lower().encode(), MOTION_TOKEN.lower().encode()


class Clients:
    """ASGI middleware. It ignores GET requests, because they change nothing, and adds no coroutine to
    requests.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "websocket":
            return self._connection(scope, receive, send)
        if scope["type"] == "http" and scope["method"] != "GET":
            CLIENT.set(client_of(scope))
        return self._app(scope, receive, send)

    async def _connection(self, scope: Scope, receive: Receive, send: Send) -> None:
        client = client_of(scope)
        CLIENT.set(client)
        try:
            await self._app(scope, receive, send)
        finally:
            for services in scope["app"].state.robots.values():
                services.control.drop_client(client)


def client_of(scope: Scope) -> RequestClient:
    """Return the client that has sent a request or opened a WebSocket."""
    identity: Any = scope.get(IDENTITY)
    peer = scope.get("client")
    leases: list[str] = []
    sequence = None
    for name, value in scope["headers"]:
        if name == _CONTROL:
            leases += (token.strip() for token in value.decode("latin-1").split(","))
        elif name == _MOTION:
            sequence = value.decode("latin-1")
    stored = identity is not None and identity.stored
    return RequestClient(
        ANONYMOUS if identity is None else str(identity.name),
        str(identity.address) if identity is not None else peer[0] if peer else "",
        frozenset(leases),
        sequence,
        is_valid=partial(scope["app"].state.tokens.has_token, identity.name) if stored else None,
    )
