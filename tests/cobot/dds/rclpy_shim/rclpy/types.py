"""Python classes for ROS types, as rosidl makes them: fields are attributes, lists of numbers array.array."""

from __future__ import annotations

import array
from typing import Any

from app.aubo.interfaces import interface_definitions
from cobot.ros.messages import Messages

_CODES = {"float64": "d", "float32": "f", "int32": "i", "int64": "q"}


MESSAGES = Messages({name: text for name, text in interface_definitions().items() if "/srv/" in name})


class Message:
    """A message; its type is `TYPE`."""

    TYPE = ""

    def __init__(self, **values: Any) -> None:
        kinds = {name: kind for name, kind, length in MESSAGES.fields(self.TYPE) if length == 0}
        for name, default in MESSAGES.default(self.TYPE).items():
            value = values.get(name, default)
            code = _CODES.get(kinds.get(name, ""))
            setattr(self, name, array.array(code, value) if code else value)

    def to_dict(self) -> dict[str, Any]:
        return {
            name: list(value) if isinstance(value, array.array) else value
            for name, value in vars(self).items()
        }


def message(name: str) -> type[Message]:
    return type(name.split("/")[-1], (Message,), {"TYPE": name})


def service(name: str) -> type:
    parts = {part: message(f"{name}_{part}") for part in ("Request", "Response")}
    return type(name.split("/")[-1], (), {"TYPE": name, **parts})
