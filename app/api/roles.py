"""Makes each route require the role that its endpoint declares. A route without a declaration cannot be
served.
"""

from __future__ import annotations

from collections.abc import Awaitable, Iterable, Mapping

from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.documentation import swagger
from app.api.documentation.samples import SAMPLES_PATH
from app.api.endpoints import WEBSOCKET, Endpoint
from app.api.errors import answer_to
from app.api.middleware.access import IDENTITY
from app.api.routers.robots import twin_name
from cobot import audit
from cobot.access.authentication import is_loopback
from cobot.access.roles import Identity, Role, require
from cobot.addresses import MANUAL, MCP
from cobot.errors import CobotError

STOP = "POST /stop"
STOPS = (STOP, twin_name(STOP))
CHANGING = ("POST", "PUT", "DELETE")
PANEL, THREE = "/panel", "/three/{name}"
PANEL_PLANNERS, PANEL_LUA = f"{PANEL}/planners.js", f"{PANEL}/lua-functions.js"
PUBLIC_PATHS = (
    "/",
    PANEL,
    f"{PANEL}/",
    PANEL_PLANNERS,
    PANEL_LUA,
    THREE,
    MANUAL,
    "/docs",
    "/docs/oauth2-redirect",
    f"{SAMPLES_PATH}/{{name}}",
    swagger.ROBOTS_PAGE,
    swagger.VENDOR_PAGE,
    "/redoc",
    "/openapi.json",
    swagger.SCHEMA,
    swagger.ROBOTS_SCHEMA,
    swagger.VENDOR_SCHEMA,
    swagger.STATIC,
)
"""Paths that need no token: the panel, the manual and the documentation, in which a user can enter a token.
They reveal only the name of this robot and the limits of its joints.
"""


def roles(endpoints: Mapping[str, Endpoint], *, stop_without_token: bool) -> dict[str, Role]:
    """Return the role that each endpoint needs. Endpoints with a robot's name in their path are included."""
    table = {name: endpoint.role for name, endpoint in endpoints.items()}
    table |= {STOP: Role.PUBLIC} if stop_without_token else {}
    twins = {twin_name(name): role for name, role in table.items()}
    # /mcp tools that plan or move require the agent role, see app.mcp.tools
    return table | twins | {MCP: Role.OBSERVER}


def endpoint_of(route: BaseRoute) -> str:
    """Return the name of a route's endpoint, as in `roles`; for a public route, its path.

    Raises:
        TypeError: a programming error: this kind of route cannot have a role.
    """
    if isinstance(route, APIWebSocketRoute):
        return f"{WEBSOCKET} {route.path}"
    if isinstance(route, APIRoute) and route.path not in PUBLIC_PATHS:
        return f"{' '.join(sorted(route.methods or ()))} {route.path}"
    if isinstance(route, Route | Mount):
        return route.path
    raise TypeError(f"{route} is not a route that can have a role")


def guard(routes: Iterable[BaseRoute], table: Mapping[str, Role]) -> None:
    """Make each of the routes require its role.

    Raises:
        TypeError: a route has no role, which is a programming error.
    """
    for route in routes:
        name = endpoint_of(route)
        if name in PUBLIC_PATHS:
            continue
        if name not in table:
            raise TypeError(f"{name} has no role: declare it with `EndpointRouter.endpoint`")
        assert isinstance(route, Route | WebSocketRoute)
        if table[name] is not Role.PUBLIC:
            route.app = _Guarded(
                route.app,
                table[name],
                free_on_loopback=name in STOPS,
                changes=name.startswith(CHANGING) and (table[name] >= Role.OPERATOR or name in STOPS),
            )


class _Guarded:
    """Wraps the application of a route, and lets only clients with the required role use it."""

    def __init__(self, app: ASGIApp, role: Role, *, free_on_loopback: bool, changes: bool) -> None:
        self._app = app
        self._role = role
        self._free_on_loopback = free_on_loopback
        self._changes = changes

    def __call__(self, scope: Scope, receive: Receive, send: Send) -> Awaitable[None]:
        if self._changes:
            audit.would_change()
        identity: Identity = scope[IDENTITY]
        if identity.role < self._role and not (self._free_on_loopback and _sits_here(identity)):
            try:
                require(identity, self._role)
            except CobotError as exc:
                return answer_to(exc)(scope, receive, send)
        return self._app(scope, receive, send)


def _sits_here(identity: Identity) -> bool:
    return is_loopback(identity.address) and not identity.forwarded
