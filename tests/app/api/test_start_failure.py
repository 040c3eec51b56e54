"""A service that cannot start, as its server sees it: the messages of ASGI's lifespan protocol."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
from collections.abc import AsyncIterator
from typing import Any

import pytest
from fastapi import FastAPI

from app.api.start_failure import StartFailure, saying_why
from cobot.errors import ConflictError


def told(error: Exception) -> str:
    """What the server is told of a start that fails with this error."""

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with saying_why(app):
            raise error
            yield

    app = FastAPI(lifespan=lifespan)
    app.add_middleware(StartFailure)
    sent: list[Any] = []

    async def receive() -> dict[str, str]:
        return {"type": "lifespan.startup"}

    async def send(message: Any) -> None:
        sent.append(message)

    with pytest.raises(type(error)):
        asyncio.run(app({"type": "lifespan", "app": app, "state": {}}, receive, send))
    (message,) = sent
    assert message["type"] == "lifespan.startup.failed"
    return str(message["message"])


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (ConflictError("another service serves it"), "another service serves it"),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE)), "no file descriptor is left: close connections"),
        (MemoryError(), "the service has no memory left"),
        (RuntimeError("can't start new thread"), "no further process or thread can be started"),
    ],
)
def test_what_people_can_see_to_is_a_sentence(error: Exception, sentence: str) -> None:
    assert told(error).startswith(sentence)
    assert "Traceback" not in told(error)


def test_a_mistake_of_ours_keeps_its_traceback() -> None:
    assert told(KeyError("what")).startswith("Traceback")
    assert told(RuntimeError("what")).startswith("Traceback")
