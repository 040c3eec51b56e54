"""Changes to FastAPI's OpenAPI document that client generators need."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

BEARER = {"type": "http", "scheme": "bearer", "description": "A token of `cobot token create`."}
MODELS = "#/components/schemas/"
NULL = {"type": "null"}
FORM = "Body_"
"""Prefix of the names that FastAPI gives to the forms of endpoints."""


def suit_generators(schema: dict[str, Any]) -> None:
    """Name the forms, make request fields optional if they have a default, declare the token, and simplify
    nulls.

    TypeScript generators assume that a field with a default is always present. That is true of responses, but
    makes the field required in requests. Request fields therefore state their default only in the
    description.
    """
    schema.setdefault("components", {})["securitySchemes"] = {"token": BEARER}
    schema.setdefault("security", [{}, {"token": []}])
    _name_forms(schema)
    simplify_nulls(schema)
    models = schema["components"].get("schemas", {})
    for name in _of_requests(schema):
        for field in models[name].get("properties", {}).values():
            _describe_default(field)


def simplify_nulls(part: Any) -> None:
    """Rewrite `X or null` as a list of two types, or as `oneOf` for references and enumerations.

    From `anyOf` with null, C# generators make a class that cannot hold a value.
    """
    if isinstance(part, list):
        for value in part:
            simplify_nulls(value)
    elif isinstance(part, dict):
        for value in part.values():
            simplify_nulls(value)
        choices = part.get("anyOf")
        if isinstance(choices, list) and len(choices) == 2 and NULL in choices:
            del part["anyOf"]
            other = next(choice for choice in choices if choice != NULL)
            kind = other.get("type")
            if isinstance(kind, str) and "enum" not in other and not other.keys() & part.keys():
                part |= {**other, "type": [kind, "null"]}
            else:
                part["oneOf"] = choices


def _describe_default(field: dict[str, Any]) -> None:
    if "default" not in field:
        return
    value = field.pop("default")
    if value is not None:
        text = f"Default: {json.dumps(value, ensure_ascii=False)}."
        field["description"] = f"{field.get('description', '')} {text}".strip()


def _of_requests(schema: dict[str, Any]) -> set[str]:
    """List the models that occur in request bodies, directly or nested."""
    models = schema["components"].get("schemas", {})
    bodies = [
        endpoint["requestBody"]
        for operations in schema["paths"].values()
        for endpoint in operations.values()
        if "requestBody" in endpoint
    ]
    found: set[str] = set()
    waiting = list(_references(bodies))
    while waiting:
        name = waiting.pop().removeprefix(MODELS)
        if name not in found and name in models:
            found.add(name)
            waiting += _references(models[name])
    return found


def _references(part: Any) -> Iterator[str]:
    if isinstance(part, dict):
        if isinstance(part.get("$ref"), str):
            yield part["$ref"]
        for value in part.values():
            yield from _references(value)
    elif isinstance(part, list):
        for value in part:
            yield from _references(value)


def _name_forms(schema: dict[str, Any]) -> None:
    """Name each form after its operation, for example SendCsvForm."""
    models = schema["components"].get("schemas", {})
    for path, operations in schema["paths"].items():
        for endpoint in operations.values():
            content = endpoint.get("requestBody", {}).get("content", {}).get("multipart/form-data")
            old = content["schema"].get("$ref", "").removeprefix(MODELS) if content else ""
            if not old.startswith(FORM):
                continue
            # The path with a robot's name has a copy of the endpoint, with the same form.
            operation = (
                endpoint["operationId"].removesuffix("_of")
                if path.startswith("/robots/")
                else (endpoint["operationId"])
            )
            new = "".join(word.capitalize() for word in operation.split("_")) + "Form"
            if old in models:
                models[new] = models.pop(old) | {"title": new}
            content["schema"]["$ref"] = MODELS + new
