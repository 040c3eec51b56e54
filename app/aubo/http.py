"""Vendor services over HTTP. One route serves all services; the documentation lists a path for each of them.

With two hundred routes, each request would be matched against every route in turn. All transports validate
requests with `registry.bind`.
"""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Any

from fastapi import Request
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from starlette.routing import Match
from starlette.types import Scope

from app.api.dependencies import BEGUN_S, LARGE_BYTES, json_body, services_of
from app.api.documentation.openapi import CONTROL, error_components, error_references
from app.api.errors import ErrorAnswer
from app.api.json_text import decoded
from app.api.middleware.access import identity_of
from app.api.middleware.versions import plain_path
from app.api.route import EndpointRouter
from app.aubo.classes import CLASSES, REGISTRY
from app.aubo.fields import REQUIRED, ServiceField
from app.aubo.registry import CallOrigin, VendorService, bind, run, unknown_service
from app.services.clients import CLIENT
from cobot import audit
from cobot.access.roles import Role, require
from cobot.errors import NotFoundError

PATH = "/{robot}/{Class}/{method}"
MOVING = ("MotionControl", "SyncMove", "RuntimeMachine")
"""Classes whose services move the arm. Some of them require control."""
STATUSES = (404, 413, 415, 422)
JSON_TYPES: dict[str, dict[str, Any]] = {
    "bool": {"type": "boolean"},
    "int32": {"type": "integer", "format": "int32", "minimum": -(2**31), "maximum": 2**31 - 1},
    "int64": {"type": "integer", "format": "int64"},
    "float64": {"type": "number", "format": "double"},
    "string": {"type": "string"},
    "json": {"type": "string", "contentMediaType": "application/json"},
}
DESCRIPTION = """The services of the controller's vendor, the same as on ROS 2. Each answers with a `code`; 0
is success, see docs/services.md. Lengths in m, angles in rad. The REST API is on
[a page of its own](/docs)."""
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
POSE = [0.4, 0.0, 0.5, 0.0, 3.1, 0.0]
VIA, END = [0.45, 0.1, 0.55, 0.0, 3.1, 0.0], [0.4, 0.2, 0.55, 0.0, 3.1, 0.0]
AHEAD, TURN, STILL = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0], [0.1, 0.2, 0.3], [0.0] * len(HOME)
EXAMPLES: dict[str, Any] = {
    **dict.fromkeys(("q", "qnear"), HOME),
    **dict.fromkeys(("qd", "qdd", "torques"), STILL),
    **dict.fromkeys(("pose", "p1", "pose_from"), POSE),
    **dict.fromkeys(("p2", "end_pose"), END),
    "via_pose": VIA,
    **dict.fromkeys(("pose_from_to", "offset"), AHEAD),
    **dict.fromkeys(("rpy", "rotv"), TURN),
    "quat": [1.0, 0.0, 0.0, 0.0],
}
"""Values that Swagger fills in for fields with these names. Other fields get their own default, or ROS's
default.
"""


