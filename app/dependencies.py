"""What routers ask for.

Dependencies are `async`: FastAPI would run plain functions in threads, at several times the cost of an
answer. `Call` is none at all, because each one costs a tenth of what a state costs to serve.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Annotated, Any, cast

from fastapi import Depends, HTTPException, Request, Response
from fastapi.routing import APIRoute

from app.services import Services
from cobot.config import Endpoint
from cobot.errors import InputError, MediaTypeError
from cobot.strict import unknown_key, without_repetition


class Call:
    """A request to an endpoint."""

    def __init__(self, request: Request) -> None:
        self._request = request

    @property
    def services(self) -> Services:
        return cast(Services, self._request.app.state.services)

    @property
    def name(self) -> str:
        """As in api_endpoints.yaml: "POST /stop"."""
        return f"{self._request.method} {self._request.scope['route'].path}"

    @property
    def timeout_s(self) -> float:
        """The time that api_endpoints.yaml grants this endpoint."""
        return cast(dict[str, Endpoint], self._request.app.state.endpoints)[self.name].timeout_s

    @property
    def token(self) -> str | None:
        """Of the sequence on whose behalf the arm shall move, if any."""
        return self._request.headers.get("X-Motion-Token")


async def gone(request: Request) -> AsyncIterator[asyncio.Event]:
    """An event that is set when the client goes away, if the settings want to know."""
    event = asyncio.Event()

    async def watch() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        event.set()

    if not request.app.state.stop_on_disconnect:
        yield event
        return
    watcher = asyncio.create_task(watch())
    try:
        yield event
    finally:
        watcher.cancel()


class _StrictRequest(Request):
    async def json(self) -> Any:
        body = await self.body()
        try:
            return json.loads(body, object_pairs_hook=without_repetition)
        except (json.JSONDecodeError, UnicodeDecodeError):
            raise
        except ValueError as exc:
            raise HTTPException(422, f"the body: {exc}") from exc


class StrictRoute(APIRoute):
    """Refuses what JSON leaves open: an object with the same key twice."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handler = super().get_route_handler()

        async def strict(request: Request) -> Response:
            return await handler(_StrictRequest(request.scope, request.receive))

        return strict


def _require_type(request: Request, expected: str) -> None:
    found = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if found != expected:
        raise MediaTypeError(f"Content-Type must be {expected}, got {found or 'none'}")


async def json_body(request: Request) -> None:
    _require_type(request, "application/json")


async def form_body(request: Request) -> None:
    _require_type(request, "multipart/form-data")
    valid = [field.alias for field in request.scope["route"].dependant.body_params]
    for name in await request.form():
        if name not in valid:
            raise InputError(unknown_key(name, valid))


Gone = Annotated[asyncio.Event, Depends(gone)]
