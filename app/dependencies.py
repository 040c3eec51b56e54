"""What routers ask for: short names for what each request brings along."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated, cast

from fastapi import Depends, Header, Request

from app.services import Services
from cobot.config import Endpoint
from cobot.errors import MediaTypeError


def services(request: Request) -> Services:
    return cast(Services, request.app.state.services)


def endpoint_name(request: Request) -> str:
    """As in api_endpoints.yaml: "POST /stop"."""
    return f"{request.method} {request.scope['route'].path}"


def timeout_s(request: Request) -> float:
    """The time that api_endpoints.yaml grants this endpoint."""
    endpoints = cast(dict[str, Endpoint], request.app.state.endpoints)
    return endpoints[endpoint_name(request)].timeout_s


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


def _require_type(request: Request, expected: str) -> None:
    found = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if found != expected:
        raise MediaTypeError(f"Content-Type must be {expected}, got {found or 'none'}")


def json_body(request: Request) -> None:
    _require_type(request, "application/json")


def form_body(request: Request) -> None:
    _require_type(request, "multipart/form-data")


ServicesDep = Annotated[Services, Depends(services)]
Timeout = Annotated[float, Depends(timeout_s)]
Name = Annotated[str, Depends(endpoint_name)]
Gone = Annotated[asyncio.Event, Depends(gone)]
Token = Annotated[str | None, Header(alias="X-Motion-Token", include_in_schema=False)]