class _VendorRoute(APIRoute):
    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Match only paths whose second segment is a vendor service class."""
        parts = plain_path(scope).split("/")
        return super().matches(scope) if len(parts) == 4 and parts[2] in CLASSES else (Match.NONE, {})


router = EndpointRouter(route_class=_VendorRoute)


@router.endpoint(f"POST {PATH}", Role.OBSERVER, timeout_s=20.0, include_in_schema=False)
async def vendor_service(request: Request) -> JSONResponse:
    """Call a vendor service of the registry."""
    services = services_of(request)
    stops = services.ownership.stops_before(request.scope.get(BEGUN_S))
    robot_class, method = request.path_params["Class"], request.path_params["method"]
    found = REGISTRY.get((robot_class, method))
    if found is None:
        raise NotFoundError(unknown_service(robot_class, method))
    if found.changes:
        audit.would_change()
    require(identity_of(request), found.role)
    bound = bind(found, await _content(request))
    audit.leave_out()  # `run` writes an audit log entry for each change, for all transports
    origin = CallOrigin(f"POST {request.url.path}", stops, CLIENT.get().sequence)
    return JSONResponse(asdict(await run(services, found, bound, origin)))


async def _content(request: Request) -> Any:
    """Decode the body as JSON. An empty body becomes an empty object."""
    body = await request.body()
    if not body:
        return {}
    await json_body(request)
    if len(body) <= LARGE_BYTES:
        return decoded(body, "the body")
    async with request.app.state.large_body:  # in a thread, and one body at a time
        return await asyncio.to_thread(decoded, body, "the body")


def schema(rest: dict[str, Any], robots: list[str]) -> dict[str, Any]:
    """Return the OpenAPI document of the services, grouped by class.

    Args:
        rest: the document of the REST API. The version, the errors and the access rules are copied from it.
        robots: the valid names.
    """
    robot = {
        "name": "robot",
        "in": "path",
        "required": True,
        "description": "The robot's name.",
        "schema": {"type": "string", "enum": robots},
    }
    order = list(CLASSES)
    services = sorted(REGISTRY.values(), key=lambda found: order.index(found.robot_class))
    components = dict(rest.get("components", {}))
    components["schemas"] = {"ErrorAnswer": ErrorAnswer.model_json_schema()}
    components["parameters"] = {"robot": robot, "control": CONTROL}
    components["responses"] = error_components(*STATUSES)
    return {
        **{key: value for key, value in rest.items() if key in ("openapi", "security", "servers")},
        "info": {**rest["info"], "title": "cobot: vendor services", "description": DESCRIPTION},
        "paths": {
            f"/{{robot}}/{found.robot_class}/{found.method}": {"post": _operation(found)}
            for found in services
        },
        "components": components,
        "tags": [{"name": name, "description": text} for name, text in CLASSES.items()],
    }


def _operation(found: VendorService) -> dict[str, Any]:
    fields = {field.name: _schema(field) for field in found.parameters}
    needed = [field.name for field in found.parameters if field.default is REQUIRED]
    body: dict[str, Any] = {"type": "object", "properties": fields, "additionalProperties": False}
    if needed:
        body["required"] = needed
    body["examples"] = [{field.name: _example(field) for field in found.parameters}]
    answer = {
        "type": "object",
        "properties": {
            "code": {"type": "integer", "description": "0 is success, see docs/services.md"},
            "message": {"type": "string", "description": "The error; empty on success."},
            "result": _schema(found.result),
        },
        "required": ["code", "message", "result"],
    }
    parameters = ("robot", "control") if found.robot_class in MOVING else ("robot",)
    return {
        "tags": [found.robot_class],
        "operationId": f"{found.robot_class}_{found.method}",
        "summary": f"{found.method}: {found.doc.partition('. ')[0].rstrip('.')}.",
        "description": found.doc,
        "x-role": found.role.name.lower(),
        "parameters": [{"$ref": f"#/components/parameters/{name}"} for name in parameters],
        "requestBody": {"required": bool(needed), "content": {"application/json": {"schema": body}}},
        "responses": {
            "200": {
                "description": "The service was called; `code` has the result.",
                "content": {"application/json": {"schema": answer}},
            },
            **error_references(*STATUSES),
        },
    }


def _schema(field: ServiceField) -> dict[str, Any]:
    kind: dict[str, Any] = JSON_TYPES[field.kind.removesuffix("[]")]
    schema = {"type": "array", "items": kind} if field.kind.endswith("[]") else kind
    default = {} if field.default is REQUIRED or field.kind == "json" else {"default": field.default}
    return {**schema, "description": field.doc, **default}


def _example(field: ServiceField) -> Any:
    if field.name in EXAMPLES and field.kind == "float64[]":
        return EXAMPLES[field.name]
    return field.empty if field.default is REQUIRED or field.kind == "json" else field.default
