"""The state block as JSON, for both `GET /robot/state` and the `state` frames of the WebSocket."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from fastapi import Response
from pydantic import BaseModel, Field, create_model
from pydantic.config import JsonDict
from pydantic_core import to_json

from cobot.ipc.layout import text
from cobot.ipc.state_fields import STATE_FIELDS, StateField

_MEMBERS = {field.name: field.member for field in STATE_FIELDS if field.member}
_KEYS = {field.name: [key.name.lower() for key in field.keys] for field in STATE_FIELDS if field.keys}
_TEXTS = [field.name for field in STATE_FIELDS if field.is_text]


def state_content(state: np.ndarray) -> dict[str, Any]:
    """Convert a record of `cobot.ipc.state_fields.state_dtype` to a JSON-like dictionary. Numbers may be
    infinite or NaN.
    """
    content = {name: state[name].tolist() for name in state.dtype.names or ()}
    for name, member in _MEMBERS.items():
        content[name] = member(content[name]).name
    for name, keys in _KEYS.items():
        content[name] = dict(zip(keys, content[name], strict=True))
    for name in _TEXTS:
        content[name] = text(content[name])
    return content


def state_response(state: np.ndarray) -> Response:
    """The answer to `GET /robot/state`, which the schema describes as `StateAnswer`.

    It is generated from a table and polled by clients, so it is not validated at run time. A test validates
    it.
    """
    return Response(to_json(state_content(state), inf_nan_mode="null"), media_type="application/json")


def _json_type(field: StateField) -> Any:
    """Return the type of a field in the schema."""
    if field.member:
        return Literal[tuple(member.name for member in field.member)]
    if field.is_text:
        return str
    number: Any = float | None if field.kind == "f8" else int
    if field.keys:
        return dict[Literal[tuple(_KEYS[field.name])], number]  # type: ignore[misc]
    return list.__class_getitem__(number) if field.length else number


def _description(field: StateField) -> str:
    """Describe a field: its meaning, its unit, and the topic that contains it in a recording."""
    unit = f" Unit: {field.unit}." if field.unit else ""
    topic = f" Recorded in {field.topic}." if field.message else " Recorded." if field.recorded else ""
    return f"{field.meaning}.{unit}{topic}"


def _model() -> type[BaseModel]:
    fields: dict[str, Any] = {}
    for field in STATE_FIELDS:
        unit: JsonDict | None = {"unit": field.unit} if field.unit else None
        described = Field(description=_description(field), json_schema_extra=unit)
        fields[field.name] = (_json_type(field), described)
    return create_model(
        "StateAnswer", __doc__="The complete state of a robot that rtloop publishes in each cycle.", **fields
    )


StateAnswer = _model()
