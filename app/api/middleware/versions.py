"""The API version: each path also exists below /v1 and leads to the same route.

There is no second set of routes. The middleware declares /v1 as the `root_path` of a request (ASGI's name for
the place below which an application is mounted), and Starlette matches the rest of the path.
"""

from __future__ import annotations

from collections.abc import Awaitable

from starlette.types import ASGIApp, Receive, Scope, Send

from cobot.addresses import VERSION

BELOW = f"{VERSION}/"


class Versions:
    """ASGI middleware. It adds no coroutine to requests."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] != "lifespan" and not scope.get("root_path"):
            path = scope["path"]
            if path.startswith(BELOW) or path == VERSION:
                scope["root_path"] = VERSION
        return self._app(scope, receive, send)


def plain_path(scope: Scope) -> str:
    """Return the path of a request without the API version."""
    path: str = scope["path"]
    return path.removeprefix(scope.get("root_path", ""))
