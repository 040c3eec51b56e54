"""Composes the web service from its parts, its middleware and its documentation.

The routes are in `app.routes`. The background tasks are in `app.lifetime`.
"""

from __future__ import annotations

import asyncio
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from fastapi import FastAPI
from fastapi_offline import FastAPIOffline

from app import routes
from app.api import errors
from app.api.costly import Costly
from app.api.documentation import openapi, swagger
from app.api.endpoints import Endpoint, changed, slowest_move_s
from app.api.middleware.access import Access
from app.api.middleware.audit import RequestTrail
from app.api.middleware.body_limit import BodyLimit
from app.api.middleware.clients import Clients
from app.api.middleware.origins import Origins
from app.api.middleware.timing import RequestTimes, RequestTiming
from app.api.middleware.versions import Versions
from app.api.roles import guard, roles
from app.api.routers.robots import twin_name
from app.api.start_failure import StartFailure
from app.aubo import http as vendor
from app.lifetime import Lifetime
from app.mcp.endpoint import McpEndpoint
from app.panel import manual, pages
from app.reloading import Reloading
from app.robot_services import Planner, SharedParts
from app.services.events.ring import Events
from app.services.motion.planning import PlanningService
from app.services.motion.synchronous import SyncService
from cobot.access.authentication import (
    Authenticator,
    authentication_required,
    fleet_tokens,
    rights_of_ros,
)
from cobot.access.roles import FLEET, ROS, Role
from cobot.access.tokens import TokenFile
from cobot.clock import SYSTEM, Clock
from cobot.config import Settings, load_endpoints
from cobot.logs.supervision import SupervisorLosses
from cobot.robot.description import RobotDescription, load_robot

DESCRIPTION = """Moves a robot arm. The service answers a motion request when the motion is done; `success`
shows whether the arm has arrived and settled. Lengths are in m, angles in rad. Each endpoint of a robot also
exists below `/robots/NAME`: [endpoints by robot](/docs/robots). AUBO's services have
[their own page](/docs/vendor). **This service is not a safety system.**"""


def create_app(
    settings: Settings,
    config: Path | None,
    base_url: str,
    clock: Clock = SYSTEM,
    planner: Planner = PlanningService,
    *,
    source: Path | None = None,
    host: str = "127.0.0.1",
    ros_token: str | None = None,
    fleet_token: str | None = None,
) -> FastAPI:
    """Create the application.

    Args:
        config: the settings file, for the planning processes.
        base_url: base URL of this service, for the sequence runner.
        clock: clock of all services.
        planner: function that makes the planner of a robot, from the settings file, the number of workers and
            the robot's name.
        host: address that the service listens on.
        ros_token: token of the DDS process.
        fleet_token: token of the fleet process.
        source: the file that a reload reads; see `Reloading`.

    Raises:
        ConfigError: the configuration is invalid.
    """
    endpoints = changed(routes.ENDPOINTS, load_endpoints(settings.web.endpoints, routes.ENDPOINTS))
    robots = {name: load_robot(each) for name, each in settings.each.items()}
    shared = SharedParts(
        config=config,
        base_url=base_url,
        default_robot=settings.robot.name,
        slowest_move_s=slowest_move_s(endpoints),
        clock=clock,
        planner=planner,
        sync=SyncService(),
        several=len(robots) > 1,
        tokens=_authenticator(settings, clock, ros_token, fleet_token),
        events=Events(clock),
        study_turn=asyncio.Lock(),
    )
    agents = McpEndpoint()
    app = _application(Lifetime(settings, robots, shared, agents, reload_by_signal=source is not None))
    _set_state(app, settings, shared, endpoints)
    app.state.reloading = Reloading(settings, config, source, app.state)
    app.state.origins = Origins([host, urlsplit(base_url).hostname or host], host, settings.web)
    required = authentication_required(settings.web, host)
    app.state.tokens, app.state.tokens_required = shared.tokens, required
    _add_middleware(app, settings, shared.tokens, required=required)
    table = roles(endpoints, stop_without_token=settings.web.stop_without_token)
    _document(app, robots, table if required else None)
    if endpoints[f"POST {vendor.PATH}"].enabled:
        _document_vendor(app, list(robots), table if required else None)
    routes.install(app, endpoints, list(robots), agents if settings.mcp.enabled else None)
    pages.install(app)
    manual.install(app)
    guard(app.routes, table)
    return app


def _authenticator(
    settings: Settings, clock: Clock, ros_token: str | None, fleet_token: str | None
) -> Authenticator:
    tokens = Authenticator(TokenFile(settings.web.tokens), clock)
    if ros_token:
        tokens.grant(ROS, rights_of_ros(settings.ros, settings.web), ros_token)
    if fleet_token:
        for token, role in fleet_tokens(settings.fleet, fleet_token).items():
            tokens.grant(FLEET, role, token)
    return tokens


def _application(lifetime: Lifetime) -> FastAPI:
    """Create an application that has no endpoints and only runs the background tasks of `lifetime`."""
    app: FastAPI = FastAPIOffline(
        title="cobot",
        summary="The REST API of cobot, a service that moves robot arms.",
        version=version("cobot"),
        description=DESCRIPTION,
        lifespan=lifetime.of,
        docs_url=None,
        openapi_tags=swagger.TAGS,
        servers=swagger.SERVERS,
        license_info={"name": "Apache-2.0", "identifier": "Apache-2.0"},
    )
    return app


def _set_state(app: FastAPI, settings: Settings, shared: SharedParts, endpoints: dict[str, Endpoint]) -> None:
    """Fill `app.state` with the data that requests need. `Lifetime` adds what it starts."""
    app.state.events = shared.events
    app.state.endpoints = endpoints | {twin_name(name): each for name, each in endpoints.items()}
    app.state.large_body = asyncio.Lock()
    app.state.costly = Costly()
    app.state.rosbridge_connections = app.state.foxglove_clients = 0
    app.state.losses = SupervisorLosses(None)
    app.state.web = settings.web
    app.state.requests = RequestTimes()


def _add_middleware(app: FastAPI, settings: Settings, tokens: Authenticator, *, required: bool) -> None:
    """Add the middleware, innermost first. The order ensures that rejected requests appear in the audit
    log.
    """
    app.add_middleware(Clients)
    app.add_middleware(BodyLimit, all_bytes=settings.web.limits.bodies_bytes)
    app.add_middleware(StartFailure)
    app.add_middleware(
        Access,
        tokens=tokens,
        origins=app.state.origins,
        required=required,
        required_of_proxies=settings.web.authentication != "none",
    )
    app.add_middleware(RequestTiming, times=app.state.requests)
    app.add_middleware(RequestTrail)
    app.add_middleware(Versions)
    errors.install(app)


def _document(app: FastAPI, robots: dict[str, RobotDescription], table: dict[str, Role] | None) -> None:
    """Describe the REST API. `table` contains the role that each endpoint requires; None if no tokens are
    required.
    """
    limits = {name: robot.limits for name, robot in robots.items()}
    swagger.install(app, partial(openapi.version, limits))
    app.openapi = openapi.with_limits(app.openapi, limits)  # type: ignore[method-assign]
    if table is not None:
        app.openapi = openapi.with_tokens(app.openapi, table)  # type: ignore[method-assign]


def _document_vendor(app: FastAPI, names: list[str], table: dict[str, Role] | None) -> None:
    """Describe the vendor services of the robots with the given names. `table`: see `_document`."""

    def schema() -> dict[str, Any]:
        return vendor.schema(app.openapi(), names)

    swagger.install_vendor(app, schema if table is None else openapi.with_tokens(schema, table))
