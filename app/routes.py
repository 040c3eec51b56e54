"""Which routes the application has, and in which order they are tried."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy

from fastapi import APIRouter, FastAPI
from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.routing import BaseRoute, Route

from app.api.routers import (
    audit,
    common,
    control,
    events,
    freedrive,
    geometry,
    io_points,
    jobs,
    operations,
    plans,
    positions,
    recordings,
    robot,
    robots,
    scene,
    sequences,
    stream,
    tool,
    trajectory,
)
from app.aubo import http as vendor
from app.foxglove import router as foxglove
from app.mcp.endpoint import McpEndpoint
from app.rosbridge import router as rosbridge
from cobot.addresses import MCP
from cobot.config import Endpoint

OF_A_ROBOT = (
    robot.router,
    positions.router,
    plans.router,
    scene.router,
    tool.router,
    geometry.router,
    io_points.router,
    control.router,
    freedrive.router,
    trajectory.router,
    jobs.router,
    recordings.router,
    sequences.router,
    events.router,
    foxglove.router,
    common.router,
    stream.router,
)
"""Their routes are there a second time, below the name of any robot. What is polled comes first."""
OF_THE_SERVICE = (robots.router, operations.router, audit.router, vendor.router, rosbridge.router)


def install(
    app: FastAPI, endpoints: dict[str, Endpoint], names: list[str], agents: McpEndpoint | None
) -> None:
    """Serve all that api_endpoints.yaml wants, before what is there already.

    Routes are matched one after the other, so those of the documentation come last. They are no included
    routers, for the nesting that FastAPI keeps of these is matched in each request too.

    Args:
        endpoints: as `load_endpoints` has read them.
        names: of all robots, for the documentation.
        agents: None where there is no way for them.
    """
    plain = _enabled(OF_A_ROBOT, endpoints)
    routes = [*plain, *robots.twins(plain, names), *_enabled(OF_THE_SERVICE, endpoints)]
    if agents is not None:
        routes.append(Route(MCP, agents, methods=["POST"]))  # of a GET nobody would count the body
    app.router.routes[:0] = routes
    for route in app.routes:
        if isinstance(route, APIRoute):
            route.operation_id = route.name  # what generated clients call their methods


def _enabled(routers: Iterable[APIRouter], endpoints: dict[str, Endpoint]) -> list[BaseRoute]:
    """The routes that api_endpoints.yaml wants: copies, as an application guards its own."""
    return [
        copy(route) for router in routers for route in router.routes if endpoints[_endpoint(route)].enabled
    ]


def _endpoint(route: BaseRoute) -> str:
    """What api_endpoints.yaml calls it."""
    if isinstance(route, APIWebSocketRoute):
        return f"WS {route.path}"
    assert isinstance(route, APIRoute)
    (method,) = route.methods or {""}
    return f"{method} {route.path}"
