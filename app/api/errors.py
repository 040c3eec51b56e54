"""Maps all errors to HTTP answers, which are always JSON with a `detail` and a `code`.

Only a request that is not valid HTTP is answered by the web server itself, with the status 400 and in plain
text.
"""

from __future__ import annotations

import difflib
import logging
import re
from collections.abc import Iterable, Mapping
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.routing import Match, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.middleware.versions import BELOW
from app.api.schemas.explain import Details, Explain, explain_of
from cobot import audit, errors
from cobot.addresses import MANUAL, VERSION
from cobot.errors import CobotError, exhausted
from cobot.logs import log_context
from cobot.strict import sentence, shown

log = logging.getLogger("cobot.service")
MAX_GUESSED = 100
"""Maximum length of an unknown path, in characters. For longer ones no similar path is suggested."""

STATUS: dict[type[CobotError], int] = {
    CobotError: 500,
    errors.InputError: 422,
    errors.NotFoundError: 404,
    errors.HeaderError: 400,
    errors.PlanningError: 422,
    errors.ExecutionError: 409,
    errors.ConflictError: 409,
    errors.ChangedError: 412,
    errors.NotSupportedError: 501,
    errors.DeviceError: 502,
    errors.DeviceTimeout: 504,
    errors.PayloadError: 413,
    errors.MediaTypeError: 415,
    errors.AuthenticationError: 401,
    errors.PermissionDenied: 403,
    errors.MisdirectedError: 421,
    errors.UnavailableError: 503,
    errors.SharedMemoryError: 503,
    errors.ConfigError: 503,
}
"""HTTP status by error class. An error has the status of its most specific class."""


HEADERS = {
    errors.AuthenticationError: {"WWW-Authenticate": "Bearer"},
    errors.MediaTypeError: {"Accept-Encoding": "identity"},  # RFC 9110, 15.5.16
}


OF_HTTP = ("method_not_allowed", "http", "timeout", "interrupted")
"""Codes without an error class: errors of HTTP itself, and jobs that ended because the service ended."""
ErrorCode = Annotated[str, Field(json_schema_extra={"enum": sorted({*errors.BY_CODE, *OF_HTTP})})]
"""An error code. The schema lists all codes. Clients must also accept unknown codes, because a newer service
may send them.
"""
PROBLEM = "application/problem+json"
ERRORS_PAGE = f"{MANUAL}/conventions.html#errors"
"""Page and anchor of the manual about errors."""


class ErrorAnswer(BaseModel):
    """The body of every answer with a status other than 200."""

    detail: str = Field(description="What is wrong, where, the value and the limit.")
    code: ErrorCode = Field(description="A stable word for programs.")
    details: Details = None


class RefusedAnswer(ErrorAnswer):
    """The answer to an invalid request, or to a motion that cannot be planned, with the reason."""

    explain: Explain | None = Field(
        None, description="If a motion cannot be planned: the reason, as numbers."
    )


DESCRIPTIONS = {
    401: "The request has no token, or the token is not valid.",
    403: "The token's role does not permit this; the detail names the role that does.",
    404: "Unknown robot, name or id: see the detail.",
    409: "Another client is moving the arm, or the motion was stopped before it began; see the detail.",
    412: "Another client has meanwhile changed the resource; the detail names the client and what to do.",
    413: "The body is larger than `web.max_body_bytes` (uploads) or `web.max_json_bytes`.",
    415: "The endpoint does not accept this Content-Type.",
    422: "The request is invalid: the detail names the field, the value and the limit. Nothing has moved.",
    500: "An error in cobot itself; its log has the details.",
    501: "The robot's backend does not support this; the detail names the backend.",
    502: "The device rejects the request; the detail has the reason.",
    503: "The real-time process does not answer, or the robot is in a mode that does not permit motions.",
    504: "The device has not confirmed the request in time; the detail has its report.",
}


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the documentation of an endpoint's possible error answers."""
    models: dict[int, type[ErrorAnswer]] = {422: RefusedAnswer}
    return {
        status: {"model": models.get(status, ErrorAnswer), "description": DESCRIPTIONS[status]}
        for status in statuses
    }


class ErrorResponse(JSONResponse):
    """An error answer in the form that the client accepts: cobot's own, or with additional members as in RFC
    9457.
    """

    def __init__(self, content: dict[str, Any], status: int, headers: Mapping[str, str] | None) -> None:
        super().__init__(content, status, headers)
        self._content = content

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and _accepts_problem(Headers(scope=scope).getlist("accept")):
            problem = {
                "type": f"urn:cobot:error:{self._content['code']}",
                "title": HTTPStatus(self.status_code).phrase,
                "status": self.status_code,
                "request_id": log_context.get().get("request", ""),
                "manual": ERRORS_PAGE,
            }
            self.body = self.render(problem | self._content)
            self.headers["content-type"] = PROBLEM
            self.headers["content-length"] = str(len(self.body))
        await super().__call__(scope, receive, send)


def _accepts_problem(accept: Iterable[str]) -> bool:
    """Whether a client accepts the media type of RFC 9457 with a weight above 0."""
    for media_range in ",".join(accept).split(","):
        name, *parameters = (part.strip().lower() for part in media_range.split(";"))
        if name == PROBLEM:
            return not any(re.fullmatch(r"q=0(\.0*)?", each) for each in parameters)
    return False


def status_of(error: CobotError) -> int:
    """Return the HTTP status of an error."""
    return next(STATUS[kind] for kind in type(error).__mro__ if kind in STATUS)


