"""The declaration of an endpoint, next to its code: its role, its timeout and its cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from starlette.routing import BaseRoute

from cobot.access.roles import Role
from cobot.config import EndpointChange

WEBSOCKET = "WS"
"""First word of a WebSocket endpoint's name, where other endpoints have the HTTP method."""
_DECLARED = "declared_endpoint"
"""Name of the attribute that marks functions which serve an endpoint."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """The declaration of an endpoint.

    Attributes:
        name: as in api_endpoints.yaml: "POST /stop", or "WS /events" for a WebSocket.
        role: the lowest role that may use it.
        timeout_s: the timeout for the answer.
        control: whether requests are rejected while another client has control, see
            `app.services.rights.lease`. `CobotRoute` checks this before it reads the body. A service that has
            other transports, or that waits before it acts, checks again.
        costly: whether making the answer takes milliseconds, see `app.api.costly`. An endpoint that is costly
            only for some requests, or that first waits, calls `costly_turn` itself.
        keyed: whether it begins a job and accepts an `Idempotency-Key`, see `app.api.middleware.idempotency`.
        enabled: whether it is served.

    Raises:
        ValueError: `CobotRoute` ignores `control` or `costly` for this method, or would keep other costly
            requests waiting while the body arrives.
    """

    name: str
    role: Role
    timeout_s: float
    control: bool = False
    costly: bool = False
    keyed: bool = False
    enabled: bool = True

    def __post_init__(self) -> None:
        method = self.name.split(" ")[0]
        if self.control and method in ("GET", WEBSOCKET):
            raise ValueError(f"{self.name}: control is for requests that change something; {method} reads")
        if self.costly and method != "GET":
            raise ValueError(f"{self.name}: costly is for GET; {method} must call `costly_turn` itself")


def declare(function: Callable[..., Any], endpoint: Endpoint) -> None:
    """Attach the declaration of an endpoint to the function that serves it."""
    setattr(function, _DECLARED, endpoint)


def declared(function: Callable[..., Any] | BaseRoute) -> Endpoint | None:
    """Return the endpoint that a function or a route's function serves; None if it serves none."""
    found = getattr(getattr(function, "endpoint", function), _DECLARED, None)
    assert found is None or isinstance(found, Endpoint)
    return found


def changed(endpoints: Mapping[str, Endpoint], changes: Mapping[str, EndpointChange]) -> dict[str, Endpoint]:
    """Return the endpoints with the user's configured changes."""
    result = dict(endpoints)
    for name, change in changes.items():
        timeout_s = change.timeout_s or result[name].timeout_s
        result[name] = replace(result[name], enabled=change.enabled, timeout_s=timeout_s)
    return result


def slowest_move_s(endpoints: Mapping[str, Endpoint]) -> float:
    """Return the longest timeout of all endpoints that move the arm, s."""
    return max(each.timeout_s for name, each in endpoints.items() if name.startswith("POST /robot/move/"))
