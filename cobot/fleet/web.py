"""The web page and the REST API of a hub."""

from __future__ import annotations

import logging
import threading
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast
from urllib.parse import unquote

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, FastAPI, Header, HTTPException, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse
from pydantic import Field
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cobot.access.authentication import Authenticator
from cobot.access.claimed import claimed
from cobot.access.roles import Role, RoleName
from cobot.addresses import CLIENT_NAME
from cobot.errors import (
    AuthenticationError,
    BusyError,
    CobotError,
    InputError,
    NotFoundError,
    PermissionDenied,
)
from cobot.fleet.bundle import MAX_BUNDLE_BYTES
from cobot.fleet.hub import STOP, Hub
from cobot.fleet.messages import DEADLINE_S, FleetAction, Hash, Id, Name, StateWord, Target
from cobot.fleet.metrics import CONTENT_TYPE, metrics_of
from cobot.fleet.panel_link import PanelPerson
from cobot.fleet.recordings import FleetRecordingStore
from cobot.fleet.same_site import SameSite
from cobot.fleet.status import status_of
from cobot.strict import StrictModel, sentences

PAGE = Path(__file__).parent / "page"
FILES = ("fleet.js", "fleet.css", "words.json")
CSP = (
    "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'"
)
GONE = "gone"
BUNDLES = "/bundles"
MAX_BODY_BYTES = 2 * 2**20
"""Maximum size of a body that is not a bundle: a roll-out to 10,000 robots with the longest names."""
MAX_STOPS = 100
"""Maximum number of stops that are in progress at the same time. Further stops wait for one of them to
end.
"""
MAX_PICTURES = 8
"""Maximum number of pictures that are fetched at the same time. Further requests are rejected."""
log = logging.getLogger("cobot.fleet")
TARGETS = ("", "/zones/{zone}", "/cells/{cell}", "/cells/{cell}/robots/{robot}")
"""Targets of a command as URL paths: all robots, a zone, a cell, or a robot."""


class FleetStop(StrictModel):
    """The body of a stop. All fields may be left out.

    Attributes:
        id: id of the command. A second request with the same id executes nothing, and gets the first answer.
        deadline_s: time in which a cell must receive it, in seconds.
    """

    id: Id | None = None
    deadline_s: Annotated[float, Field(gt=0.0, le=30.0)] = DEADLINE_S


class FleetOrder(FleetStop):
    """The body of any command."""

    action: FleetAction


class RobotName(StrictModel):
    """A robot of the fleet. Its name may be omitted if it is the only robot of its cell."""

    cell: Name
    robot: Target = "*"


class WishedRollOut(StrictModel):
    """A request for a roll-out.

    Attributes:
        robots: the robots, in this order; the first one is a separate wave.
        wave: number of robots in each of the following waves.
        watch_s: how long the robots of a wave are watched before the next one, in seconds.
    """

    bundle: Hash
    robots: Annotated[list[RobotName], Field(min_length=1, max_length=10_000)]
    wave: Annotated[int, Field(ge=1, le=1000)] = 5
    watch_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 5.0


@dataclass(frozen=True, slots=True)
class Person:
    """The person who sends a request.

    Attributes:
        name: name of the token. Without tokens it is the name that the client gives itself, in quotes.
    """

    name: str
    role: RoleName


class People:
    """Finds the person who sends a request.

    Args:
        tokens: the valid tokens; None if every client that reaches the hub may use it.
    """

    def __init__(self, tokens: Authenticator | None) -> None:
        self._tokens = tokens

    async def find(
        self,
        authorization: Annotated[str, Header()] = "",
        name: Annotated[str, Header(alias=CLIENT_NAME)] = "",
    ) -> Person:
        """Find the person who sends a request.

        This runs in the event loop, because a stop must not wait for a thread that other requests use.

        Raises:
            AuthenticationError: the hub needs a token, and the token in the request is not valid.
        """
        if self._tokens is None:
            return Person(claimed(unquote(name)), "admin")
        found = self.holder(authorization)
        if found is None:
            raise AuthenticationError(
                "a valid token is needed: Authorization: Bearer TOKEN; `cobot token create --file` "
                "creates one"
            )
        return found

    def holder(self, authorization: str) -> Person | None:
        """The person who holds the token in a header; None if the token is not valid."""
        assert self._tokens is not None
        kind, _, token = authorization.partition(" ")
        holder = self._tokens.find(token.strip()) if kind.lower() == "bearer" else None
        return None if holder is None else Person(holder.name, cast(RoleName, holder.role.name.lower()))


