"""Which role each endpoint needs: the one table. A route that is not in it cannot be served.

A GET changes nothing, so that whoever may look may have it, and a link from anywhere may lead to it.
"""

from __future__ import annotations

from collections.abc import Awaitable, Iterable, Mapping

from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api import documentation
from app.api.access import IDENTITY
from app.api.errors import answer_to
from app.api.routers.robots import twin_name
from app.api.samples import SAMPLES_PATH
from cobot import audit
from cobot.access.authentication import is_loopback
from cobot.access.roles import Identity, Role, require
from cobot.addresses import MCP
from cobot.errors import CobotError

STOP = "POST /stop"
STOPS = (STOP, twin_name(STOP))
CHANGING = ("POST", "PUT", "DELETE")
ROLES: dict[str, Role] = {
    "GET /robot/joint_states": Role.OBSERVER,
    "GET /robot/pose": Role.OBSERVER,
    "GET /robot/positions": Role.OBSERVER,
    "POST /robot/positions": Role.OPERATOR,
    "DELETE /robot/positions/{name}": Role.OPERATOR,
    "GET /robot/geometry": Role.OBSERVER,
    "POST /robot/move/named": Role.OPERATOR,
    "POST /robot/move/pose": Role.OPERATOR,
    "POST /robot/move/joints": Role.OPERATOR,
    "POST /robot/move/arc": Role.OPERATOR,
    "POST /robot/move/sequence": Role.OPERATOR,
    "POST /robot/plan/named": Role.AGENT,  # moves nothing, but takes the computer's time
    "POST /robot/plan/pose": Role.AGENT,
    "POST /robot/plan/joints": Role.AGENT,
    "POST /robot/plan/arc": Role.AGENT,
    "POST /robot/plan/path": Role.AGENT,
    "POST /robot/plan/sequence": Role.AGENT,
    "POST /robot/execute": Role.OPERATOR,
    "GET /robot/motion": Role.OBSERVER,
    "GET /robot/plans": Role.OBSERVER,
    "GET /robot/plans/{plan}": Role.OBSERVER,
    "POST /robot/plans/{plan}/rehearse": Role.AGENT,  # as a plan
    "POST /robot/approve": Role.OPERATOR,
    "GET /robot/tool": Role.OBSERVER,
    "POST /robot/tool": Role.PROGRAMMER,  # all later motions are planned with it
    "GET /robot/io": Role.OBSERVER,
    "PUT /robot/io/{name}": Role.OPERATOR,
    "GET /scene": Role.OBSERVER,
    "POST /scene": Role.OPERATOR,
    "POST /robot/reset": Role.OPERATOR,
    "POST /robot/acknowledge": Role.OPERATOR,
    "POST /trajectory/send": Role.OPERATOR,
    "POST /trajectory/send_csv": Role.OPERATOR,
    "GET /trajectory/logs": Role.OBSERVER,
    "GET /recordings": Role.OBSERVER,
    "POST /recordings": Role.OPERATOR,
    "GET /recordings/{name}": Role.OBSERVER,
    "GET /recordings/{name}/path": Role.OBSERVER,
    "DELETE /recordings/{name}": Role.PROGRAMMER,  # it may be what explains a fault
    "POST /sequences/start": Role.PROGRAMMER,
    "GET /sequences/status": Role.OBSERVER,
    "GET /sequences/logs": Role.OBSERVER,
    "GET /events": Role.OBSERVER,
    "WS /events": Role.OBSERVER,
    "WS /foxglove": Role.OBSERVER,
    "GET /jobs": Role.OBSERVER,
    "GET /jobs/{job}": Role.OBSERVER,
    "POST /jobs/{job}/cancel": Role.OPERATOR,
    "POST /jobs/{job}/pause": Role.OPERATOR,
    "POST /jobs/{job}/resume": Role.OPERATOR,
    "POST /jobs/{job}/step": Role.OPERATOR,
    "GET /robot/speed_override": Role.OBSERVER,
    "POST /robot/speed_override": Role.OPERATOR,
    STOP: Role.OBSERVER,  # whoever sees that it goes wrong
    "GET /health": Role.OBSERVER,
    "GET /robots": Role.OBSERVER,
    "GET /robot/control": Role.OBSERVER,
    "POST /robot/control": Role.OPERATOR,
    "DELETE /robot/control": Role.OPERATOR,
    "GET /robot/freedrive": Role.OBSERVER,
    "POST /robot/freedrive": Role.OPERATOR,
    "DELETE /robot/freedrive": Role.OPERATOR,
    "GET /audit": Role.ADMIN,
    "GET /metrics": Role.OBSERVER,
    "GET /health/live": Role.NOBODY,  # who restarts what does not answer has no token
    "GET /health/ready": Role.NOBODY,
    "POST /admin/reload": Role.ADMIN,
    "WS /robot/stream": Role.OBSERVER,  # a session needs an operator: app.api.routers.stream
    "WS /rosbridge": Role.OBSERVER,  # each operation needs its own: app.rosbridge.roles
    "POST /{robot}/{Class}/{method}": Role.OBSERVER,  # and each method: app.aubo.roles
}
PANEL, THREE = "/panel", "/three.js"
PUBLIC = (
    "/",
    PANEL,
    THREE,
    "/docs",
    "/docs/oauth2-redirect",
    f"{SAMPLES_PATH}/{{name}}",
    documentation.ROBOTS_PAGE,
    documentation.VENDOR_PAGE,
    "/redoc",
    "/openapi.json",
    documentation.SCHEMA,
    documentation.ROBOTS_SCHEMA,
    documentation.VENDOR_SCHEMA,
    documentation.STATIC,
)
"""The panel and the documentation, in which a token can be entered, are open to all: they tell nothing about
this robot but its joints' limits and its name."""


def endpoint_of(route: BaseRoute) -> str:
    """As in `ROLES`: "POST /stop"; for what is public its path."""
    if isinstance(route, APIWebSocketRoute):
        return f"WS {route.path}"
    if isinstance(route, APIRoute) and route.path not in PUBLIC:
        return f"{' '.join(sorted(route.methods or ()))} {route.path}"
    if isinstance(route, Route | Mount):
        return route.path
    raise TypeError(f"{route} is no route that a role could be given")


def roles(*, stop_without_token: bool) -> dict[str, Role]:
    """The table as the settings have it, with the endpoints of each robot by its name."""
    table = ROLES | ({STOP: Role.NOBODY} if stop_without_token else {})
    twins = {twin_name(name): role for name, role in table.items()}
    return table | twins | {MCP: Role.OBSERVER}  # what plans or moves needs an agent: app.mcp.tools


def guard(routes: Iterable[BaseRoute], table: Mapping[str, Role]) -> None:
    """Have each of the routes ask for its role.

    Raises:
        TypeError: a route has none: a programming error.
    """
    for route in routes:
        name = endpoint_of(route)
        if name in PUBLIC:
            continue
        if name not in table:
            raise TypeError(f"{name} has no role: give it one in app.api.roles")
        assert isinstance(route, Route | WebSocketRoute)
        if table[name] is not Role.NOBODY:
            route.app = _Guarded(
                route.app,
                table[name],
                free_on_loopback=name in STOPS,
                changes=name.startswith(CHANGING) and (table[name] >= Role.OPERATOR or name in STOPS),
            )


class _Guarded:
    """What a route leads to, for those who may."""

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
