"""FastAPI dependencies that the routers use.

Dependencies are `async`, because FastAPI runs plain functions in threads, which takes several times as long
as the answer itself. `Call` is not a FastAPI dependency, because each dependency makes `GET /robot/state` 10
% slower.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable
from typing import Annotated, Any, TypeVar, cast, get_type_hints

from fastapi import Depends, Request
from fastapi.params import Form
from fastapi.responses import JSONResponse
from pydantic import BaseModel, RootModel
from starlette.requests import HTTPConnection

from app.api.endpoints import Endpoint
from app.api.schemas.jobs import MAX_BODY, job_answer
from app.robot_services import Services
from app.services.clients import CLIENT
from app.services.rights.claims import Caller
from app.services.rights.job import JobKind, JobRecord
from app.services.rights.job_book import unknown
from cobot import audit
from cobot.addresses import address
from cobot.errors import InputError, MediaTypeError, NotFoundError
from cobot.loose_lists import RequestModel
from cobot.strict import shown, unknown_key

Result = TypeVar("Result")
Answer = TypeVar("Answer")
STOPS = "cobot.stops"
BEGUN_S = "cobot.begun_s"
"""Key in the scope of a request for the time at which its header arrived, on the clock `cobot.clock.SYSTEM`.
The body may arrive later.
"""
LARGE_BYTES = 65536
JOB, JOB_ID = "cobot.job", "cobot.job_id"
"""Keys in a request's scope: the job that the request names, and the id of the job that it creates."""


def robots_of(connection: HTTPConnection) -> dict[str, Services]:
    """Return the services of each robot by name, the default robot first."""
    return cast(dict[str, Services], connection.app.state.robots)


def services_of(connection: HTTPConnection) -> Services:
    """Return the services of the robot whose name or job is in the path, or else those of the default robot.

    Raises:
        NotFoundError: there is no such robot (the error lists all names), or no such job.
    """
    path_params = connection.scope["path_params"]
    name, job = path_params.get("robot"), path_params.get("job")
    if job is not None:
        return _with_job(addressed(connection).values(), job)
    if name is None:
        return cast(Services, connection.app.state.services)
    return _named(connection, name)


def _named(connection: HTTPConnection, name: str) -> Services:
    robots = robots_of(connection)
    if name not in robots:
        raise NotFoundError(f"there is no robot {shown(name)}; valid names: {', '.join(robots)}")
    return robots[name]


def _with_job(robots: Iterable[Services], job: str) -> Services:
    for services in robots:
        if services.jobs.book.find(job) is not None:
            return services
    raise unknown(job)


def addressed(connection: HTTPConnection) -> dict[str, Services]:
    """Return the robot that the path names, or all robots if it names none.

    Raises:
        NotFoundError: there is no such robot; the error lists all names.
    """
    name = connection.path_params.get("robot")
    return robots_of(connection) if name is None else {name: _named(connection, name)}


class Call:
    """A request to an endpoint. Raises the same errors as `services_of`.

    Attributes:
        services: services of the robot that the request addresses.
    """

    def __init__(self, request: Request) -> None:
        self.request = request
        self.services = services_of(request)

    @property
    def name(self) -> str:
        """The endpoint's name, such as "POST /stop" or, with a robot's name, "POST /robots/{robot}/stop"."""
        return f"{self.request.method} {self.request.scope['route'].path}"

    @property
    def timeout_s(self) -> float:
        """Timeout of this endpoint, s."""
        return cast(dict[str, Endpoint], self.request.app.state.endpoints)[self.name].timeout_s

    @property
    def stops(self) -> int:
        """The value of `Ownership.stops` when this request arrived."""
        return cast(int, self.request.scope[STOPS])

    def caller(self, gone: asyncio.Event, kind: JobKind, about: str | BaseModel, *, wait: bool) -> Caller:
        """Return the caller of a motion.

        Args:
            gone: see `Gone`. A client that does not wait for the answer may disconnect.
            about: the request body, or a readable description of it.
        """
        name = self.name.replace("{robot}", self.request.path_params.get("robot", ""))
        scope = self.request.scope
        path = scope["path"]
        text, body = (about, None) if isinstance(about, str) else kept_body(about)
        job = self.services.ownership.new_job(kind, f"{path} {text}", scope.get(JOB_ID))
        job.path, job.body = path, body
        scope[JOB] = job
        leaving = gone if wait else asyncio.Event()
        token = CLIENT.get().sequence
        return Caller(name, token, self.stops, self.timeout_s, leaving, job, waits=wait)

    async def answer_end(
        self, caller: Caller, work: Coroutine[Any, Any, Result], answer_to: Callable[[Result], Answer]
    ) -> Answer | JSONResponse:
        """Do the work of a job and answer with its result. If the client does not wait, answer at once with
        the job.
        """
        if caller.waits:
            return answer_to(await work)
        assert caller.job is not None
        return self.answer_accepted(await self.services.jobs.begin(caller.job, work))

    def answer_accepted(self, record: JobRecord) -> JSONResponse:
        """Return the 202 answer to a request that does not wait."""
        audit.add_details(job=record.id)
        version = self.request.scope.get("root_path", "")
        robot = self.request.path_params.get("robot")
        below = address(version, robot) if robot else version
        return JSONResponse(
            job_answer(record).model_dump(mode="json"), 202, {"Location": f"{below}/jobs/{record.id}"}
        )


def kept_body(body: BaseModel) -> tuple[str, dict[str, Any] | None]:
    """Return a request body as text and as JSON data for a job. The data is None if the text is too long."""
    text = body.model_dump_json(exclude_unset=True, by_alias=True)
    return text, json.loads(text) if len(text) <= MAX_BODY else None


async def watch_for_departure(request: Request) -> AsyncIterator[asyncio.Event]:
    """Yield an event that is set when the client disconnects, if `web.stop_on_disconnect` is true."""
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


def body_check(function: Callable[..., Any]) -> Callable[[Request], Awaitable[None]] | None:
    """Return the check of an endpoint's request body, derived from the function's parameters; None if it
    takes no body.
    """
    for hint in get_type_hints(function, include_extras=True).values():
        if any(isinstance(each, Form) for each in getattr(hint, "__metadata__", ())):
            return form_body
        if isinstance(hint, type) and issubclass(hint, RequestModel | RootModel):
            return json_body
    return None


Gone = Annotated[asyncio.Event, Depends(watch_for_departure)]
