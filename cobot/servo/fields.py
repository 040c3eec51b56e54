"""Reads the fields of a servo message from JSON. If a field is rejected, the error gives a reason and a
sentence.
"""

from __future__ import annotations

import json
from enum import StrEnum
from math import isfinite
from typing import Any

MAX_TEXT = 65536
MAX_INTEGER = 2**63 - 1


class Refusal(StrEnum):
    """The reason why a message was dropped. The feedback contains these values."""

    MALFORMED = "malformed"  # not a JSON object, or too long
    TYPE = "type"  # an unknown `type`
    COMMAND = "command"  # an unknown `command`
    MODE = "mode"  # the mode does not exist
    VALUE = "value"  # a field of the wrong kind, not finite, or out of its range
    NOT_ACTIVE = "not_active"  # a point was sent without a session
    NO_POINT_ID = "no_point_id"
    POINT_ID = "point_id"  # not greater than the id of the last accepted point
    SESSION_ID = "session_id"  # not the id to which the session is locked
    POINT_TYPE = "point_type"
    DIMENSION = "dimension"  # wrong number of values in the position
    LIMIT = "limit"  # a joint is beyond its position limits
    INVERSE_KINEMATICS = "inverse_kinematics"  # no solution that continues the motion
    OVERRUN = "overrun"  # the buffer is full
    REJECTED = "rejected"  # the session could not start: another client moves the arm, e-stop, ...


class BrokenRule(Exception):
    """The error for a rejected message. It contains the kind of the rejection and an explanatory sentence."""

    def __init__(self, kind: Refusal, sentence: str) -> None:
        super().__init__(sentence)
        self.kind = kind


def parsed(text: str) -> dict[str, Any]:
    """The fields of a JSON object."""
    if len(text) > MAX_TEXT:
        raise BrokenRule(
            Refusal.MALFORMED, f"a message may have at most {MAX_TEXT} characters, got {len(text)}"
        )
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError) as exc:  # an integer of thousands of digits is a ValueError too
        raise BrokenRule(Refusal.MALFORMED, f"a message must be JSON: {str(exc)[:100]}") from None
    if not isinstance(fields, dict):
        raise BrokenRule(Refusal.MALFORMED, f"a message must be a JSON object, got {shown(fields)}")
    return fields


def integer(fields: dict[str, Any], name: str, kind: Refusal) -> int | None:
    """The value of an integer field; None if it is missing. 1.0 is an integer, true is not."""
    value = fields.get(name)
    if value is None:
        return None
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if type(value) is not int or abs(value) > MAX_INTEGER:
        raise BrokenRule(kind, f"{name} must be an integer of 64 bits, got {shown(value)}")
    return value


def number(fields: dict[str, Any], name: str, default: float) -> float:
    """The value of a number field; the default if it is missing."""
    value = fields.get(name)
    return default if value is None else as_number(value, name)


def as_number(value: object, name: str) -> float:
    """Check that a value is a finite number. true is not a number."""
    if type(value) is float and isfinite(value):
        return value
    if type(value) is int and abs(value) <= MAX_INTEGER:
        return float(value)
    raise BrokenRule(Refusal.VALUE, f"{name} must consist of finite numbers, got {shown(value)}")


def within(value: float, longest: float, name: str) -> float:
    """Check a duration in seconds. It is rejected if it exceeds the limit."""
    if value > longest:
        raise BrokenRule(Refusal.VALUE, f"{name} must be at most {longest:g} s, got {value:g}")
    return value


def shown(value: object) -> str:
    """A short readable text for a value of any size."""
    if isinstance(value, list | dict):
        return f"{'a list' if isinstance(value, list) else 'an object'} of {len(value)}"
    if isinstance(value, int) and abs(value) > MAX_INTEGER:
        return "a huge integer"
    return repr(value)[:60]
