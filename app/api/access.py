"""Who asks, and whether a page may ask at all: one ASGI middleware around everything, HTTP and WebSocket."""

from __future__ import annotations

from typing import cast

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from cobot.access.roles import ANONYMOUS, Identity, Role, acting

IDENTITY = "cobot.identity"


def identity_of(connection: HTTPConnection) -> Identity:
    """Who sends a request, or has opened a WebSocket."""
    return cast(Identity, connection.scope[IDENTITY])


class Access:
    """ASGI middleware: puts who asks into the scope, as `IDENTITY`, and into `cobot.access.roles.acting`."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "lifespan":
            client = scope.get("client")
            scope[IDENTITY] = identity = Identity(ANONYMOUS, Role.ADMIN, client[0] if client else "")
            acting.set(identity)
        await self._app(scope, receive, send)
