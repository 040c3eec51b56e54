"""Which robots there are, and the endpoints of any of them by its name."""

from __future__ import annotations

from collections.abc import Iterable

from fastapi import APIRouter, Request
from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.routing import BaseRoute

from app.api.dependencies import robots_of
from app.api.errors import responses
from app.api.schemas import RobotAnswer
from cobot.addresses import ROBOTS, address, path_below

router = APIRouter(tags=["robots"])
ANY = f"{ROBOTS}/{{robot}}"


@router.get(ROBOTS)
async def robots(request: Request) -> list[RobotAnswer]:
    """The robots that are served; the first is the one that the endpoints without a name are about."""
    return [
        RobotAnswer(
            name=name,
            default=index == 0,
            path=address("", name),
            base_frame=services.robot.base_frame,
            joint_names=list(services.robot.limits.names),
        )
        for index, (name, services) in enumerate(robots_of(request).items())
    ]


def twins(routes: Iterable[BaseRoute], robots: list[str]) -> list[BaseRoute]:
    """The same endpoints below /robots/{robot}, served by the same functions.

    Args:
        robots: the valid names, for the documentation.
    """
    made = APIRouter(prefix=ANY, tags=["robots"], responses=responses(404))
    name = {
        "name": "robot",
        "in": "path",
        "required": True,
        "description": "The robot's name.",
        "schema": {"type": "string", "enum": robots},
    }
    for route in routes:
        if isinstance(route, APIWebSocketRoute):
            made.add_api_websocket_route(path_below(route.path), route.endpoint)
            continue
        assert isinstance(route, APIRoute)
        made.add_api_route(
            path_below(route.path),
            route.endpoint,
            response_model=route.response_model,
            methods=sorted(route.methods or ()),
            name=f"{route.name}_of",
            responses=route.responses,
            dependencies=route.dependencies,
            route_class_override=type(route),
            openapi_extra={"parameters": [name]},
        )
    return list(made.routes)


def twin_name(endpoint: str) -> str:
    """Of an endpoint as in api_endpoints.yaml, the name of its twin: "POST /robots/{robot}/stop"."""
    method, path = endpoint.split(" ")
    return f"{method} {ANY}{path_below(path)}"
