"""Adds to the OpenAPI schema: the robot's limits, descriptions, and links."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from itertools import zip_longest
from typing import Any

from app.api.documentation.generators import suit_generators
from app.api.documentation.links import link
from app.api.errors import responses
from app.api.strict import describe_strict
from cobot.access.roles import Role
from cobot.addresses import CONTROL_TOKEN, ROBOTS, path_below
from cobot.types import JointLimits

CONTROL: dict[str, Any] = {
    "name": CONTROL_TOKEN,
    "in": "header",
    "required": False,
    "description": "Token from POST /robot/control; needed only while the client has control.",
    "schema": {"type": "string"},
}
"""Header parameter of all endpoints that move the arm. A client that has control sends this header."""
BY_NAME = f"{ROBOTS}/"
JOINT_FIELDS = (("MoveJoints", "joints"), ("TrajectoryPoint", "positions"))


def with_limits(
    openapi: Callable[[], dict[str, Any]], robots: dict[str, JointLimits]
) -> Callable[[], dict[str, Any]]:
    """Return a schema function that includes the number of joints and their position limits.

    The limits in the schema are for documentation and generated clients. `cobot.robot.limits` checks the
    requests, with error messages that name the joint. If the robots differ, the schema permits every value
    that at least one robot permits.

    Args:
        robots: each robot's limits by name.
    """

    def describe() -> dict[str, Any]:
        text, items = _described(robots)
        schema = openapi()
        models = schema.get("components", {}).get("schemas", {})
        for model, field in JOINT_FIELDS:
            if model in models:  # the endpoint may be switched off
                models[model]["properties"][field] |= {
                    "description": f"rad: {text}",
                    "minItems": min(limits.dof for limits in robots.values()),
                    "maxItems": max(limits.dof for limits in robots.values()),
                    "prefixItems": items,
                }
        for path, operations in schema["paths"].items():
            for endpoint in operations.values():
                # more useful than FastAPI's summary, which repeats the path
                summary = first_sentence(endpoint["description"])
                if "409" in endpoint["responses"] and not path.endswith(("/reset", "/reload")):
                    _add(CONTROL, endpoint)
                endpoint["summary"] = f"{summary} For any robot." if path.startswith(BY_NAME) else summary
        suit_generators(schema)
        describe_strict(schema)
        link(schema)
        return schema

    return describe


def first_sentence(description: str) -> str:
    """Return the first sentence of a description, which may be wrapped."""
    paragraph = " ".join(description.partition("\n\n")[0].split())
    return paragraph.partition(". ")[0].rstrip(".") + "."


def version(robots: dict[str, JointLimits]) -> Hashable:
    """Return the version of the result of `with_limits`. A reload that changes the result changes the
    version.
    """
    return tuple((each.min_position.tobytes(), each.max_position.tobytes()) for each in robots.values())


def of_the_default_robot(document: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a document that describes the paths that contain no robot's name."""
    paths = {path: each for path, each in document["paths"].items() if not path.startswith(BY_NAME)}
    return {**document, "paths": paths}


def of_any_robot(document: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a document that describes paths below /robots/NAME. Each path has the tags of the
    same path without a name.
    """
    plain = of_the_default_robot(document)["paths"]
    groups = {f"{BY_NAME}{{robot}}{path_below(path)}": each for path, each in plain.items()}
    paths = {
        path: {method: {**each, "tags": groups[path][method]["tags"]} for method, each in operations.items()}
        for path, operations in document["paths"].items()
        if path.startswith(BY_NAME)
    }
    used = {tag for operations in paths.values() for each in operations.values() for tag in each["tags"]}
    return {
        **document,
        "info": {**document["info"], "title": "cobot: REST API by robot"},
        "paths": paths,
        "tags": [each for each in document["tags"] if each["name"] in used],
    }


Row = tuple[str, float, float]


def _add(parameter: dict[str, Any], endpoint: dict[str, Any]) -> None:
    """Add a parameter, unless the schema already contains it because FastAPI has reused it."""
    parameters = endpoint.setdefault("parameters", [])
    if parameter not in parameters:
        parameters.append(parameter)


def _described(robots: dict[str, JointLimits]) -> tuple[str, list[dict[str, Any]]]:
    """Describe the joints' position limits, as a sentence and as a schema for each joint."""
    each = {name: _table(limits) for name, limits in robots.items()}
    texts = {
        name: ", ".join(f"{joint} {low:g} to {high:g}" for joint, low, high in table)
        for name, table in each.items()
    }
    differ = len(set(texts.values())) > 1
    text = (
        "; ".join(f"{name}: {text}" for name, text in texts.items()) if differ else next(iter(texts.values()))
    )
    items = [
        {
            "type": "number",
            "title": rows[0][0],
            "minimum": min(r[1] for r in rows),
            "maximum": max(r[2] for r in rows),
        }
        for rows in map(_present, zip_longest(*each.values()))
    ]
    return text, items


def _table(limits: JointLimits) -> list[Row]:
    """Create a table with a row for each joint: its name, and its minimum and maximum position, rad."""
    return list(zip(limits.names, limits.min_position.tolist(), limits.max_position.tolist(), strict=True))


def _present(rows: tuple[Row | None, ...]) -> list[Row]:
    """Return the rows of the robots that have this joint."""
    return [row for row in rows if row is not None]


def with_tokens(
    openapi: Callable[[], dict[str, Any]], roles: Mapping[str, Role]
) -> Callable[[], dict[str, Any]]:
    """Return a schema function that states the role that each endpoint needs, so that Swagger asks for a
    token.

    Args:
        roles: role of each endpoint. An endpoint's schema may override it with `x-role`.
    """

    def describe() -> dict[str, Any]:
        schema = openapi()
        components = schema.setdefault("components", {})
        components.setdefault("responses", {}).update(error_components(401, 403))
        for path, operations in schema["paths"].items():
            for method, endpoint in operations.items():
                name = endpoint.get("x-role") or roles[f"{method.upper()} {path}"].name.lower()
                if name == Role.PUBLIC.name.lower() or "security" in endpoint:
                    continue
                endpoint["security"] = [{"token": []}]
                endpoint["description"] += f"\n\nNeeds the role {name}."
                endpoint["responses"] |= error_references(401, 403)
        return schema

    return describe


def error_components(*statuses: int) -> dict[str, Any]:
    """Return the error answers for `components.responses`. Each is listed only once, to keep the document of
    300 endpoints small.
    """
    reference = {"schema": {"$ref": "#/components/schemas/ErrorAnswer"}}
    return {
        f"Error{status}": {"description": each["description"], "content": {"application/json": reference}}
        for status, each in responses(*statuses).items()
    }


def error_references(*statuses: int) -> dict[str, Any]:
    """Return references to the error responses, for an endpoint."""
    return {str(status): {"$ref": f"#/components/responses/Error{status}"} for status in statuses}
