"""The web service, put together."""

from __future__ import annotations

import asyncio
import contextlib
import gc
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import RedirectResponse
from fastapi.routing import APIRoute, APIWebSocketRoute
from fastapi_offline import FastAPIOffline
from starlette.routing import BaseRoute

from app.actions.fjt import FollowJointTrajectory
from app.api import errors
from app.api.body_limit import BodyLimit
from app.api.openapi import with_limits
from app.api.routers import common, sequences, trajectory
from app.api.routers import robot as robot_router
from app.api.routers import robots as robots_router
from app.api.routers import stream as stream_router
from app.aubo import http as vendor_http
from app.offers.robots_on_graph import serving
from app.robot_services import Services
from app.rosbridge import router as rosbridge_router
from app.services.devices.equipment import Equipment
from app.services.motion.execution import LATEST_ANSWER_S, MotionService
from app.services.motion.ownership import Ownership
from app.services.motion.planning import PlanningService
from app.services.motion.queue import MotionQueue
from app.services.motion.speed_override import MAX_PAUSE_S
from app.services.motion.stopping import StopService
from app.services.motion.synchronous import SyncService
from app.services.motion.tool_and_limits import RobotSettings
from app.services.motion.trajectories import TrajectoryService
from app.services.programs.programs import ProgramService
from app.services.programs.sequences import SequenceService
from app.services.state.health import HealthService
from app.services.state.interventions import reporting
from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService
from app.services.streaming.servo import ServoService
from app.services.streaming.sessions import StreamService
from cobot.addresses import address
from cobot.clock import SYSTEM, Clock
from cobot.config import Endpoint, Settings, load_endpoints
from cobot.robot.description import RobotDescription, load_robot

DESCRIPTION = """Moves a robot arm. Motions answer when the arm has arrived and settled: look at `success`.
Lengths in m, angles in rad. **This is no safety system and there is no authentication.**"""

SWAGGER = {
    "displayRequestDuration": True,
    "tryItOutEnabled": True,
    "defaultModelsExpandDepth": -1,  # no list of models below the endpoints, which show theirs
}


Planner = Callable[[Path | None, int, str], PlanningService]


@dataclass(frozen=True, slots=True)
class Outside:
    """What the services of all robots are given from outside; see `create_app`."""

    config: Path | None
    base_url: str
    clock: Clock
    planner: Planner


def create_app(
    settings: Settings,
    config: Path | None,
    base_url: str,
    clock: Clock = SYSTEM,
    planner: Planner = PlanningService,
) -> FastAPI:
    """The application. Long, as it is the list of its parts, in the order in which they need each other.

    Args:
        config: the settings' file, for the planning processes.
        base_url: where the sequence runner finds this service.
        clock: that all services go by.
        planner: makes what a robot plans with, from the settings' file, the number of workers and its name.

    Raises:
        ConfigError: the configuration is wrong.
    """
    endpoints = load_endpoints(settings.web.endpoints)
    robots = {name: load_robot(each) for name, each in settings.each.items()}
    outside = Outside(config, base_url, clock, planner)
    tcps = {name: each.robot.tcp for name, each in settings.each.items()}

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        sync = SyncService()
        async with contextlib.AsyncExitStack() as stack:
            app.state.robots = {
                name: await stack.enter_async_context(
                    _serving(each, endpoints, robots[name], outside, len(robots), sync)
                )
                for name, each in settings.each.items()
            }
            app.state.services = app.state.robots[settings.robot.name]
            sync.robots.update(app.state.robots)
            stack.callback(sync.close)
            app.state.graph = await stack.enter_async_context(serving(app.state.robots, tcps, clock))
            gc.collect()
            gc.freeze()
            yield
            stops = [each.stopping.stop(timeout_s=3.0) for each in app.state.robots.values()]
            await asyncio.gather(*stops)

    app: FastAPI = FastAPIOffline(
        title="cobot",
        version=version("cobot"),
        description=DESCRIPTION,
        lifespan=lifespan,
        swagger_ui_parameters=SWAGGER,
    )
    app.state.endpoints = endpoints | {
        robots_router.twin_name(name): each for name, each in endpoints.items()
    }
    app.state.large_body = asyncio.Lock()
    app.state.rosbridge_connections = 0
    app.state.stop_on_disconnect = settings.web.stop_on_disconnect
    app.add_middleware(
        BodyLimit, limit_bytes=settings.web.max_body_bytes, json_limit_bytes=settings.web.max_json_bytes
    )
    errors.install(app)
    limits = {name: robot.limits for name, robot in robots.items()}
    app.openapi = with_limits(app.openapi, limits)  # type: ignore[method-assign]
    if endpoints[f"POST {vendor_http.PATH}"].enabled:
        app.openapi = vendor_http.with_services(app.openapi, list(robots))  # type: ignore[method-assign]
    # Routes are matched one after the other: those that are polled come first, the documentation's last. Not
    # by include_router, for the nesting it keeps is matched in each request too. Those of these routers are
    # there a second time, below the name of any robot.
    routers = (
        robot_router.router,
        trajectory.router,
        sequences.router,
        common.router,
        stream_router.router,
    )
    plain = [route for router in routers for route in router.routes if _enabled(route, endpoints)]
    more = (robots_router.router, vendor_http.router, rosbridge_router.router)
    named = [route for router in more for route in router.routes if _enabled(route, endpoints)]
    app.router.routes[:0] = [*plain, *robots_router.twins(plain, list(robots)), *named]
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


