"""The outermost middleware. It gives each request its id, and writes an audit log entry for each request that
changes something, regardless of the result.

The log also has the requests that the inner middleware rejects. The client's identity is read once it is
known.
"""

from __future__ import annotations

import itertools
import re
import secrets
import time
from collections.abc import Awaitable
from functools import partial
from typing import cast

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.middleware.clients import client_of
from app.services.events.ring import Events
from cobot.audit import MAX_TEXT, Audit, Trail, trail
from cobot.logs.lines import log_context, printable

HEADER = b"x-request-id"
IDENTITY = "cobot.identity"
SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
WELL_FORMED = re.compile(rb"[A-Za-z0-9._-]{1,64}")

_numbers = itertools.count(1)
_process = secrets.token_hex(4)


class RequestTrail:
    """ASGI middleware. It adds no coroutine to requests that only read, so they cost little more."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        kind = scope["type"]
        if kind == "lifespan":
            return self._app(scope, receive, send)
        request = _request_id(scope)
        client = scope.get("client")
        log_context.set({"request": request, "client": client[0] if client else ""})
        if kind == "http" and scope["method"] in SAFE:
            return self._app(scope, receive, _identify(send, request))
        audit = cast("Audit | None", getattr(scope["app"].state, "audit", None))
        if audit is None:  # not started, as in a test of the schema
            return self._app(scope, receive, send)
        address = f"{client[0]}:{client[1]}" if client else ""
        on = Trail(audit, lambda: _who(scope), address, request, partial(_tell_refused, scope))
        trail.set(on)
        if kind == "http":
            return self._request(scope, receive, send, on)
        return self._connection(scope, receive, send, on)

    async def _request(self, scope: Scope, receive: Receive, send: Send, on: Trail) -> None:
        outcome = "no answer"

        async def send_and_note(message: Message) -> None:
            nonlocal outcome
            if message["type"] == "http.response.start":
                outcome = str(message["status"])
            await send(message)

        try:
            await self._app(scope, receive, _identify(send_and_note, on.request))
        except Exception:
            outcome = "500"
            raise
        finally:
            if not on.left_out:
                what = f"{scope['method']} {scope['path']}"
                _record(on, scope, what, outcome)
                if on.changes and "code" in on.details:
                    on.tell_refused(what, str(on.details["code"]), str(on.details["error"]))

    async def _connection(self, scope: Scope, receive: Receive, send: Send, on: Trail) -> None:
        opened_s = 0.0
        outcome = "no answer"

        async def send_and_note(message: Message) -> None:
            nonlocal opened_s, outcome
            match message["type"]:
                case "websocket.accept":
                    opened_s, outcome = time.monotonic(), "ok"
                    _record(on, scope, f"WS {scope['path']} opened", outcome)
                case "websocket.http.response.start":
                    outcome = str(message["status"])
                case "websocket.close" if not opened_s:
                    outcome = "403"
            await send(message)

        try:
            await self._app(scope, receive, send_and_note)
        finally:
            if opened_s:
                on.details = {"seconds": round(time.monotonic() - opened_s, 3)}
            _record(on, scope, f"WS {scope['path']} {'closed' if opened_s else 'refused'}", outcome)


def _record(on: Trail, scope: Scope, what: str, outcome: str) -> None:
    endpoint = getattr(scope.get("route"), "path", None)
    kind = (*what.split(" ")[0::2], endpoint)  # all unknown paths count as one path
    on.audit.record(on.who(), on.from_, what, outcome, request=on.request, kind=kind, **on.details)


def _tell_refused(scope: Scope, what: str, code: str, sentence: str) -> None:
    state = scope["app"].state
    events: Events = state.events
    name = scope.get("path_params", {}).get("robot", state.services.link.memory.robot)
    events.publish(
        "refused",
        name if name in state.robots else "",
        by=str(client_of(scope)),
        what=printable(what, MAX_TEXT),
        code=code,
        reason=printable(sentence, MAX_TEXT),
    )


def _who(scope: Scope) -> str:
    identity = scope.get(IDENTITY)
    return "anonymous" if identity is None else str(identity.name)


def _request_id(scope: Scope) -> str:
    """Return the client's own request id, with which it can find its requests in the log, or else a new
    id.
    """
    for name, value in scope["headers"]:
        if name == HEADER and WELL_FORMED.fullmatch(value):
            found: str = value.decode()
            return found
    return f"{_process}-{next(_numbers):x}"


def _identify(send: Send, request: str) -> Send:
    def answer(message: Message) -> Awaitable[None]:
        if message["type"] == "http.response.start":
            message["headers"] = [*message["headers"], (HEADER, request.encode())]
        return send(message)

    return answer
