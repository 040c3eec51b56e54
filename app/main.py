"""The web service, put together."""

from __future__ import annotations

import asyncio
import contextlib
import gc
from collections.abc import AsyncIterator
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import RedirectResponse
from fastapi.routing import APIRoute, APIWebSocketRoute
from fastapi_offline import FastAPIOffline
from starlette.routing import BaseRoute

from app import errors
from app.body_limit import BodyLimit
from app.openapi import with_limits
from app.routers import common, sequences, trajectory
from app.routers import robot as robot_router
from app.routers import stream as stream_router
from app.services import Services
from app.services.health import HealthService
from app.services.interventions import reporting
from app.services.link import RobotLink
from app.services.motion import LATEST_ANSWER_S, MotionService
from app.services.ownership import Ownership
from app.services.planning import PlanningService
from app.services.sequences import SequenceService
from app.services.stopping import StopService
from app.services.streams import StreamService
from app.services.trajectories import TrajectoryService
from cobot.config import Endpoint, Settings, load_endpoints
from cobot.robot import Robot, load_robot

DESCRIPTION = """Moves a robot arm. Motions answer when the arm has arrived and settled: look at `success`.
Lengths in m, angles in rad. **This is no safety system and there is no authentication.**"""

SWAGGER = {
    "displayRequestDuration": True,
    "tryItOutEnabled": True,
    "defaultModelsExpandDepth": -1,  # no list of models below the endpoints, which show theirs
}


def create_app(settings: Settings, config: Path | None, base_url: str) -> FastAPI:
    """The application.

    Args:
        config: the settings' file, for the planning processes.
        base_url: where the sequence runner finds this service.

    Raises:
        ConfigError: the configuration is wrong.
    """
    endpoints = load_endpoints(settings.web.endpoints)
    robot = load_robot(settings)

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        link = RobotLink(settings.robot.name, settings.web.stale_after_s)
        planning = PlanningService(config, settings.planning.workers)
        warming = asyncio.create_task(planning.warm_up())
        async with link.heartbeat(), reporting(link):
            app.state.services = _services(settings, endpoints, robot, link, planning, base_url)
            gc.collect()
            gc.freeze()
            yield
            await app.state.services.stopping.stop(timeout_s=3.0)
            app.state.services.streams.close()
        warming.cancel()
        planning.close()
        link.close()

    app: FastAPI = FastAPIOffline(
        title="cobot",
        version=version("cobot"),
        description=DESCRIPTION,
        lifespan=lifespan,
        swagger_ui_parameters=SWAGGER,
    )
    app.state.endpoints = endpoints
    app.state.large_body = asyncio.Lock()
    app.state.stop_on_disconnect = settings.web.stop_on_disconnect
    app.add_middleware(
        BodyLimit, limit_bytes=settings.web.max_body_bytes, json_limit_bytes=settings.web.max_json_bytes
    )
    errors.install(app)
    app.openapi = with_limits(app.openapi, robot.limits)  # type: ignore[method-assign]
    # Routes are matched one after the other: those that are polled come first, the documentation's last. Not
    # by include_router, for the nesting it keeps is matched in each request too.
    routers = (
        robot_router.router,
        trajectory.router,
        sequences.router,
        common.router,
        stream_router.router,
    )
    app.router.routes[:0] = [
        route for router in routers for route in router.routes if _enabled(route, endpoints)
    ]
    for route in app.routes:
        if isinstance(route, APIRoute):
            route.operation_id = route.name  # what generated clients call their methods

    @app.get("/", include_in_schema=False)
    async def root() -> RedirectResponse:
        return RedirectResponse("/docs")

    return app


def _enabled(route: BaseRoute, endpoints: dict[str, Endpoint]) -> bool:
    """Whether api_endpoints.yaml wants it."""
    if isinstance(route, APIWebSocketRoute):
        return endpoints[f"WS {route.path}"].enabled
    assert isinstance(route, APIRoute)
    (method,) = route.methods or {""}
    return endpoints[f"{method} {route.path}"].enabled


def _services(
    settings: Settings,
    endpoints: dict[str, Endpoint],
    robot: Robot,
    link: RobotLink,
    planning: PlanningService,
    base_url: str,
) -> Services:
    ownership = Ownership(link)
    motion = MotionService(robot, link, ownership, planning, settings.planning)
    slowest_s = max(end.timeout_s for name, end in endpoints.items() if name.startswith("POST /robot/move/"))
    sequence = SequenceService(ownership, link, settings.sequences, base_url, slowest_s + LATEST_ANSWER_S)
    streams = StreamService(link, ownership, motion, settings.streaming.command_timeout_s)
    return Services(
        robot,
        link,
        ownership,
        motion,
        TrajectoryService(ownership, motion, settings.planning.start_tolerance_rad),
        sequence,
        StopService(link, ownership, sequence),
        HealthService(settings.robot.name, link, ownership, sequence, streams, settings.web.stale_after_s),
        streams,
    )