class LimitedBody:
    """Rejects bodies that are too large before they are read into memory. This is needed because a body is
    read before the client's token is checked.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        limit = left = MAX_BUNDLE_BYTES if scope.get("path") == BUNDLES else MAX_BODY_BYTES

        async def receive_part() -> Message:
            nonlocal left
            message = await receive()
            left -= len(message.get("body", b""))
            if left < 0:
                raise HTTPException(413, f"the body has more than {limit} bytes")
            return message

        await self._app(scope, receive_part if scope["type"] == "http" else receive, send)


def make_app(hub: Hub, hosts: list[str], tokens: Authenticator | None = None, panel_port: int = 0) -> FastAPI:
    """Create the web application.

    Args:
        hosts: names and addresses that requests may use for the hub, without ports.
        tokens: the valid tokens; None if every client that reaches the hub may use it.
        panel_port: port of the cells' panels; 0 if the hub serves no cell panels.
    """
    app = FastAPI(title="cobot fleet", docs_url=None, redoc_url=None)
    app.add_middleware(LimitedBody)
    app.add_middleware(SameSite)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False)
    app.add_exception_handler(CobotError, _answer_to)
    app.add_exception_handler(RequestValidationError, _answer_to_invalid)
    people = People(tokens)
    person = Depends(people.find)
    _add_reading(app, hub, person, has_panels=bool(panel_port))
    _add_panels(app, hub, people, panel_port)
    stops = CapacityLimiter(MAX_STOPS)
    for target in TARGETS:
        _add_commands(app, hub, person, target, stops)
    _add_roll_outs(app, hub, person)
    _add_recordings(app, hub, person)
    _add_page(app)
    return app


def _add_reading(app: FastAPI, hub: Hub, person: Any, *, has_panels: bool) -> None:
    pictures = threading.Semaphore(MAX_PICTURES)

    @app.get("/health")
    def health() -> dict[str, Any]:
        cells = hub.cells()
        return {
            "status": "ok",
            "fleet": hub.fleet,
            "robots": len(cells),
            "alive": sum(each["alive"] for each in cells),
        }

    @app.get("/cells", dependencies=[person])
    def cells(state: StateWord | None = None, gone: bool | None = None) -> dict[str, Any]:
        found = [each for each in hub.cells() if state in (None, each["state"])]
        if gone is not None:
            found = [each for each in found if (each["state"] == GONE) == gone]
        return {"fleet": hub.fleet, "panels": has_panels, "robots": found}

    @app.get("/cells/{cell}", dependencies=[person])
    def cell_(cell: str) -> dict[str, Any]:
        return {"fleet": hub.fleet, "robots": hub.robots_of(cell)}

    @app.delete("/cells/{cell}")
    def forget(cell: str, who: Person = person) -> dict[str, Any]:
        _require_operator(who, "the removal of a cell")
        hub.forget(cell)
        log.warning("%s has removed the cell %s", who.name, cell)
        return {"removed": cell}

    @app.get("/cells/{cell}/events", dependencies=[person])
    def events(cell: str) -> dict[str, Any]:
        return {"events": hub.events(cell)}

    @app.get("/cells/{cell}/robots/{robot}/programs", dependencies=[person])
    def programs(cell: str, robot: str) -> dict[str, Any]:
        return {"programs": hub.programs(cell, robot)}

    @app.get("/cells/{cell}/robots/{robot}/picture", dependencies=[person])
    def picture(cell: str, robot: str) -> Response:
        if not pictures.acquire(blocking=False):
            raise BusyError(f"{MAX_PICTURES} pictures are being fetched; try again in a few seconds")
        try:
            content = hub.picture(cell, robot)
        finally:
            pictures.release()
        return Response(content, media_type="image/png", headers={"Cache-Control": "no-store"})

    @app.get("/metrics", dependencies=[person])
    def metrics() -> Response:
        return Response(metrics_of(hub), media_type=CONTENT_TYPE)


def _add_panels(app: FastAPI, hub: Hub, people: People, port: int) -> None:
    @app.post("/cells/{cell}/panel", dependencies=[Depends(people.find)])
    async def panel(
        request: Request, cell: str, authorization: Annotated[str, Header()] = ""
    ) -> dict[str, Any]:
        if hub.panels is None or not port:
            raise PermissionDenied(
                "a hub without certificates shows no panels of cells; start it with --certificates"
            )
        hub.robots_of(cell)

        def find() -> PanelPerson | None:
            found = people.holder(authorization)
            return None if found is None else PanelPerson(found.name, found.role)

        name = hub.panels.open(cell, find)
        host = request.url.hostname or "localhost"
        return {"url": f"https://{f'[{host}]' if ':' in host else host}:{port}/{name}/"}


def _add_commands(app: FastAPI, hub: Hub, person: Any, target: str, stops: CapacityLimiter) -> None:
    def send(request: Request, wish: FleetStop, action: FleetAction, who: Person) -> dict[str, Any]:
        robots = hub.command(
            action, who.name, who.role, **request.path_params, deadline_s=wish.deadline_s, command_id=wish.id
        )
        done = bool(robots) and all(each["code"] == "ok" for each in robots)
        return {"done": done, "robots": robots}

    @app.post(f"{target}/stop")
    async def stop(request: Request, wish: FleetStop | None = None, who: Person = person) -> dict[str, Any]:
        # Other requests share threads, and may use all of them for half a minute. Stops therefore use
        # separate threads.
        work = partial(send, request, wish or FleetStop(), STOP, who)
        answer = await to_thread.run_sync(work, limiter=stops)
        return {"at_rest": answer["done"], "robots": answer["robots"]}

    @app.post(f"{target}/commands")
    def command(request: Request, wish: FleetOrder, who: Person = person) -> dict[str, Any]:
        return send(request, wish, wish.action, who)


def _add_roll_outs(app: FastAPI, hub: Hub, person: Any) -> None:
    @app.post(BUNDLES)
    async def add(request: Request, who: Person = person) -> dict[str, Any]:
        _require_operator(who, "a bundle")
        name, bundle = hub.roll_outs.add(await request.body())
        log.info("%s has sent the bundle %s", who.name, bundle.title)
        return {"bundle": name, "title": bundle.title}

    @app.post("/roll-outs")
    def begin(wish: WishedRollOut, who: Person = person) -> dict[str, Any]:
        robots = [(each.cell, each.robot) for each in wish.robots]
        return hub.roll_out(wish.bundle, who.name, who.role, robots, wish.wave, wish.watch_s)

    @app.get("/roll-outs", dependencies=[person])
    def roll_outs() -> dict[str, Any]:
        return {"roll_outs": hub.roll_outs.all()}

    @app.get("/roll-outs/{roll_out}", dependencies=[person])
    def roll_out_(roll_out: str) -> dict[str, Any]:
        return hub.roll_outs.get(roll_out)

    @app.post("/roll-outs/{roll_out}/cancel")
    def cancel(roll_out: str, who: Person = person) -> dict[str, Any]:
        return hub.roll_outs.cancel(roll_out, who.role)


def _require_operator(who: Person, what: str) -> None:
    """Check that a person is at least an operator.

    Raises:
        PermissionDenied: the role of this person is too low.
    """
    if Role[who.role.upper()] < Role.OPERATOR:
        raise PermissionDenied(f"{who.name} has the role {who.role}; {what} needs the role operator")


def _add_recordings(app: FastAPI, hub: Hub, person: Any) -> None:
    def store() -> FleetRecordingStore:
        if hub.recordings is None:
            raise NotFoundError(
                "this hub fetches no recordings; start it with `cobot fleet serve --recordings FOLDER`"
            )
        return hub.recordings

    @app.get("/recordings", dependencies=[person])
    def recordings() -> dict[str, Any]:
        return {"recordings": [asdict(each) for each in store().all()]}

    @app.get("/recordings/{cell}/{robot}/{file}", dependencies=[person])
    def recording(cell: str, robot: str, file: str) -> Response:
        return FileResponse(store().path(cell, robot, file), media_type="application/octet-stream")


def _add_page(app: FastAPI) -> None:
    headers = {
        "Content-Security-Policy": CSP,
        "Cache-Control": "no-cache",
        "X-Content-Type-Options": "nosniff",
    }

    @app.get("/", include_in_schema=False)
    def page() -> Response:
        return FileResponse(PAGE / "index.html", headers=headers)

    @app.get("/page/{file}", include_in_schema=False)
    def part(file: str) -> Response:
        if file not in FILES:
            raise NotFoundError(f"there is no file {file!r}")
        return FileResponse(PAGE / file, headers=headers)


def _error(status: int, code: str, detail: str) -> JSONResponse:
    return JSONResponse({"detail": detail, "code": code}, status)


async def _answer_to(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, CobotError)
    return _error(status_of(exc), exc.code, str(exc))


async def _answer_to_invalid(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, RequestValidationError)
    return _error(422, InputError.code, sentences(exc.errors()))
