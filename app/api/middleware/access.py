"""ASGI middleware that identifies the client and checks the host and origin of all HTTP requests and
WebSockets.

The middleware rejects requests for a different host (421) or from a foreign web page (403, see `origins`),
and stores the client's identity in the scope. The route decides whether this client may use it; see
`app.api.roles`.

A client sends its token in the header `Authorization: Bearer TOKEN`. Browsers cannot set headers of a
WebSocket, so there the token may also be sent as a subprotocol, `new WebSocket(url, ["cobot", "cobot.token."
+ TOKEN])`, or as `?token=TOKEN`, for libraries that accept only a URL. The other two ways are safer, because
URLs appear in proxy logs and browser histories. The service removes the token from the URL before its other
parts can see it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Mapping
from functools import lru_cache
from typing import cast
from urllib.parse import parse_qsl, unquote_to_bytes, urlencode

from starlette.middleware.cors import CORSMiddleware
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.errors import answer_to
from app.api.middleware.origins import Origins
from app.api.middleware.versions import plain_path
from app.api.strict import APPLIED
from cobot.access.authentication import Authenticator, Holder
from cobot.access.claimed import MAX_NAME, claimed
from cobot.access.roles import ANONYMOUS, Identity, Role, acting
from cobot.addresses import CLIENT_NAME, IDEMPOTENCY_KEY, PREFER
from cobot.errors import CobotError, MisdirectedError, PermissionDenied

IDENTITY = "cobot.identity"
STILL_VALID = "cobot.still_valid"
"""Key in the scope for a function that checks whether the request's token is still valid with the same role.
Code that sends long answers calls it.
"""
_HEADERS = "cobot.headers"
HEADERS = (
    "Authorization",
    "Content-Type",
    "X-Motion-Token",
    "X-Control-Token",
    "X-Request-Id",
    CLIENT_NAME,
    PREFER,
    IDEMPOTENCY_KEY,
)
METHODS = ("GET", "POST", "PUT", "DELETE")
SUBPROTOCOL = "cobot"
TOKEN_SUBPROTOCOL = "cobot.token."
POLICY_VIOLATION = 1008
"""Close code of a WebSocket whose token is no longer valid."""
INVALID = "the token is no longer valid"
PAGES = ("/docs", "/redoc")
UNFRAMED = [(b"x-frame-options", b"DENY"), (b"content-security-policy", b"frame-ancestors 'none'")]
"""Headers that prevent other pages from embedding the documentation in a frame. Its buttons move the arm."""
FORWARDING = frozenset(
    (b"forwarded", b"via", b"x-forwarded-for", b"x-forwarded-host", b"x-forwarded-proto", b"x-real-ip")
)
"""Headers that a proxy adds. They only show that there is a proxy, and their values are not trusted."""
NAME_PARAMETER = "client_name"
"""Query parameter of a WebSocket's URL with the client's name, because browsers cannot set the headers of a
WebSocket.
"""
MAX_ENCODED = 12 * MAX_NAME + 1
"""Maximum number of bytes that are read from the parameter `client_name`. A percent-encoded character takes
up to twelve bytes.
"""
_NAME = CLIENT_NAME.lower().encode()
_PICKED = FORWARDING.union(
    (_NAME, b"host", b"origin", b"authorization", b"sec-fetch-site", b"sec-fetch-mode", b"sec-fetch-dest")
)


def identity_of(connection: HTTPConnection) -> Identity:
    """Return the identity of the client that has sent a request or opened a WebSocket."""
    return cast(Identity, connection.scope[IDENTITY])


class Access:
    """ASGI middleware. It adds no coroutine to HTTP requests, which keeps frequent ones such as GET
    /robot/state cheap.

    Args:
        required: whether clients need a token. If they do not, a client without a token has all permissions.
        required_of_proxies: whether a client behind a proxy needs a token. Otherwise the exemption for this
            computer would also apply to the proxy's clients.
    """

    def __init__(
        self,
        app: ASGIApp,
        tokens: Authenticator,
        origins: Origins,
        *,
        required: bool,
        required_of_proxies: bool,
    ) -> None:
        self._app = app
        self._tokens = tokens
        self._origins = origins
        # A browser asks which requests are permitted before a page from another permitted origin sends them.
        self._cors = CORSMiddleware(
            self._identify,
            allow_origin_regex=".*",
            allow_methods=METHODS,
            allow_headers=HEADERS,
            allow_private_network=True,
            expose_headers=("WWW-Authenticate", "X-Request-Id", "Location", APPLIED),
        )
        role = {
            False: Role.PUBLIC if required else Role.ADMIN,
            True: Role.PUBLIC if required_of_proxies else Role.ADMIN,
        }
        self._anonymous = lru_cache(256)(
            lambda name, address, forwarded: Identity(
                claimed(unquote_to_bytes(name).decode("utf-8", "replace")),
                role[forwarded],
                address,
                forwarded,
            )
        )
        self._known = lru_cache(256)(
            lambda who, address, forwarded: Identity(who.name, who.role, address, forwarded, who.stored)
        )

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if scope["type"] == "lifespan":
            return self._app(scope, receive, send)
        try:
            headers = _picked(scope)
            self._origins.check(scope, headers)
        except CobotError as exc:
            return answer_to(exc)(scope, receive, send)
        foreign = headers.get(b"origin") in self._origins.listed
        return (self._cors if foreign else self._identify)(scope, receive, send)

    def _identify(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        client = scope.get("client")
        address = client[0] if client else ""
        websocket = scope["type"] == "websocket"
        forwarded = not FORWARDING.isdisjoint(scope[_HEADERS])
        token, by_protocol = _token(scope, websocket)
        name = scope[_HEADERS].get(_NAME, b"")
        if websocket:
            name = (_cut_off(scope, NAME_PARAMETER) or "").encode() or name
        holder = None if token is None else self._tokens.find(token)
        if token is None:
            identity = self._anonymous(name[:MAX_ENCODED], address, forwarded)
        elif holder is None:  # a wrong token gives no rights, not even those of clients without a token
            identity = Identity(ANONYMOUS, Role.PUBLIC, address, forwarded)
        else:
            identity = self._known(holder, address, forwarded)
        scope[IDENTITY] = identity
        acting.set(identity)
        if websocket and token is not None and holder is not None:
            return self._while_valid(scope, receive, send, token, holder, by_protocol)
        if token is not None:
            scope[STILL_VALID] = lambda: self._tokens.find(token) == holder
        if not websocket and plain_path(scope).startswith(PAGES):
            send = _forbid_frames(send)
        return self._app(scope, receive, send)

    async def _while_valid(
        self, scope: Scope, receive: Receive, send: Send, token: str, holder: Holder, by_protocol: bool
    ) -> None:
        """Serve a WebSocket. Close it when the client's token is revoked, expires, or gets a different
        role.
        """
        accepted = ended = False

        async def check_then_send(message: Message) -> None:
            nonlocal accepted
            if ended:
                raise OSError(INVALID)  # the same message as when the client disconnects
            if message["type"] == "websocket.accept":
                accepted = True
                if by_protocol and message.get("subprotocol") is None:
                    message = {**message, "subprotocol": SUBPROTOCOL}
            await send(message)

        async def watch() -> None:
            nonlocal ended
            while not accepted or self._tokens.find(token) == holder:
                await self._tokens.await_change()
            ended = True
            with contextlib.suppress(OSError, RuntimeError):  # the WebSocket has just been closed elsewhere
                await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": INVALID})

        watching = asyncio.create_task(watch())
        try:
            await self._app(scope, receive, check_then_send)
        finally:
            watching.cancel()


def _picked(scope: Scope) -> dict[bytes, bytes]:
    """Read the headers about the origin of a request.

    Raises:
        MisdirectedError, PermissionDenied: a header occurs twice, so that two programs could use different
            values.
    """
    found: dict[bytes, bytes] = {}
    for name, value in scope["headers"]:
        if name in _PICKED:
            if name in found and name not in FORWARDING:
                kind = MisdirectedError if name == b"host" else PermissionDenied
                raise kind(f"the header {name.decode()} occurs twice")
            found[name] = value
    scope[_HEADERS] = found
    return found


def _token(scope: Scope, websocket: bool) -> tuple[str | None, bool]:
    """Return the token in a request, and whether it was sent as a subprotocol. The token is "" if the header
    is in a different form.
    """
    headers: Mapping[bytes, bytes] = scope[_HEADERS]
    header = headers.get(b"authorization")
    in_query = _cut_off(scope, "token") if websocket else None
    if header is not None:
        scheme, _, token = header.decode("latin-1").partition(" ")
        return (token.strip() if scheme.lower() == "bearer" else ""), False
    if not websocket:
        return None, False
    for protocol in scope.get("subprotocols", ()):
        if protocol.startswith(TOKEN_SUBPROTOCOL):
            return protocol.removeprefix(TOKEN_SUBPROTOCOL), True
    return in_query, False


def _cut_off(scope: Scope, parameter: str) -> str | None:
    """Remove one parameter from the URL's query string, and return its value."""
    query = scope.get("query_string", b"").decode("latin-1")
    if f"{parameter}=" not in query:
        return None
    pairs = parse_qsl(query, keep_blank_values=True)
    scope["query_string"] = urlencode([pair for pair in pairs if pair[0] != parameter]).encode()
    return next((value for name, value in pairs if name == parameter), None)


def _forbid_frames(send: Send) -> Send:
    async def send_with_session(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *UNFRAMED]}
        await send(message)

    return send_with_session
