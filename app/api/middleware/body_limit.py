"""Rejects request bodies that are compressed or too large before they are read completely, with or without a
Content-Length. Also limits the total size of all bodies.

FastAPI's own `max_body_size` answers in plain text and bypasses the error handlers.
"""

from __future__ import annotations

from collections.abc import Awaitable

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cobot.errors import CobotError, MediaTypeError, PayloadError, UnavailableError
from cobot.strict import shown

IDENTITY = b"identity"


class BodyLimit:
    """ASGI middleware that limits the size of request bodies. GET requests pass directly, so that polling
    needs no additional coroutine.
    """

    def __init__(self, app: ASGIApp, all_bytes: int) -> None:
        self._app = app
        self._all_bytes = all_bytes
        self._held_bytes = 0  # size of the bodies of all current requests

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] != "http" or scope["method"] == "GET":  # the body of a GET is not read
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
            """Receive a part of the body and count it. It is called only by endpoints that read a body."""
            nonlocal received
            if coding not in (b"", IDENTITY):
                error: CobotError = MediaTypeError(
                    f"the header Content-Encoding is {shown(coding.decode('latin-1'))}, but compressed "
                    f"bodies are not supported: send the body uncompressed and without this header"
                )
                raise HTTPException(415) from error
            if announced <= limit_bytes:
                message = await receive()
                size = len(message.get("body", b""))
                received += size
                self._held_bytes += size
                if self._held_bytes > self._all_bytes:
                    raise HTTPException(503) from UnavailableError(
                        f"the bodies of all current requests together exceed {self._all_bytes} bytes: try "
                        f"again later"
                    )
                if received <= limit_bytes:
                    return message
            error = PayloadError(f"the body is larger than the limit of {limit_bytes} bytes")
            raise HTTPException(413) from error  # FastAPI passes on no other class

        try:
            await self._app(scope, receive_and_count, send)
        finally:
            self._held_bytes -= received
