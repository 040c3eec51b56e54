"""The declaration of an endpoint, next to its code: its role, its timeout and its cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from starlette.routing import BaseRoute

from cobot.access.roles import Role
from cobot.config import EndpointChange

WEBSOCKET = "WS"
"""Stands where others have the method."""
_DECLARED = "declared_endpoint"
"""The attribute of a function that serves an endpoint."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """What the service knows of an endpoint.

    Attributes:
        name: as in api_endpoints.yaml: "POST /stop"; "WS /events" of a WebSocket.
        role: the lowest that may use it.
        timeout_s: the timeout.
        control: whether it is refused while another client has control, see `app.services.rights.lease`.
            Motions, sessions and sequences check it themselves, because they have other transports too.
        costly: whether making the answer takes milliseconds, see `app.api.costly`.
        enabled: whether it is served.
    """

    name: str
    role: Role
    timeout_s: float
    control: bool = False
    costly: bool = False
    enabled: bool = True


def declare(function: Callable[..., Any], endpoint: Endpoint) -> None:
    """Note what endpoint a function serves."""
    setattr(function, _DECLARED, endpoint)


def declared(function: Callable[..., Any] | BaseRoute) -> Endpoint | None:
    """The endpoint that a function, or a route that leads to one, serves."""
    found = getattr(getattr(function, "endpoint", function), _DECLARED, None)
    assert found is None or isinstance(found, Endpoint)
    return found


def changed(endpoints: Mapping[str, Endpoint], changes: Mapping[str, EndpointChange]) -> dict[str, Endpoint]:
    """The endpoints as the user wants them."""
    result = dict(endpoints)
    for name, change in changes.items():
        timeout_s = change.timeout_s or result[name].timeout_s
        result[name] = replace(result[name], enabled=change.enabled, timeout_s=timeout_s)
    return result


def slowest_move_s(endpoints: Mapping[str, Endpoint]) -> float:
    """The longest time that a motion may take, in seconds."""
    return max(each.timeout_s for name, each in endpoints.items() if name.startswith("POST /robot/move/"))
