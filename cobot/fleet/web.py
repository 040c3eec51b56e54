"""The web page and the REST API of a hub."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any
from urllib.parse import unquote

from fastapi import FastAPI, Header, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse
from pydantic import Field
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

from cobot.addresses import CLIENT_NAME
from cobot.errors import CobotError, InputError, NotFoundError
from cobot.fleet.hub import DEADLINE_S, Hub
from cobot.fleet.messages import Id, StateWord
from cobot.strict import StrictModel, sentences

PAGE = Path(__file__).parent / "page"
FILES = ("fleet.js", "fleet.css", "words.json")
STATUS = {NotFoundError: 404, InputError: 422}
CSP = "default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
GONE = "gone"
ClientName = Annotated[str, Header(alias=CLIENT_NAME)]


class FleetStop(StrictModel):
    """The body of a stop. All fields may be left out.

    Attributes:
        id: of the command. A second request with it stops nothing again and has the first answer.
        deadline_s: time in which a cell must receive it, in seconds.
    """

    id: Id | None = None
    deadline_s: Annotated[float, Field(gt=0.0, le=30.0)] = DEADLINE_S


class SameSite:
    """Rejects requests that a page of another site makes: it could stop the fleet in a visitor's browser."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            headers = dict(scope["headers"])
            host = headers.get(b"host", b"")
            own = (None, b"http://" + host, b"https://" + host)
            foreign = (
                headers.get(b"sec-fetch-site") not in (None, b"same-origin", b"none")
                or headers.get(b"origin") not in own
            )
            if foreign and scope["method"] not in ("GET", "HEAD"):
                answer = _error(403, "permission", "a page of another site may not use the hub")
                await answer(scope, receive, send)
                return
        await self._app(scope, receive, send)


def make_app(hub: Hub, hosts: list[str]) -> FastAPI:
    """The application.

    Args:
        hosts: names and addresses by which it may be asked, without ports.
    """
    app = FastAPI(title="cobot fleet", docs_url=None, redoc_url=None)
    app.add_middleware(SameSite)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=hosts, www_redirect=False)
    app.add_exception_handler(CobotError, _answer_to)
    app.add_exception_handler(RequestValidationError, _answer_to_invalid)
    _add_reading(app, hub)
    _add_stops(app, hub)
    _add_page(app)
    return app


def _add_reading(app: FastAPI, hub: Hub) -> None:
    @app.get("/health")
    def health() -> dict[str, Any]:
        cells = hub.cells()
        return {
            "status": "ok",
            "fleet": hub.fleet,
            "robots": len(cells),
            "alive": sum(each["alive"] for each in cells),
        }

    @app.get("/cells")
    def cells(state: StateWord | None = None, gone: bool | None = None) -> dict[str, Any]:
        found = [each for each in hub.cells() if state in (None, each["state"])]
        if gone is not None:
            found = [each for each in found if (each["state"] == GONE) == gone]
        return {"fleet": hub.fleet, "robots": found}

    @app.get("/cells/{cell}")
    def cell_(cell: str) -> dict[str, Any]:
        return {"fleet": hub.fleet, "robots": hub.robots_of(cell)}

    @app.get("/cells/{cell}/events")
    def events(cell: str) -> dict[str, Any]:
        return {"events": hub.events(cell)}


def _add_stops(app: FastAPI, hub: Hub) -> None:
    def stop(request: FleetStop | None, who: str, cell: str = "*", robot: str = "*") -> dict[str, Any]:
        wish = request or FleetStop()
        robots = hub.stop(who, cell, robot, deadline_s=wish.deadline_s, command_id=wish.id)
        return {"at_rest": bool(robots) and all(each["code"] == "ok" for each in robots), "robots": robots}

    @app.post("/stop")
    def stop_all(request: FleetStop | None = None, name: ClientName = "") -> dict[str, Any]:
        return stop(request, _person(name))

    @app.post("/cells/{cell}/stop")
    def stop_cell(cell: str, request: FleetStop | None = None, name: ClientName = "") -> dict[str, Any]:
        return stop(request, _person(name), cell)

    @app.post("/cells/{cell}/robots/{robot}/stop")
    def stop_robot(
        cell: str, robot: str, request: FleetStop | None = None, name: ClientName = ""
    ) -> dict[str, Any]:
        return stop(request, _person(name), cell, robot)


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


def _person(name: str) -> str:
    """The name that a client without a token gives itself, in quotes, because it proves nothing."""
    shown = "".join(each for each in unquote(name) if each.isprintable() and each != '"')[:40].strip()
    return f'"{shown}"' if shown else "anonymous"


def _error(status: int, code: str, detail: str) -> JSONResponse:
    return JSONResponse({"detail": detail, "code": code}, status)


async def _answer_to(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, CobotError)
    status = next((status for kind, status in STATUS.items() if isinstance(exc, kind)), 503)
    return _error(status, exc.code, str(exc))


async def _answer_to_invalid(request: Request, exc: Exception) -> Response:
    assert isinstance(exc, RequestValidationError)
    return _error(422, InputError.code, sentences(exc.errors()))
