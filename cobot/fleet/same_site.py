"""Keeps requests from pages of other sites away from the hub."""

from __future__ import annotations

from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send


class SameSite:
    """Rejects requests from pages of other sites. Otherwise such a page could stop the fleet when a user
    opens the page in a browser.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] in ("http", "websocket"):
            headers = dict(scope["headers"])
            host = headers.get(b"host", b"")
            own = (None, b"http://" + host, b"https://" + host)
            foreign = (
                headers.get(b"sec-fetch-site") not in (None, b"same-origin", b"none")
                or headers.get(b"origin") not in own
            )
            if foreign and scope.get("method") not in ("GET", "HEAD"):
                if scope["type"] == "websocket":
                    await send({"type": "websocket.close", "code": 1008})
                    return
                detail = "pages of other sites must not use the hub; open the hub's own page"
                await JSONResponse({"detail": detail, "code": "permission"}, 403)(scope, receive, send)
                return
        await self._app(scope, receive, send)
