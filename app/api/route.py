"""Parses requests to endpoints, and makes their answers.

An endpoint is declared where it is written:

    router = EndpointRouter(tags=["robot"])

    @router.endpoint("GET /robot/pose", Role.OBSERVER, timeout_s=1.5, responses=responses(503))
    async def pose(request: Request) -> PoseAnswer: ...

A body is a parameter of the function: a `RequestModel`, or the fields of a form. The router adds the check of
its media type, and the documentation of the errors that a body can cause.
"""

from __future__ import annotations

import asyncio
import gc
from collections.abc import AsyncGenerator, Callable, Coroutine, Iterator, Mapping, Sequence
from inspect import iscoroutinefunction
from typing import Any, TypeVar

from fastapi import APIRouter, Depends, HTTPException, Request, Response
from fastapi.routing import APIRoute, serialize_response
from pydantic import BaseModel, ValidationError
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.costly import costly_turn
from app.api.dependencies import BEGUN_S, LARGE_BYTES, STOPS, Call, body_check, services_of
from app.api.endpoints import WEBSOCKET, Endpoint, declare, declared
from app.api.errors import responses, status_of
from app.api.json_text import decoded
from app.api.middleware.idempotency import PARAMETER, answer_once
from app.api.strict import is_strict, reports_success, with_strict_status
from app.services.clients import CLIENT
from cobot.access.roles import Role
from cobot.addresses import IDEMPOTENCY_KEY
from cobot.errors import CobotError, InputError
from cobot.motions.bodies import MOTION_TAGS
from cobot.strict import sentences, shown

BODY_ERRORS = (413, 415, 422)
"""HTTP statuses for a body that is too large, of the wrong media type, or invalid."""
PIECE_BYTES, RETURNS = 1024, 128
"""Maximum number of bytes and of line breaks in a piece, so that parsing it takes a few milliseconds at most.
See `pieces`.
"""
Result = TypeVar("Result")
Handler = Callable[[Request], Coroutine[Any, Any, Response]]
Function = TypeVar("Function", bound=Callable[..., Any])


def pieces(chunk: bytes) -> Iterator[bytes]:
    """Split a chunk into the parts that the parser of forms gets.

    The parser is a hundred times as slow where the data may be the beginning of a boundary. A chunk with many
    such places is therefore passed in small parts.
    """
    size = PIECE_BYTES if chunk.count(b"\r") > RETURNS else max(len(chunk), 1)
    for start in range(0, len(chunk), size):
        yield chunk[start : start + size]


class _CobotRequest(Request):
    async def stream(self) -> AsyncGenerator[bytes]:
        """Yield the body. A form is delivered in pieces, so that other tasks can run in between."""
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
            # Parsing a large body may hold the interpreter for a tenth of a second. Such times must not add
            # up, and must not cost the service its heartbeat while a motion depends on it.
            call = Call(self)
            async with self.app.state.large_body:
                await call.services.ownership.await_free(CLIENT.get().sequence)
                return await asyncio.to_thread(without_collection, _validated, body, model)
        except CobotError as exc:
            raise HTTPException(status_of(exc)) from exc  # FastAPI passes on no other class


def _validated(body: bytes, model: type[BaseModel]) -> BaseModel:
    """Convert the body to a model instance, which FastAPI accepts without further validation.

    Raises:
        InputError: the body is invalid. The error states where and why.
    """
    content = decoded(body, "the body")
    if not isinstance(content, dict):
        held = (
            ": this is JSON inside a JSON string; send the object itself" if isinstance(content, str) else ""
        )
        raise InputError(f"the body must be an object, got {shown(content)}{held}")
    try:
        return model.model_validate(content)
    except ValidationError as exc:
        raise InputError(sentences(exc.errors(), ignored=MOTION_TAGS)) from exc


def without_collection(function: Callable[..., Result], *arguments: Any) -> Result:
    """Call a function without garbage collection, which would traverse all new objects repeatedly."""
    gc.disable()
    try:
        return function(*arguments)
    finally:
        gc.enable()