def install(app: FastAPI) -> None:
    """Install the handlers that answer every error of this application in the same form."""
    # All of them are coroutines, because Starlette would run a plain function in a thread.
    app.add_exception_handler(CobotError, _cobot_error)
    app.add_exception_handler(RequestValidationError, _invalid_request)
    app.add_exception_handler(HTTPException, _http_exception)
    app.add_exception_handler(OSError, _answer_refusal_of_system)
    app.add_exception_handler(MemoryError, _answer_refusal_of_system)
    app.add_exception_handler(RuntimeError, _answer_refusal_of_system)  # raised if a thread cannot be started
    app.add_exception_handler(Exception, _answer_unexpected)
    app.router.default = without_websocket(app.router.default)


def answer_to(error: CobotError, explain: Explain | None = None) -> JSONResponse:
    """Return the HTTP answer to an error. `explain` is its explanation, by default the failed checks."""
    headers = next((more for kind, more in HEADERS.items() if isinstance(error, kind)), None)
    return _answer(
        status_of(error), str(error), error.code, headers, explain or explain_of(error), error.details
    )


def tell(request: Request, explain: Explain) -> None:
    """Set the explanation for an error answer to this request."""
    request.state.explain = explain


def without_websocket(otherwise: ASGIApp) -> ASGIApp:
    """Return the application that answers unknown paths. An unknown WebSocket gets a 404, as an unknown
    request does; Starlette sends 403.
    """

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            error = errors.NotFoundError(f"there is no WebSocket {scope['path']}; /docs lists what there is")
            await answer_to(error)(scope, receive, send)
        else:
            await otherwise(scope, receive, send)

    return answer


def _answer(
    status: int,
    detail: str,
    code: str,
    headers: Any = None,
    explain: Explain | None = None,
    details: Mapping[str, Any] | None = None,
) -> JSONResponse:
    audit.add_details(error=detail, code=code)
    more: dict[str, Any] = {} if explain is None else {"explain": explain.model_dump()}
    if details:
        more["details"] = dict(details)
    return ErrorResponse({"detail": detail, "code": code} | more, status, headers)


async def _cobot_error(request: Request, exc: Exception) -> JSONResponse:
    assert isinstance(exc, CobotError)
    return answer_to(exc, getattr(request.state, "explain", None))


async def _answer_refusal_of_system(request: Request, exc: Exception) -> JSONResponse:
    error = exhausted(exc)
    if error is None:
        raise exc
    return await _answer_exhaustion(request, error)


async def _answer_exhaustion(request: Request, error: CobotError) -> JSONResponse:
    log.error("%s %s: %s", request.method, request.url.path, error)
    return await _cobot_error(request, error)


async def _invalid_request(request: Request, exc: Exception) -> JSONResponse:
    assert isinstance(exc, RequestValidationError)
    found = dict.fromkeys(_sentence(error) for error in exc.errors())
    return _answer(422, "; ".join(found), errors.InputError.code)


def _allowed(request: Request) -> str:
    """List the methods of a path. Each method is a separate route, and Starlette lists only the first one."""
    routes = [
        each
        for each in request.app.routes
        if isinstance(each, Route) and each.matches(request.scope)[0] is Match.PARTIAL
    ]
    methods = {method for each in routes if each.path == routes[0].path for method in each.methods or ()}
    return ", ".join(sorted(methods)) or "GET, HEAD"  # paths without a route are files


def _meant(request: Request) -> str:
    """Suggest a path for a wrong one: the path with single slashes and in lower case, or a similar existing
    path.
    """
    path = request.scope["path"]
    if len(path) > MAX_GUESSED:
        return ""
    routes = [each for each in request.app.routes if isinstance(each, Route)]
    whole = re.sub("/+", "/", path).lower()
    version = VERSION if whole.startswith(BELOW) else ""
    plain = whole.removeprefix(version)
    if whole != path and any(each.path_regex.fullmatch(plain) for each in routes):
        return f" (did you mean {whole}?)"
    guess = difflib.get_close_matches(plain, [each.path for each in routes if "{" not in each.path], 1, 0.8)
    return f" (did you mean {version}{guess[0]}?)" if guess else ""


async def _http_exception(request: Request, exc: Exception) -> JSONResponse:
    assert isinstance(exc, HTTPException)
    if isinstance(exc.__cause__, CobotError):
        return await _cobot_error(request, exc.__cause__)
    if error := exhausted(exc.__cause__):  # the disk for pending uploads has failed
        return await _answer_exhaustion(request, error)
    path = request.url.path
    match exc.status_code:
        case 400:  # FastAPI raises this for a body that could not be parsed
            return _answer(422, f"the body cannot be read: {exc.detail}", errors.InputError.code)
        case 404:
            detail = f"there is no {path}{_meant(request)}; /docs lists what there is"
            return _answer(404, detail, errors.NotFoundError.code)
        case 405:
            allowed = _allowed(request)
            detail = f"{request.method} is not possible on {path}; allowed: {allowed}"
            return _answer(405, detail, "method_not_allowed", {"Allow": allowed})
        case status:
            return _answer(status, str(exc.detail), "http", exc.headers)


async def _answer_unexpected(request: Request, exc: Exception) -> JSONResponse:
    log.error("%s %s failed", request.method, request.url.path, exc_info=exc)
    # The middleware that adds the header to other answers does not see this one.
    headers = {"X-Request-Id": log_context.get().get("request", "")}
    return _answer(500, "an error in cobot itself; its log has the details", CobotError.code, headers)


def _sentence(error: Any) -> str:
    match error["type"], error["loc"]:
        case "missing", ("body",):
            return "the body is missing"
        case "value_error", ("body", field) if isinstance(error["input"], str):
            # FastAPI's own message names classes
            return f"{field}: must be an uploaded file, got the text {shown(error['input'])}"
    return sentence(error, ignored=("body", "query", "header"))
