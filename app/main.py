"""The web service, put together."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import signal
from collections.abc import AsyncIterator
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from fastapi import FastAPI
from fastapi.routing import APIRoute, APIWebSocketRoute
from fastapi_offline import FastAPIOffline
from starlette.routing import BaseRoute, Route

from app.api import documentation, errors, openapi
from app.api.access import Access
from app.api.audit import RequestTrail
from app.api.body_limit import BodyLimit
from app.api.clients import Clients
from app.api.origins import Origins
from app.api.roles import guard, roles
from app.api.routers import audit as audit_router
from app.api.routers import (
    common,
    control,
    events,
    geometry,
    jobs,
    operations,
    plans,
    recordings,
    scene,
    sequences,
    tool,
    trajectory,
)
from app.api.routers import robot as robot_router
from app.api.routers import robots as robots_router
from app.api.routers import stream as stream_router
from app.api.start_failure import StartFailure, saying_why
from app.api.timing import RequestTimes, Timing
from app.aubo import http as vendor_http
from app.mcp.endpoint import McpEndpoint
from app.offers.robots_on_graph import serving
from app.panel import pages
from app.reloading import Reloading
from app.robot_services import Planner, SharedParts, serving_robot
from app.rosbridge import router as rosbridge_router
from app.services.events.log_lines import log_events
from app.services.events.ring import Events
from app.services.motion.planning import PlanningService
from app.services.motion.synchronous import SyncService
from cobot.access.authentication import Authenticator, authentication_required, rights_of_ros
from cobot.access.roles import ROS
from cobot.access.tokens import TokenFile
from cobot.addresses import MCP
from cobot.audit import Audit
from cobot.clock import SYSTEM, Clock
from cobot.config import Endpoint, Settings, load_endpoints
from cobot.logs.supervision import Losses
from cobot.robot.description import load_robot

DESCRIPTION = """Moves a robot arm. Motions answer when the arm has arrived and settled: look at `success`.
Lengths in m, angles in rad. The services of the controller's vendor are on
[a page of their own](/docs/vendor). **This is no safety system.**"""


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
) -> FastAPI:
    """The application. Long, as it is the list of its parts, in the order in which they need each other.

    Args:
        config: the settings' file, for the planning processes.
        base_url: where the sequence runner finds this service.
        clock: that all services go by.
        planner: makes what a robot plans with, from the settings' file, the number of workers and its name.
        host: address that the service listens on.
        ros_token: by which the DDS process is known.
        source: what a reload reads, see `Reloading`.

    Raises:
        ConfigError: the configuration is wrong.
    """
    endpoints = load_endpoints(settings.web.endpoints)
    robots = {name: load_robot(each) for name, each in settings.each.items()}
    tokens = Authenticator(TokenFile(settings.web.tokens), clock)
    if ros_token:
        tokens.grant(ROS, rights_of_ros(settings.ros), ros_token)
    required = authentication_required(settings.web, host)
    agents = McpEndpoint()
    tcps = {name: each.robot.tcp for name, each in settings.each.items()}

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        shared = SharedParts(
            config=config,
            base_url=base_url,
            default_robot=settings.robot.name,
            endpoints=endpoints,
            clock=clock,
            planner=planner,
            sync=SyncService(),
            several=len(robots) > 1,
            tokens=tokens,
            events=Events(clock),
        )
        async with saying_why(app), contextlib.AsyncExitStack() as stack:
            app.state.events = shared.events
            stack.callback(shared.events.close)
            stack.enter_context(log_events(shared.events))
            app.state.audit = Audit(settings.audit_file, clock)
            stack.callback(app.state.audit.close)
            app.state.robots = {
                name: await stack.enter_async_context(serving_robot(each, robots[name], shared))
                for name, each in settings.each.items()
            }
            app.state.services = app.state.robots[settings.robot.name]
            shared.sync.robots.update(app.state.robots)
            stack.callback(shared.sync.close)
            stack.push_async_callback(agents.close)
            if source is not None:
                asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, app.state.reloading.begin)
            app.state.graph = await stack.enter_async_context(serving(app.state.robots, tcps, clock))
            gc.collect()
            gc.freeze()
            gc.enable()  # `app.__main__` had it wait
            for each in app.state.robots.values():
                each.link.watch_for_pauses()
            shared.events.publish("service", what="started", version=version("cobot"), robots=list(robots))
            yield
            for each in app.state.robots.values():
                each.jobs.book.ending = True
            stops = [
                each.stopping.stop(3.0, "stopped by the end of the service")
                for each in app.state.robots.values()
            ]
            await asyncio.gather(*stops)

    app: FastAPI = FastAPIOffline(
        title="cobot",
        version=version("cobot"),
        description=DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,
        openapi_tags=documentation.TAGS,
    )
    limits = {name: robot.limits for name, robot in robots.items()}
    documentation.install(app, partial(openapi.version, limits))
    app.state.endpoints = endpoints | {
        robots_router.twin_name(name): each for name, each in endpoints.items()
    }
    app.state.large_body = asyncio.Lock()
    app.state.rosbridge_connections = 0
    app.state.losses = Losses(None)
    app.state.web = settings.web
    app.state.reloading = Reloading(settings, config, source, app.state)
    app.state.requests = RequestTimes()
    app.add_middleware(Clients)
    app.add_middleware(BodyLimit, all_bytes=settings.web.limits.bodies_bytes)
    app.state.origins = Origins([host, urlsplit(base_url).hostname or host], host, settings.web)
    app.add_middleware(StartFailure)
    app.add_middleware(Access, tokens=tokens, origins=app.state.origins, required=required)
    app.add_middleware(Timing, times=app.state.requests)
    app.add_middleware(RequestTrail)  # The last one is the outermost: what is refused leaves a trail too.
    errors.install(app)
    app.openapi = openapi.with_limits(app.openapi, limits)  # type: ignore[method-assign]
    table = roles(stop_without_token=settings.web.stop_without_token)
    if required:
        app.openapi = openapi.with_tokens(app.openapi, table)  # type: ignore[method-assign]
    if endpoints[f"POST {vendor_http.PATH}"].enabled:

        def services() -> dict[str, Any]:
            return vendor_http.schema(app.openapi(), list(robots))

        documentation.install_vendor(app, openapi.with_tokens(services, table) if required else services)
    # Routes are matched one after the other: those that are polled come first, the documentation's last. Not
    # by include_router, for the nesting it keeps is matched in each request too. Those of these routers are
    # there a second time, below the name of any robot.
    routers = (
        robot_router.router,
        plans.router,
        scene.router,
        tool.router,
        geometry.router,
        control.router,
        trajectory.router,
        jobs.router,
        recordings.router,
        sequences.router,
        events.router,
        common.router,
        stream_router.router,
    )
    plain = [route for router in routers for route in router.routes if _enabled(route, endpoints)]
    more = (
        robots_router.router,
        operations.router,
        audit_router.router,
        vendor_http.router,
        rosbridge_router.router,
    )
    named = [route for router in more for route in router.routes if _enabled(route, endpoints)]
    if settings.mcp.enabled:
        named.append(Route(MCP, agents))
    app.router.routes[:0] = [*plain, *robots_router.twins(plain, list(robots)), *named]
    for route in app.routes:
        if isinstance(route, APIRoute):
            route.operation_id = route.name  # what generated clients call their methods

    pages.install(app)
    guard(app.routes, table)
    return app


def _enabled(route: BaseRoute, endpoints: dict[str, Endpoint]) -> bool:
    """Whether api_endpoints.yaml wants it."""
    if isinstance(route, APIWebSocketRoute):
        return endpoints[f"WS {route.path}"].enabled
    assert isinstance(route, APIRoute)
    (method,) = route.methods or {""}
    return endpoints[f"{method} {route.path}"].enabled