class CobotRoute(APIRoute):
    """The route of a REST endpoint.

    For a request with a body it notes the count of stops before the body came in, and parses the body
    strictly. A large body does not delay other requests. Clients poll states, so the route answers such
    requests without FastAPI's dependencies and background tasks.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        if self.methods == {"GET"} and self._takes_request_alone():
            self.app = _answering(self._state_handler())

    def get_route_handler(self) -> Handler:
        handler = super().get_route_handler()
        endpoint = declared(self.endpoint)
        if endpoint is not None and endpoint.costly:
            handler = _answering_in_turn(handler)
        if self.methods == {"GET"}:
            return handler
        control, keyed = endpoint is not None and endpoint.control, endpoint is not None and endpoint.keyed
        may_be_strict = reports_success(self.response_model)

        async def handle(request: Request) -> Response:
            ownership = services_of(request).ownership
            request.scope[STOPS] = ownership.stops_before(request.scope.get(BEGUN_S))
            if control:
                ownership.require_control()
            strict = may_be_strict and is_strict(request)
            request = _CobotRequest(request.scope, request.receive)
            is_keyed = keyed and IDEMPOTENCY_KEY in request.headers
            answered = answer_once(request, handler) if is_keyed else handler(request)
            return with_strict_status(await answered) if strict else await answered

        return handle

    def _takes_request_alone(self) -> bool:
        """Whether the endpoint's only parameter is the request, and its answer is a model as JSON."""
        asked, endpoint = self.dependant, declared(self.endpoint)
        return (
            not (endpoint is not None and endpoint.costly)
            and self.response_field is not None
            and iscoroutinefunction(self.endpoint)
            and asked.request_param_name is not None
            and not (asked.dependencies or asked.path_params or asked.query_params or asked.header_params)
            and not (asked.cookie_params or asked.body_params or self.dependencies)
            and not (asked.response_param_name or asked.background_tasks_param_name)
        )

    def _state_handler(self) -> Handler:
        """Create a handler for endpoints that take only the request. Like FastAPI, the handler validates the
        result with its model.
        """
        endpoint, name = self.endpoint, str(self.dependant.request_param_name)
        field, status = self.response_field, self.status_code or 200

        async def handle(request: Request) -> Response:
            returned = await endpoint(**{name: request})
            if isinstance(returned, Response):
                return returned
            content = await serialize_response(field=field, response_content=returned, dump_json=True)
            return Response(content, status, media_type="application/json")

        return handle


def _answering_in_turn(handler: Handler) -> Handler:
    async def handle(request: Request) -> Response:
        async with costly_turn(request):
            return await handler(request)

    return handle


def _answering(handler: Handler) -> ASGIApp:
    """Create the ASGI application of a route. It passes the handler's errors on to the middleware of the
    whole application.
    """

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        response = await handler(Request(scope, receive, send))
        await response(scope, receive, send)

    return answer


def _with_body_check(function: Callable[..., Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a route, extended by a check of the body and by the errors that only a body can
    cause.
    """
    check = body_check(function)
    if check is None:
        return dict(options)
    documented = responses(*BODY_ERRORS) | options.get("responses", {})
    return {
        **options,
        "dependencies": [Depends(check), *options.get("dependencies", ())],
        "responses": dict(sorted(documented.items())),
    }


class EndpointRouter(APIRouter):
    """A router whose endpoints declare their role, timeout and cost."""

    def __init__(self, *, tags: Sequence[str] = (), route_class: type[APIRoute] = CobotRoute) -> None:
        super().__init__(tags=list(tags), route_class=route_class)

    def endpoint(
        self,
        name: str,
        role: Role,
        timeout_s: float,
        *,
        control: bool = False,
        costly: bool = False,
        keyed: bool = False,
        **options: Any,
    ) -> Callable[[Function], Function]:
        """Create a decorator that serves an endpoint with a function.

        Args:
            name, role, timeout_s, control, costly, keyed: see `Endpoint`.
            options: FastAPI's route options.
        """
        method, path = name.split(" ")

        def serve(function: Function) -> Function:
            declare(function, Endpoint(name, role, timeout_s, control, costly, keyed))
            if keyed:
                options["openapi_extra"] = {"parameters": [PARAMETER]}
            if method == WEBSOCKET:
                self.add_api_websocket_route(path, function)
            else:
                self.add_api_route(path, function, methods=[method], **_with_body_check(function, options))
            return function

        return serve