@contextlib.asynccontextmanager
async def _serving(
    settings: Settings,
    endpoints: dict[str, Endpoint],
    robot: RobotDescription,
    outside: Outside,
    robots: int,
    sync: SyncService,
) -> AsyncIterator[Services]:
    """One robot's services, for as long as the context lasts."""
    label = f"{robot.name}: " if robots > 1 else ""
    link = RobotLink(robot.name, settings.web.stale_after_s, label, outside.clock)
    planning = outside.planner(outside.config, settings.planning.workers, robot.name)
    warming = asyncio.create_task(planning.warm_up())
    async with link.heartbeat(), reporting(link):
        url = address(outside.base_url, robot.name) if robots > 1 else outside.base_url
        services = _services(settings, endpoints, robot, link, planning, url, sync)
        yield services
        services.servo.close()
        services.force.close()
        services.equipment.close()
        services.streams.close()
    warming.cancel()
    planning.close()
    link.close()


def _services(
    settings: Settings,
    endpoints: dict[str, Endpoint],
    robot: RobotDescription,
    link: RobotLink,
    planning: PlanningService,
    base_url: str,
    sync: SyncService,
) -> Services:
    ownership = Ownership(link)
    motion = MotionService(robot, link, ownership, planning, settings.planning)
    slowest_s = max(end.timeout_s for name, end in endpoints.items() if name.startswith("POST /robot/move/"))
    latest_s = slowest_s + LATEST_ANSWER_S + MAX_PAUSE_S
    sequence = SequenceService(ownership, link, settings.sequences, base_url, latest_s)
    streams = StreamService(link, ownership, motion, settings.streaming.command_timeout_s)
    stopping = StopService(link, ownership, sequence)
    equipment = Equipment(link, stopping, ownership.speed_override, simulated=settings.rt.backend == "mujoco")
    vendor_settings = RobotSettings(robot)
    force = ForceService(robot, link, streams, stopping, equipment.traces.warn)
    servo = ServoService(robot, link, streams, force, vendor_settings)
    tolerance_rad = settings.planning.start_tolerance_rad
    return Services(
        robot,
        link,
        ownership,
        motion,
        TrajectoryService(ownership, motion, tolerance_rad, link.label),
        sequence,
        stopping,
        HealthService(settings.robot.name, link, ownership, sequence, streams, settings.web.stale_after_s),
        streams,
        equipment,
        force,
        ProgramService(settings.sequences.programs, ownership, sequence, stopping),
        sync,
        planning,
        vendor_settings,
        MotionQueue(link, ownership, motion, planning, vendor_settings),
        servo,
        FollowJointTrajectory(robot, link, ownership, motion, servo, settings.ros, tolerance_rad),
    )
