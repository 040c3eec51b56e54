"""The vendor services' fields: their types in Python, ROS and JSON, and the validation of requests."""

from __future__ import annotations

import inspect
import json
import math
from dataclasses import dataclass
from typing import Annotated, Any

from cobot.errors import InputError
from cobot.strict import shown, without_repetition

Json = Annotated[Any, "json"]
Int64 = Annotated[int, "int64"]

ROS_TYPES: dict[Any, str] = {
    bool: "bool",
    int: "int32",
    Int64: "int64",
    float: "float64",
    str: "string",
    Json: "json",
    list[bool]: "bool[]",
    list[int]: "int32[]",
    list[float]: "float64[]",
    list[str]: "string[]",
    None: "int32",
}
"""The ROS type of each annotation. The type json is a string in messages; see `ServiceField.ros_type`."""
EMPTY: dict[str, Any] = {"bool": False, "int32": 0, "int64": 0, "float64": 0.0, "string": "", "json": ""}
"""The value of an unset field, the same as in ROS. An unset list is empty."""
MAX_INTEGER = {"int32": 2**31 - 1, "int64": 2**63 - 1}
REQUIRED: Any = inspect.Parameter.empty
MAX_ITEMS = 65_536
"""Maximum number of items in a list. The event loop checks each item, which delays motions."""


@dataclass(frozen=True, slots=True)
class ServiceField:
    """A field of a request, or the field with the result.

    Attributes:
        kind: one of the values of `ROS_TYPES`.
        doc: description, with the unit.
        default: default from the function's signature, or `REQUIRED`.
    """

    name: str
    kind: str
    doc: str
    default: Any = REQUIRED

    @property
    def ros_type(self) -> str:
        """The type as it is written in a .srv file."""
        return "string" if self.kind == "json" else self.kind

    @property
    def empty(self) -> Any:
        """The field's default value in ROS."""
        return [] if self.kind.endswith("[]") else EMPTY[self.kind]


def argument(field: ServiceField, arguments: dict[str, Any]) -> Any:
    """Validate the argument for a field. ROS's default value is replaced with the field's own default.

    Raises:
        InputError: the value is invalid. The error has the field, the problem and the valid values.
    """
    value = _with_brackets(field, arguments.get(field.name, field.empty))
    checked = _list(field, value) if field.kind.endswith("[]") else _scalar(field.kind, field.name, value)
    if field.default is not REQUIRED and checked == field.empty:
        return list(field.default) if isinstance(field.default, list | tuple) else field.default
    if field.kind == "json":
        return _parsed(field.name, str(checked))
    return checked


def _with_brackets(field: ServiceField, value: Any) -> Any:
    """Convert a value as `cobot.loose_lists` does: a single item becomes a list with one item, and an empty
    list means that the field is not set.
    """
    if field.kind.endswith("[]"):
        item = {"bool[]": (bool,), "string[]": (str,)}.get(field.kind, (int, float))
        return [value] if type(value) in item else value
    return field.empty if value == [] else value


def _list(field: ServiceField, value: Any) -> list[Any]:
    if not isinstance(value, list | tuple):
        raise InputError(f"{field.name}: must be a list, got {shown(value)}")
    if len(value) > MAX_ITEMS:
        raise InputError(f"{field.name}: may have up to {MAX_ITEMS} items, got {len(value)}")
    kind = field.kind.removesuffix("[]")
    return [_scalar(kind, f"{field.name}[{index}]", item) for index, item in enumerate(value)]


def _scalar(kind: str, place: str, value: Any) -> Any:
    match kind, value:
        case "bool", bool():
            return value
        case "int32" | "int64", int() if not isinstance(value, bool):
            if not -MAX_INTEGER[kind] - 1 <= value <= MAX_INTEGER[kind]:
                raise InputError(f"{place}: does not fit into {kind}, got {shown(value)}")
            return value
        case "float64", int() | float() if not isinstance(value, bool):
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
            if not math.isfinite(number):
                raise InputError(f"{place}: must be finite, got {shown(value)}")
            return number
        case "string" | "json", str():
            if not value.isascii():
                _require_unicode(place, value)
            return value
    words = {"bool": "true or false", "float64": "a number", "string": "a string", "json": "a string of JSON"}
    raise InputError(f"{place}: must be {words.get(kind, 'an integer')}, got {shown(value)}")


def _require_unicode(place: str, text: str) -> None:
    """Reject text with unpaired surrogates. JSON input can contain them, but answers cannot."""
    try:
        text.encode()
    except UnicodeEncodeError as exc:
        raise InputError(f"{place}: is not valid Unicode: {exc.reason}") from exc


def _parsed(name: str, text: str) -> Any:
    try:
        return json.loads(text, object_pairs_hook=without_repetition)
    except (ValueError, RecursionError) as exc:
        raise InputError(f"{name}: is not valid JSON: {exc}") from exc
