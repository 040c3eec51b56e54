"""Refuses request bodies that are compressed, or beyond a size, announced or not, before they are taken in;
and limits the size of all of them together.

FastAPI's own `max_body_size` does the same but answers in plain text, past every error handler.
"""

from __future__ import annotations

from collections.abc import Awaitable

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cobot.errors import CobotError, MediaTypeError, PayloadError, UnavailableError
from cobot.strict import shown

IDENTITY = b"identity"


class BodyLimit:
    """ASGI middleware. What is polled passes without a coroutine of its own."""

    def __init__(self, app: ASGIApp, all_bytes: int) -> None:
        self._app = app
        self._all_bytes = all_bytes
        self._held_bytes = 0  # of all requests that are being answered

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] != "http" or scope["method"] == "GET":  # of a GET nothing is taken in
            return self._app(scope, receive, send)
        return self._limit(scope, receive, send)

    async def _limit(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = dict(scope["headers"])
        form = headers.get(b"content-type", b"").lower().startswith(b"multipart/")
        web = scope["app"].state.web
        limit_bytes = web.max_body_bytes if form else web.max_json_bytes
        length = headers.get(b"content-length", b"0")
        announced = int(length) if length.isdigit() else 0
        coding = headers.get(b"content-encoding", IDENTITY).strip().lower()
        received = 0

        async def receive_and_count() -> Message:
            """Asked for only by an endpoint that takes a body."""
            nonlocal received
            if coding not in (b"", IDENTITY):
                error: CobotError = MediaTypeError(
                    f"the header Content-Encoding says {shown(coding.decode('latin-1'))}: bodies are read as "
                    "they are, so send the body uncompressed and without this header"
                )
                raise HTTPException(415) from error
            if announced <= limit_bytes:
                message = await receive()
                size = len(message.get("body", b""))
                received += size
                self._held_bytes += size
                if self._held_bytes > self._all_bytes:
                    raise HTTPException(503) from UnavailableError(
                        f"the bodies of all requests have more than {self._all_bytes} bytes: try again later"
                    )
                if received <= limit_bytes:
                    return message
            error = PayloadError(f"the body is larger than the limit of {limit_bytes} bytes")
            raise HTTPException(413) from error  # FastAPI lets no other class through

        try:
            await self._app(scope, receive_and_count, send)
        finally:
            self._held_bytes -= received
