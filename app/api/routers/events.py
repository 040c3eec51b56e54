"""Events, sent as they happen: server-sent events and a WebSocket, on one path."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Annotated, cast

from fastapi import Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import JSONResponse
from pydantic import ConfigDict, Field, ValidationError
from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.api.dependencies import addressed
from app.api.errors import responses, status_of
from app.api.middleware.access import STILL_VALID
from app.api.route import EndpointRouter
from app.robot_services import Services
from app.services.events.ring import TYPES, Event, Events
from app.services.reports.listener import EventFilter, Listener
from cobot.access.authentication import LOOK_AGAIN_S
from cobot.access.roles import Role
from cobot.errors import CobotError, InputError, NotFoundError, UnavailableError
from cobot.strict import StrictModel, sentences, shown

PATH = "/events"
MAX_LISTENERS = 224
"""Maximum number of listeners from all addresses together. By default one address may have 256 connections
for all uses.
"""
RETRY_MS = 1000
"""Time after which a browser reconnects, ms."""
LAST_EVENT_ID = "Last-Event-ID"

router = EndpointRouter(tags=["events"])


class EventsQuery(StrictModel):
    """The events that a client subscribes to."""

    model_config = ConfigDict(strict=False)

    types: str | None = Field(
        None,
        max_length=1000,
        description=f"Types, separated by commas: {', '.join(TYPES)}. Default: all.",
    )
    robot: str | None = Field(
        None, max_length=64, description="Only events of this robot and of the service."
    )
    after: str | None = Field(
        None, description="`EPOCH-ID` of the last known event; 0: all kept events. Default: only new events."
    )
    state_hz: float | None = Field(
        None,
        ge=0.1,
        le=100.0,
        allow_inf_nan=False,
        description="Number of states per second. Default: no states.",
    )


@router.endpoint(
    f"GET {PATH}",
    Role.OBSERVER,
    timeout_s=1.5,
    response_class=Response,
    responses={
        200: {
            "description": "An endless stream of events.",
            "content": {"text/event-stream": {"schema": {"type": "string"}}},
        },
        **responses(422, 503),
    },
)
async def events(query: Annotated[EventsQuery, Query()], request: Request) -> Response:
    """Send numbered events, as server-sent events or over a WebSocket on the same path.

    A client that reconnects with the number of the last event that it knows (`Last-Event-ID`, or `after`)
    gets those that it has missed. A slow client loses events, gets an event of the type `lost` about it, and
    does not delay others. docs/events.md has the types and examples.
    """
    after = request.headers.get(LAST_EVENT_ID) or query.after
    query = query.model_copy(update={"after": after})
    return EventStream(_listener(request, query), request.scope.get(STILL_VALID))


@router.endpoint(f"WS {PATH}", Role.OBSERVER, timeout_s=1.5)
async def events_socket(socket: WebSocket) -> None:
    """See docs/events.md."""
    try:
        listener = _listener(socket, _query(socket))
    except CobotError as exc:
        answer = JSONResponse({"detail": str(exc), "code": exc.code}, status_of(exc))
        await socket.send_denial_response(answer)
        return
    with contextlib.closing(listener):
        await socket.accept()
        gone = asyncio.create_task(_watch_socket(socket, listener))
        try:
            with contextlib.suppress(WebSocketDisconnect):
                while found := await listener.next():
                    for event in found:
                        await socket.send_text(event.text)
        finally:
            gone.cancel()


class EventStream(Response):
    """Server-sent events (HTML standard), sent until the client disconnects or loses the permission."""

    media_type = "text/event-stream"

    def __init__(self, listener: Listener, still_valid: Callable[[], bool] | None) -> None:
        super().__init__(headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"})
        del self.headers["content-length"]
        self._listener = listener
        self._still_valid = still_valid

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        listener = self._listener
        start = {"type": "http.response.start", "status": 200, "headers": self.raw_headers}
        gone = asyncio.create_task(self._watch(receive))
        try:
            await send(start)
            await _send(send, b"retry: %d\n\n" % RETRY_MS)
            while found := await listener.next():
                await _send(send, "".join(sse(each, listener.epoch) for each in found).encode())
            await send({"type": "http.response.body", "body": b"", "more_body": False})
        finally:
            gone.cancel()
            listener.close()

    async def _watch(self, receive: Receive) -> None:
        """Close the listener when the client has disconnected or its token is revoked."""
        left = asyncio.create_task(_await_disconnect(receive))
        try:
            while self._still_valid is None or self._still_valid():
                done, _ = await asyncio.wait({left}, timeout=LOOK_AGAIN_S if self._still_valid else None)
                if done:
                    break
        finally:
            left.cancel()
            self._listener.close()


async def _await_disconnect(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _watch_socket(socket: WebSocket, listener: Listener) -> None:
    """Wait for the end of the connection. Messages from the client are ignored."""
    while (await socket.receive())["type"] == "websocket.receive":
        await asyncio.sleep(0)
    listener.close()


async def _send(send: Send, body: bytes) -> None:
    await send({"type": "http.response.body", "body": body, "more_body": True})


def _query(socket: WebSocket) -> EventsQuery:
    try:
        return EventsQuery.model_validate(dict(socket.query_params))
    except ValidationError as exc:
        raise InputError(sentences(exc.errors())) from exc


def _listener(connection: HTTPConnection, query: EventsQuery) -> Listener:
    """Make a listener. Raises InputError or NotFoundError if a type, robot or event is unknown, and
    UnavailableError if there are too many listeners or the service is shutting down.
    """
    events = cast(Events, connection.app.state.events)
    if events.closed:
        raise UnavailableError("the service is shutting down")
    if len(events.on_news) >= MAX_LISTENERS:
        raise UnavailableError(f"{MAX_LISTENERS} clients already listen to events, which is the maximum")
    robots = _robots(connection, query.robot)
    states = [each.states for each in robots.values()] if query.state_hz is not None else []
    wanted = EventFilter(_types(query.types), frozenset(robots))
    return Listener(events, wanted, query.after, states, query.state_hz or 1.0)


def _robots(connection: HTTPConnection, name: str | None) -> dict[str, Services]:
    robots = addressed(connection)
    if name is None:
        return robots
    if name not in robots:
        raise NotFoundError(
            f"robot: {shown(name)} is not a robot of this service; valid names: {', '.join(robots)}"
        )
    return {name: robots[name]}


def _types(given: str | None) -> frozenset[str] | None:
    if given is None:
        return None
    types = [each.strip() for each in given.split(",")]
    for each in types:
        if each not in TYPES:
            raise InputError(f"types: {shown(each)} is not an event type; valid types: {', '.join(TYPES)}")
    return frozenset(types)


def sse(event: Event, epoch: str) -> str:
    """Return an event as a block of text/event-stream. A keep-alive event has no id."""
    place = "" if event.number is None else f"id: {epoch}-{event.number}\n"
    if event.type == "alive":
        return f"{place}\n"
    return f"{place}event: {event.type}\ndata: {event.text}\n\n"
