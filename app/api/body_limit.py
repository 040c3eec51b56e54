"""Refuses request bodies beyond a size, announced or not, before they are taken in.

FastAPI's own `max_body_size` does the same but answers in plain text, past every error handler.
"""

from __future__ import annotations

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cobot.errors import PayloadError


class BodyLimit:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] == "GET":  # of a GET nothing is taken in
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        form = headers.get(b"content-type", b"").lower().startswith(b"multipart/")
        web = scope["app"].state.web
        limit_bytes = web.max_body_bytes if form else web.max_json_bytes
        length = headers.get(b"content-length", b"0")
        announced = int(length) if length.isdigit() else 0
        received = 0

        async def counted() -> Message:
            """Asked for only by an endpoint that takes a body."""
            nonlocal received
            if announced <= limit_bytes:
                message = await receive()
                received += len(message.get("body", b""))
                if received <= limit_bytes:
                    return message
            error = PayloadError(f"the body is larger than the limit of {limit_bytes} bytes")
            raise HTTPException(413) from error  # FastAPI lets no other class through

        await self._app(scope, counted, send)
