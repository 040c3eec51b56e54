"""Strict statuses: on request, the answer to a motion that did not reach its goal has an HTTP error status.

By default the answer to a motion that could not be planned or did not reach its goal has the status 200 and
`success: false`. With `Prefer: status=strict` (RFC 7240) or `?strict=true` the same body is sent with the
HTTP status of the error.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any
from urllib.parse import parse_qs

from fastapi import Response
from pydantic import BaseModel
from starlette.requests import Request

from app.api.errors import DESCRIPTIONS, status_of
from cobot.addresses import PREFER, STRICT_STATUS
from cobot.errors import BY_CODE, InputError, UnavailableError
from cobot.strict import shown

APPLIED = "Preference-Applied"
FLAGS = {"true": True, "1": True, "false": False, "0": False}
"""Values of the query parameter `strict`."""
STATUSES = (409, 422, 500, 502, 503, 504)
"""Statuses that strict answers with `success: false` can have."""
_QUOTED = r'"(?:[^"\\]|\\.)*"'
_PREFERENCE = re.compile(
    rf"""([^\s=;,"]+)\s*(?:=\s*({_QUOTED}|[^\s;,"]*))?(?:\s*;[^,"]*(?:{_QUOTED}[^,"]*)*)?"""
)
"""A preference of RFC 7240: its name, its value, and parameters. The preferences of this service have no
parameters.
"""
PARAMETERS: list[dict[str, Any]] = [
    {
        "name": PREFER,
        "in": "header",
        "required": False,
        "description": f"`{STRICT_STATUS}`: an answer with `success: false` has the status of its error.",
        "schema": {"type": "string"},
        "example": STRICT_STATUS,
    },
    {
        "name": "strict",
        "in": "query",
        "required": False,
        "description": f"true: the same as the header `{PREFER}: {STRICT_STATUS}`.",
        "schema": {"type": "boolean", "default": False},
    },
]


def reports_success(model: object) -> bool:
    """Whether answers of this type can have `success: false`."""
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        return False
    field = model.model_fields.get("success")
    return field is not None and field.annotation is bool


def preference(headers: Iterable[str], name: str) -> str | None:
    """Return the value of a preference in the `Prefer` headers of a request. If it occurs several times, the
    first one is used.
    """
    for header in headers:
        for found in _PREFERENCE.finditer(header):
            if found[1].lower() == name:
                return re.sub(r"\\(.)", r"\1", (found[2] or "").strip('"'))
    return None


def is_strict(request: Request) -> bool:
    """Whether the client asks for strict statuses. The query parameter overrides the header.

    Raises:
        InputError: the query parameter is neither true nor false.
    """
    asked = parse_qs(request.url.query, keep_blank_values=True).get("strict")
    if asked is not None:
        if asked[-1].lower() not in FLAGS:
            raise InputError(f"strict is {shown(asked[-1])}, allowed: true and false")
        return FLAGS[asked[-1].lower()]
    name, _, value = STRICT_STATUS.partition("=")
    found = preference(request.headers.getlist(PREFER), name)
    return found is not None and found.lower() == value


def with_strict_status(response: Response) -> Response:
    """Return the response. If it reports an error, its status becomes the HTTP status of this error."""
    response.headers[APPLIED] = STRICT_STATUS
    if response.status_code == 200:
        answer = json.loads(bytes(response.body))
        if not answer["success"]:
            kind = BY_CODE.get(answer.get("code") or "", UnavailableError)  # the error of a stop has no code
            response.status_code = status_of(kind())
    return response


def describe_strict(schema: dict[str, Any]) -> None:
    """Add the parameters and the answers to an OpenAPI document, for all operations that report `success`."""
    models = schema.get("components", {}).get("schemas", {})
    for operations in schema["paths"].values():
        for endpoint in operations.values():
            answer = _reference(endpoint["responses"].get("200", {}))
            success = _property(models, answer, "success")
            parameters = endpoint.setdefault("parameters", [])
            if (
                success.get("type") == "boolean"
                and "const" not in success
                and PARAMETERS[0] not in parameters
            ):
                parameters += PARAMETERS
                _add_answers(endpoint["responses"], answer)


def _reference(response: Mapping[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = response.get("content", {}).get("application/json", {}).get("schema", {})
    return found


def _property(models: Mapping[str, Any], answer: Mapping[str, Any], name: str) -> dict[str, Any]:
    model = models.get(answer.get("$ref", "").rpartition("/")[2], {})
    found: dict[str, Any] = model.get("properties", {}).get(name, {})
    return found


def _add_answers(responses: dict[str, Any], answer: dict[str, Any]) -> None:
    for status in STATUSES:
        known = responses.get(str(status))
        schema = {"anyOf": [_reference(known), answer]} if known else answer
        responses[str(status)] = {
            **(known or {"description": f"With {PREFER}: {STRICT_STATUS}. {DESCRIPTIONS[status]}"}),
            "content": {"application/json": {"schema": schema}},
        }
    responses.update(sorted(responses.items()))
