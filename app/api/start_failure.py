"""Reports a failed start in one sentence, without a traceback, if the user can correct the cause."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator, Awaitable

from fastapi import FastAPI
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cobot.errors import CobotError, exhausted


@contextlib.asynccontextmanager
async def saying_why(app: FastAPI) -> AsyncIterator[None]:
    """Store an expected error that is raised in the context, for `StartFailure`. Programming errors pass
    unchanged.
    """
    app.state.start_failure = None
    try:
        yield
    except (CobotError, OSError, MemoryError, RuntimeError) as exc:
        app.state.start_failure = exc if isinstance(exc, CobotError) else exhausted(exc)
        raise


class StartFailure:
    """ASGI middleware that makes the server log the error as one sentence. It adds no coroutine to
    requests.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] != "lifespan":
            return self._app(scope, receive, send)

        async def say(message: Message) -> None:
            reason = scope["app"].state.start_failure
            await send({**message, "message": str(reason)} if reason and "message" in message else message)

        return self._app(scope, receive, say)
