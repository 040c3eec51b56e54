"""The application's routes, in matching order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from copy import copy

from fastapi import APIRouter, FastAPI
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute, Route

from app.api.endpoints import Endpoint, declared
from app.api.routers import (
    access,
    audit,
    backups,
    cell,
    common,
    control,
    events,
    force,
    force_motions,
    freedrive,
    geometry,
    gripper,
    io_points,
    jobs,
    operations,
    plans,
    positions,
    programs,
    recordings,
    robot,
    robots,
    scene,
    sequences,
    stream,
    studies,
    tool,
    trajectory,
)
from app.aubo import http as vendor
from app.foxglove import router as foxglove
from app.mcp.endpoint import McpEndpoint
from app.rosbridge import router as rosbridge
from cobot.addresses import MCP

OF_A_ROBOT = (
    robot.router,
    positions.router,
    plans.router,
    scene.router,
    tool.router,
    geometry.router,
    io_points.router,
    force.router,
    gripper.router,
    cell.router,
    control.router,
    freedrive.router,
    force_motions.router,
    trajectory.router,
    jobs.router,
    recordings.router,
    sequences.router,
    programs.router,
    studies.router,
    events.router,
    foxglove.router,
    common.router,
    stream.router,
)
"""Routers whose routes also exist below the name of each robot. Frequently polled routes come first."""
OF_THE_SERVICE = (
    robots.router,
    operations.router,
    backups.router,
    access.router,
    audit.router,
    vendor.router,
    rosbridge.router,
)


def install(
    app: FastAPI, endpoints: Mapping[str, Endpoint], names: list[str], agents: McpEndpoint | None
) -> None:
    """Add the routes of all enabled endpoints, ahead of the existing routes.

    Routes are matched in order, so the documentation's routes come last. `include_router` is not used,
    because FastAPI would then match nested routers for each request.

    Args:
        endpoints: the endpoints by name, with the user's changes.
        names: names of all robots, for the documentation.
        agents: the MCP endpoint for agents; None if it is disabled.
    """
    plain = _enabled(OF_A_ROBOT, endpoints)
    routes = [*plain, *robots.twins(plain, names), *_enabled(OF_THE_SERVICE, endpoints)]
    if agents is not None:
        # POST only, because the body of a GET would not be counted
        routes.append(Route(MCP, agents, methods=["POST"]))
    app.router.routes[:0] = routes
    for route in app.routes:
        if isinstance(route, APIRoute):
            route.operation_id = route.name  # becomes the method's name in generated clients


def _enabled(routers: Iterable[APIRouter], endpoints: Mapping[str, Endpoint]) -> list[BaseRoute]:
    """Copy the routes of all enabled endpoints. Copies are needed because each application adds its own
    access check.
    """
    return [copy(route) for endpoint, route in _routes(routers) if endpoints[endpoint.name].enabled]


def _routes(routers: Iterable[APIRouter]) -> Iterator[tuple[Endpoint, BaseRoute]]:
    """Yield each route with the declaration of its endpoint."""
    for router in routers:
        for route in router.routes:
            endpoint = declared(route)
            assert endpoint is not None, f"{route} is served without `EndpointRouter.endpoint`"
            yield endpoint, route


ENDPOINTS = {endpoint.name: endpoint for endpoint, _ in _routes([*OF_A_ROBOT, *OF_THE_SERVICE])}
"""The declarations of all endpoints, by name."""
