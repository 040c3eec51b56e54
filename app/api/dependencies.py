"""What routers ask for.

Dependencies are `async`: FastAPI would run plain functions in threads, at several times the cost of an
answer. `Call` is none at all, because each one costs a tenth of what a state costs to serve.

Long, for it is the list of them.
"""

from __future__ import annotations

import asyncio
import gc
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Coroutine, Iterator
from inspect import iscoroutinefunction
from typing import Annotated, Any, TypeVar, cast

from fastapi import Depends, HTTPException, Request, Response
from fastapi.routing import APIRoute, serialize_response
from pydantic import BaseModel, ValidationError
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.clients import MOTION_TOKEN
from app.api.errors import status_of
from app.api.json_text import decoded
from app.robot_services import Services
from app.services.jobs.job import JobKind
from app.services.motion.ownership import Caller
from cobot.config import Endpoint
from cobot.errors import CobotError, InputError, MediaTypeError, NotFoundError
from cobot.motions.bodies import MOTION_TAGS
from cobot.strict import sentences, shown, unknown_key

STOPS = "cobot.stops"
BEGUN_S = "cobot.begun_s"
"""When the head of a request came in, of the clock of `cobot.clock.SYSTEM`: its body may take some time."""
LARGE_BYTES = 65536
PIECE_BYTES, RETURNS = 1024, 128
"""See `pieces`: a piece takes some milliseconds at the most."""
Result = TypeVar("Result")


def robots_of(connection: HTTPConnection) -> dict[str, Services]:
    """The services of each robot by its name, those of the default robot first."""
    return cast(dict[str, Services], connection.app.state.robots)


def services_of(connection: HTTPConnection) -> Services:
    """Those of the robot that the path names, of the default one if it names none.

    Raises:
        NotFoundError: there is no such robot; lists the names.
    """
    name = connection.scope["path_params"].get("robot")
    if name is None:
        return cast(Services, connection.app.state.services)
    robots = robots_of(connection)
    if name not in robots:
        raise NotFoundError(f"there is no robot {shown(name)}; valid are: {', '.join(robots)}")
    return robots[name]


def addressed(connection: HTTPConnection) -> dict[str, Services]:
    """The one robot that the path names, or all if it names none.

    Raises:
        NotFoundError: see `services_of`.
    """
    name = connection.path_params.get("robot")
    return robots_of(connection) if name is None else {name: services_of(connection)}


class Call:
    """A request to an endpoint; raises as `services_of` does.

    Attributes:
        services: of the robot that it is about.
    """

    def __init__(self, request: Request) -> None:
        self.request = request
        self.services = services_of(request)

    @property
    def name(self) -> str:
        """As in api_endpoints.yaml: "POST /stop"; for a robot by name "POST /robots/{robot}/stop"."""
        return f"{self.request.method} {self.request.scope['route'].path}"

    @property
    def timeout_s(self) -> float:
        """The time that api_endpoints.yaml grants this endpoint."""
        return cast(dict[str, Endpoint], self.request.app.state.endpoints)[self.name].timeout_s

    @property
    def stops(self) -> int:
        """`Ownership.stops` when this request came in."""
        return cast(int, self.request.scope[STOPS])

    @property
    def token(self) -> str | None:
        """Of the sequence on whose behalf the arm shall move, if any."""
        return self.request.headers.get(MOTION_TOKEN)

    def caller(self, gone: asyncio.Event, kind: JobKind, about: str, *, wait: bool) -> Caller:
        """Who asks, for a motion.

        Args:
            gone: see `Gone`; who does not wait may go.
            about: what is asked for, for people.
        """
        name = self.name.replace("{robot}", self.request.path_params.get("robot", ""))
        job = self.services.ownership.new_job(kind, f"{self.request.scope['path']} {about}")
        leaving = gone if wait else asyncio.Event()
        return Caller(name, self.token, self.stops, self.timeout_s, leaving, job, waits=wait)


async def gone(request: Request) -> AsyncIterator[asyncio.Event]:
    """An event that is set when the client goes away, if the settings want to know."""
    event = asyncio.Event()

    async def watch() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        event.set()

    if not request.app.state.web.stop_on_disconnect:
        yield event
        return
    watcher = asyncio.create_task(watch())
    try:
        yield event
    finally:
        watcher.cancel()


def pieces(chunk: bytes) -> Iterator[bytes]:
    """What the parser of forms gets at once: of a chunk in which much could be the beginning of a boundary,
    which it takes apart a hundred times as slowly, little.
    """
    size = PIECE_BYTES if chunk.count(b"\r") > RETURNS else max(len(chunk), 1)
    for start in range(0, len(chunk), size):
        yield chunk[start : start + size]


