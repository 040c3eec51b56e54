"""Strict reading of YAML and JSON documents from users, with errors that help to correct them."""

from __future__ import annotations

import difflib
import json
import math
import re
import reprlib
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator
from pydantic.fields import FieldInfo

SHOWN_CHARACTERS = 80
LONG_CHARACTERS = 40
"""If a string is longer than this, an error gives its length, because people cannot see the length at a
glance.
"""
SHOWN_ERRORS = 10


class _Brief(reprlib.Repr):
    """Formats values as JSON. Long lists are cut before formatting."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlist = self.maxdict = SHOWN_CHARACTERS
        self.maxstring = self.maxother = 2 * SHOWN_CHARACTERS

    def repr1(self, x: Any, level: int) -> str:
        if x is None or isinstance(x, bool) or (isinstance(x, float) and not math.isfinite(x)):
            return json.dumps(x)
        return super().repr1(x, level)


_BRIEF = _Brief()
MUST_BE = {
    "bool_type": "true or false",
    "dataclass_type": "an object",
    "dict_type": "an object",
    "float_type": "a number",
    "int_from_float": "an integer",
    "int_type": "an integer",
    "list_type": "a list",
    "model_attributes_type": "an object",
    "model_type": "an object",
    "none_required": "null",
    "string_type": "a string",
    "tuple_type": "a list",
}
"""JSON name of the expected type, by pydantic's error type."""
LENGTHS = {"too_short": ("min_length", "at least"), "too_long": ("max_length", "at most")}
"""For the length of a list or an object, the name of the violated bound and the text for it, by pydantic's
error type.
"""


BOUNDS = {"less_than": "lt", "less_than_equal": "le"}
"""The name of the upper bound that was exceeded, by pydantic's error type."""
QUOTE = "'"
IN_METRES = {
    *("blend_radius", "depth", "drop", "length", "max_travel", "pitch", "radii", "radius", "retract"),
    *("rise", "size", "through_radius", "tolerance", "width"),
}
"""Fields in metres whose names do not contain the unit."""


class StrictModel(BaseModel):
    """A model that converts no types and rejects unknown keys."""

    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown(cls, content: Any) -> Any:
        """Reject unknown keys with a list of the valid ones, because pydantic's own error contains no such
        list.
        """
        if isinstance(content, dict):
            valid = keys_of(cls)
            for key in content:
                if key not in valid:
                    raise ValueError(unknown_key(str(key), list(valid)))
        return content


@cache
def keys_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """A model's fields by their names in the document. These may be aliases: `is` for the field `is_`."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def unknown_key(name: str, valid: list[str], what: str = "key") -> str:
    """The message for an unknown key or other unknown name. It suggests a similar name and lists the valid
    names.
    """
    guess = difflib.get_close_matches(name, valid, 1) if len(name) <= SHOWN_CHARACTERS else []
    hint = f" (did you mean {guess[0]!r}?)" if guess else ""
    return f"unknown {what} {shown(name)}{hint}; valid {what}s: {', '.join(valid)}"


def sentence(error: Mapping[str, Any], *, ignored: tuple[str, ...] = ()) -> str:
    """One of pydantic's errors in the form `place: problem, got value`.

    Args:
        ignored: parts of the location that mean nothing to the author of the document.
    """
    place = ""
    for part in error["loc"]:
        if part not in ignored:
            place += f"[{part}]" if isinstance(part, int) else f".{_key(part)}" if place else _key(part)
    match error["type"]:
        case "missing":
            return f"{place}: is missing"
        case "value_error":
            text = str(error["ctx"]["error"])
        case "union_tag_invalid":
            about = error["ctx"]
            text = f"{about['discriminator'].strip(QUOTE)} {shown(about['tag'])} is unknown; valid values: "
            text += about["expected_tags"]
        case kind:
            text = f"{_requirement(kind, error)}, got {shown(error['input'])}"
            if kind in BOUNDS:
                text += unit_advice(place, error["input"], error["ctx"][BOUNDS[kind]])
            if isinstance(error["input"], str) and len(error["input"]) > LONG_CHARACTERS:
                text += f" ({len(error['input'])} characters)"
    return f"{place}: {text}" if place else text


def unit_advice(place: str, value: object, limit: float) -> str:
    """A hint to append to an error, if a value above its limit looks like milliseconds or millimetres.

    Args:
        place: location of the field, whose name contains the unit.
        value: the number, which may also be text.

    Returns:
        The hint; "" for any other value.
    """
    name = re.sub(r"(\[\d+\])+$", "", place).rpartition(".")[2]
    try:
        found = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return ""
    right = found / 1000
    if name.endswith("_s") and not name.endswith(("_m_s", "_rad_s")) and found >= 1000 and right <= limit:
        return f"; this looks like milliseconds: {found:g} ms are {right:g} s"
    if (name.endswith("_m") or name in IN_METRES) and found >= 5 * limit and right <= limit:
        return f"; this looks like millimetres: {found:g} mm are {right:g} m"
    return ""


def _requirement(kind: str, error: Mapping[str, Any]) -> str:
    if kind in MUST_BE:
        return f"must be {MUST_BE[kind]}"
    if kind in LENGTHS:
        bound, words = LENGTHS[kind]
        length = error["ctx"][bound]
        return f"must have {words} {length} {'item' if length == 1 else 'items'}"
    plain = str(error["msg"]).replace("Input should be", "must be", 1)
    return f"{plain[:1].lower()}{plain[1:]}"


def _key(name: str) -> str:
    """A key in a form that is suitable for messages. A key from a client may be long or contain control
    characters. Such a key is shortened and quoted.
    """
    return name if len(name) <= SHOWN_CHARACTERS and name.isprintable() else shown(name)


def sentences(errors: Sequence[Mapping[str, Any]], *, ignored: tuple[str, ...] = ()) -> str:
    """The first of pydantic's errors, and the number of further errors."""
    each = dict.fromkeys(sentence(error, ignored=ignored) for error in errors[:SHOWN_ERRORS])
    more = [f"and {len(errors) - SHOWN_ERRORS} more"] if len(errors) > SHOWN_ERRORS else []
    return "; ".join([*each, *more])


def without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object as a dict, for `json.loads(object_pairs_hook=...)`. A key that occurs twice is rejected,
    because `json` would use its last value.

    Raises:
        ValueError: a key occurs twice. The target of the arm must not depend on which of them is used.
    """
    content = dict(pairs)
    if len(content) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        twice = next(name for name, count in counts.items() if count > 1)
        raise ValueError(f"the key {shown(twice)} occurs twice in one object")
    return content


def shown(value: object) -> str:
    """A value for an error message. A long value is cut to a readable length."""
    text = repr(value) if isinstance(value, str) else _BRIEF.repr(value)
    return text if len(text) <= SHOWN_CHARACTERS else text[:SHOWN_CHARACTERS] + "..."
