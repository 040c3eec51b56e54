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
from pydantic import BaseModel, ValidationError

from app.services import Services
from app.services.motion import Caller
from cobot.config import Endpoint
from cobot.errors import InputError, MediaTypeError
from cobot.strict import sentences, unknown_key, without_repetition

STOPS = "cobot.stops"
IN_THREAD_BYTES = 65536


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
    def stops(self) -> int:
        """How many stops had been requested when this request came in."""
        return cast(int, self._request.scope[STOPS])

    def caller(self, gone: asyncio.Event) -> Caller:
        """Who asks, for a motion."""
        token = self._request.headers.get("X-Motion-Token")
        return Caller(self.name, token, self.stops, self.timeout_s, gone)


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


class _CobotRequest(Request):
    async def json(self) -> Any:
        body = await self.body()
        (param,) = self.scope["route"].dependant.body_params
        model: type[BaseModel] = param.field_info.annotation
        if len(body) <= IN_THREAD_BYTES:
            return _validated(body, model)
        return await asyncio.to_thread(_validated, body, model)


def _validated(body: bytes, model: type[BaseModel]) -> BaseModel:
    """The body as an instance, which FastAPI then takes as it is."""
    try:
        return model.model_validate(json.loads(body, object_pairs_hook=without_repetition))
    except ValidationError as exc:
        raise HTTPException(422, sentences(exc.errors())) from exc
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise
    except ValueError as exc:
        raise HTTPException(422, f"the body: {exc}") from exc
    except RecursionError as exc:
        raise HTTPException(422, "the body: nested too deeply") from exc


class CobotRoute(APIRoute):
    """Notes the count of stops before the body is read, refuses an object with the same key twice, and
    takes large bodies apart in a thread: nobody else shall wait for them.
    """

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handler = super().get_route_handler()

        async def handle(request: Request) -> Response:
            request.scope[STOPS] = request.app.state.services.link.stops
            return await handler(_CobotRequest(request.scope, request.receive))

        return handle


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
