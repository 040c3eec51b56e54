"""The robot's own numbers, and sentences, in the OpenAPI schema."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cobot.types import JointLimits

JOINT_FIELDS = (("MoveJoints", "joints"), ("TrajectoryPoint", "positions"))


def with_limits(openapi: Callable[[], dict[str, Any]], limits: JointLimits) -> Callable[[], dict[str, Any]]:
    """A schema function that knows how many joints there are and how far each may go.

    For documentation and generated clients: requests are checked by `cobot.limits`, whose sentences
    name the joint.
    """
    rows = list(zip(limits.names, limits.min_position.tolist(), limits.max_position.tolist(), strict=True))
    table = ", ".join(f"{name} {low:g} to {high:g}" for name, low, high in rows)
    items = [{"type": "number", "title": name, "minimum": low, "maximum": high} for name, low, high in rows]

    def described() -> dict[str, Any]:
        schema = openapi()
        models = schema.get("components", {}).get("schemas", {})
        for model, field in JOINT_FIELDS:
            if model in models:  # the endpoint may be switched off
                models[model]["properties"][field] |= {
                    "description": f"rad: {table}",
                    "minItems": limits.dof,
                    "maxItems": limits.dof,
                    "prefixItems": items,
                }
        for endpoint in (operation for path in schema["paths"].values() for operation in path.values()):
            endpoint["summary"] = endpoint["description"].partition("\n")[0]  # says more than the path again
        return schema

    return described
