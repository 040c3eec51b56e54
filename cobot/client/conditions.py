"""Conditions on inputs: `{"input": NAME, "is": true}`, or with `above` or `below` and a number."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from cobot.errors import InputError, NotFoundError

TESTS = ("is", "above", "below")
FORM = 'a condition is {"input": NAME, "is": true or false}, or has "above" or "below" with a number for "is"'


def require_condition(condition: Mapping[str, Any]) -> None:
    """Check that a condition has a valid form.

    Raises:
        InputError: the form is invalid.
    """
    if not isinstance(condition, Mapping):
        raise InputError(f"{FORM}; got {json.dumps(condition, default=repr)[:80]}")
    given = [name for name in TESTS if condition.get(name) is not None]
    name = condition.get("input")
    if not isinstance(name, str) or not name or condition.keys() - {"input", *TESTS} or len(given) != 1:
        raise InputError(f"{FORM}; got {json.dumps(dict(condition), default=repr)[:80]}")
    value = condition[given[0]]
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not (isinstance(value, bool) if given[0] == "is" else is_number):
        wanted = "true or false" if given[0] == "is" else "a number"
        raise InputError(f"{given[0]} is {json.dumps(value, default=repr)[:80]}; it must be {wanted}")


def describe(condition: Mapping[str, Any]) -> str:
    """A condition as text: `part_there is true`, `pressure is below 0.2`."""
    name = condition["input"]
    if condition.get("is") is not None:
        return f"{name} is {json.dumps(condition['is'])}"
    test = "above" if condition.get("above") is not None else "below"
    return f"{name} is {test} {condition[test]:g}"


def find_input(points: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any]:
    """The input with this name in the answer to `GET /robot/io`.

    Raises:
        NotFoundError: the input does not exist. The message lists the inputs that exist.
        InputError: the name belongs to an output.
    """
    point = next((each for each in points if each["name"] == name), None)
    if point is None:
        names = ", ".join(each["name"] for each in points if each["direction"] == "input") or "none"
        raise NotFoundError(f"there is no input {name!r}; the inputs are: {names}")
    if point["direction"] != "input":
        raise InputError(f"{name} is an output; a condition needs an input")
    return point


def holds(condition: Mapping[str, Any], points: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a condition holds for the points in the answer to `GET /robot/io`. No condition holds for an
    unknown value.

    Raises:
        NotFoundError, InputError: see `find_input`. Also if the kind of the input does not match the
            condition.
    """
    point = find_input(points, condition["input"])
    boolean, value = point["kind"] == "boolean", point["value"]
    if boolean != (condition.get("is") is not None):
        valid = '"is" with true or false' if boolean else '"above" or "below" with a number'
        raise InputError(f"{point['name']} is {point['kind']}: its condition needs {valid}")
    if value is None:
        return False
    if boolean:
        return bool(value == condition["is"])
    if condition.get("above") is not None:
        return bool(value > condition["above"])
    return bool(value < condition["below"])
