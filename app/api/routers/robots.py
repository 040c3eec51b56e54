"""The list of robots, and the endpoints whose path contains a robot's name."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from functools import cache
from typing import Any

from fastapi import Request
from fastapi.routing import APIRoute, APIWebSocketRoute
from starlette.routing import BaseRoute, compile_path

from app.api.dependencies import robots_of
from app.api.errors import responses
from app.api.paging import After, Limit, page_of
from app.api.route import EndpointRouter
from app.api.schemas.device import DeviceAnswer
from app.api.schemas.service import RobotAnswer
from app.services.state.link import RobotLink
from cobot.access.roles import Role
from cobot.addresses import ROBOTS, address, path_below

router = EndpointRouter(tags=["robots"])
ANY = f"{ROBOTS}/{{robot}}"
NOT_FOUND = responses(404)


@router.endpoint(f"GET {ROBOTS}", Role.OBSERVER, timeout_s=1.5, responses=responses(422))
async def robots(request: Request, limit: Limit = None, after: After = None) -> list[RobotAnswer]:
    """Return the robots of this service. The first is the default robot, which endpoints without a robot's
    name use.
    """
    found = [
        RobotAnswer(
            name=name,
            model=services.robot.model.name,
            default=index == 0,
            path=address("", name),
            base_frame=services.robot.base_frame,
            joint_names=list(services.robot.limits.names),
            device=device_answer(services.link),
        )
        for index, (name, services) in enumerate(robots_of(request).items())
    ]
    return page_of(found, lambda each: each.name, limit, after)


def device_answer(link: RobotLink) -> DeviceAnswer | None:
    """Describe the device that moves a robot; None while the device cannot be read."""
    device, report = link.device(), link.io()
    return None if device is None else DeviceAnswer.of(*device, report.points if report else ())


def twins(routes: Iterable[BaseRoute], robots: list[str]) -> list[BaseRoute]:
    """Make copies of the endpoints below /robots/{robot}. The same functions serve them.

    Args:
        robots: the valid names, for the documentation.
    """
    name = {
        "name": "robot",
        "in": "path",
        "required": True,
        "description": "The robot's name.",
        "schema": {"type": "string", "enum": robots},
    }
    made: list[BaseRoute] = []
    for route in routes:
        if isinstance(route, APIWebSocketRoute):
            made.append(APIWebSocketRoute(f"{ANY}{path_below(route.path)}", route.endpoint))
        else:
            assert isinstance(route, APIRoute)
            made.append(_twin(route, {"parameters": [name]}))
    return made


def _twin(route: APIRoute, documentation: dict[str, Any]) -> APIRoute:
    """Make the copy of a route whose path contains the robot's name.

    Only the path of the copy differs. If a new route were made, FastAPI would inspect the function again, and
    pydantic would build each model a second time.
    """
    twin = copy(route)
    twin.path = f"{ANY}{path_below(route.path)}"
    twin.path_regex, twin.path_format, twin.param_convertors = compile_path(twin.path)
    twin.name = f"{route.name}_of"
    twin.tags = ["robots"]
    twin.responses = NOT_FOUND | route.responses
    twin.response_fields = _not_found_fields() | route.response_fields
    own = (route.openapi_extra or {}).get("parameters", [])
    twin.openapi_extra = documentation | {"parameters": [*documentation["parameters"], *own]}
    return twin


@cache
def _not_found_fields() -> dict[int | str, Any]:
    """Return the response for an unknown robot, in FastAPI's form."""
    return APIRoute("/", robots, responses=NOT_FOUND).response_fields


def twin_name(endpoint: str) -> str:
    """The name of an endpoint's twin: "POST /robots/{robot}/stop" for "POST /stop"."""
    method, path = endpoint.split(" ")
    return f"{method} {ANY}{path_below(path)}"