class _CobotRequest(Request):
    async def stream(self) -> AsyncGenerator[bytes]:
        """The body; of a form in pieces, between which others have the event loop."""
        form = self.headers.get("content-type", "").lower().startswith("multipart/")
        async for chunk in super().stream():
            if not form:
                yield chunk
                continue
            for piece in pieces(chunk):
                yield piece
                await asyncio.sleep(0)

    async def json(self) -> Any:
        body = await self.body()
        (param,) = self.scope["route"].dependant.body_params
        model: type[BaseModel] = param.field_info.annotation
        try:
            if len(body) <= LARGE_BYTES:
                return _validated(body, model)
            # To take a large one apart may hold the interpreter for a tenth of a second. That must not add
            # up, nor cost the service its heartbeat while somebody's motion depends on it.
            call = Call(self)
            async with self.app.state.large_body:
                call.services.ownership.require_free(call.token)
                return await asyncio.to_thread(without_collection, _validated, body, model)
        except CobotError as exc:
            raise HTTPException(status_of(exc)) from exc  # FastAPI lets no other class through


def _validated(body: bytes, model: type[BaseModel]) -> BaseModel:
    """The body as an instance, which FastAPI then takes as it is.

    Raises:
        InputError: naming what is wrong and where.
    """
    content = decoded(body, "the body")
    if not isinstance(content, dict):
        held = ": it is JSON inside a JSON string, send the object itself" if isinstance(content, str) else ""
        raise InputError(f"the body must be an object, got {shown(content)}{held}")
    try:
        return model.model_validate(content)
    except ValidationError as exc:
        raise InputError(sentences(exc.errors(), ignored=MOTION_TAGS)) from exc


def without_collection(function: Callable[..., Result], *arguments: Any) -> Result:
    """Call it without garbage collection, which would walk through all that it makes, again and again."""
    gc.disable()
    try:
        return function(*arguments)
    finally:
        gc.enable()


class CobotRoute(APIRoute):
    """Of a request with a body: notes the count of stops before it came in, takes it apart strictly, and lets
    nobody else wait for a large one. Of a state, which is polled: answers without FastAPI's looking for what
    the endpoint might depend on, and might want to be told when the answer is given.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if self.methods == {"GET"} and self._takes_request_alone():
            self.app = _answering(self._state_handler())

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        handler = super().get_route_handler()
        if self.methods == {"GET"}:
            return handler

        async def handle(request: Request) -> Response:
            ownership = services_of(request).ownership
            request.scope[STOPS] = ownership.stops_before(request.scope.get(BEGUN_S))
            return await handler(_CobotRequest(request.scope, request.receive))

        return handle

    def _takes_request_alone(self) -> bool:
        """Whether the endpoint takes nothing but the request, and answers with a model as JSON."""
        asked = self.dependant
        return (
            self.response_field is not None
            and iscoroutinefunction(self.endpoint)
            and asked.request_param_name is not None
            and not (asked.dependencies or asked.path_params or asked.query_params or asked.header_params)
            and not (asked.cookie_params or asked.body_params or self.dependencies)
            and not (asked.response_param_name or asked.background_tasks_param_name)
        )

    def _state_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """As FastAPI answers: what the endpoint returns is checked against its model."""
        endpoint, name = self.endpoint, str(self.dependant.request_param_name)
        field, status = self.response_field, self.status_code or 200

        async def handle(request: Request) -> Response:
            returned = await endpoint(**{name: request})
            if isinstance(returned, Response):
                return returned
            content = await serialize_response(field=field, response_content=returned, dump_json=True)
            return Response(content, status, media_type="application/json")

        return handle


def _answering(handler: Callable[[Request], Coroutine[Any, Any, Response]]) -> ASGIApp:
    """The application of a route; what its handler raises the middleware of the whole one answers."""

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        response = await handler(Request(scope, receive, send))
        await response(scope, receive, send)

    return answer


def _require_type(request: Request, expected: str, way: str) -> None:
    found = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if found != expected:
        raise MediaTypeError(f"Content-Type must be {expected}, got {found or 'none'}: {way}")


async def json_body(request: Request) -> None:
    _require_type(request, "application/json", "send this header (curl -H 'Content-Type: application/json')")


async def form_body(request: Request) -> None:
    _require_type(request, "multipart/form-data", "send the file as a field of a form (curl -F file=@FILE)")
    valid = [field.alias for field in request.scope["route"].dependant.body_params]
    for name in await request.form():
        if name not in valid:
            raise InputError(unknown_key(name, valid))


Gone = Annotated[asyncio.Event, Depends(gone)]
