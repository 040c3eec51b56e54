"""Fields of vendor services. Oracle: the ranges of ROS's types by struct, and Python's json."""

from __future__ import annotations

import json
import math
import random
import struct
from typing import Any

import pytest

from app.aubo.fields import MAX_ITEMS, ServiceField, argument
from cobot.errors import InputError

SEED = 20261122


def fits(format_: str, value: int) -> bool:
    try:
        struct.pack(format_, value)
    except struct.error:
        return False
    return True


@pytest.mark.parametrize(("kind", "format_"), [("int32", "<i"), ("int64", "<q")])
def test_an_integer_is_taken_if_it_fits_into_its_type(kind: str, format_: str) -> None:
    dice = random.Random(SEED)
    for bits in range(70):
        for value in (2**bits - 1, 2**bits, -(2**bits), -(2**bits) - 1, dice.randrange(2**70) >> bits):
            if fits(format_, value):
                assert argument(ServiceField("n", kind, ""), {"n": value}) == value
            else:
                with pytest.raises(InputError, match=f"n: does not fit into {kind}"):
                    argument(ServiceField("n", kind, ""), {"n": value})


@pytest.mark.parametrize(
    ("kind", "value", "sentence"),
    [
        ("bool", 1, "it: must be true or false, got 1"),
        ("int32", True, "it: must be an integer, got true"),
        ("int32", 1.0, "it: must be an integer, got 1.0"),
        ("float64", False, "it: must be a number, got false"),
        ("float64", math.nan, "it: must be finite, got NaN"),
        ("float64", 10**400, "it: must be finite"),
        ("string", None, "it: must be a string, got null"),
        ("string", "\ud800", "it: is not valid Unicode"),
        ("json", "{", "it: is not valid JSON"),
        ("json", '{"a": 1, "a": 2}', "it: is not valid JSON: the key 'a' occurs twice"),
        ("json", "[" * 100_000, "it: is not valid JSON"),
        ("float64[]", None, "it: must be a list, got null"),
        ("float64[]", [1.0, "x"], "it[1]: must be a number, got 'x'"),
        ("float64[]", [0.0] * (MAX_ITEMS + 1), f"it: may have up to {MAX_ITEMS} items"),
    ],
)
def test_what_is_of_another_kind_is_refused_with_its_place(kind: str, value: Any, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        argument(ServiceField("it", kind, ""), {"it": value})
    assert str(caught.value).startswith(sentence)


def test_what_ros_sends_for_nothing_is_the_default() -> None:
    speed = ServiceField("v", "float64", "", 0.25)
    assert argument(speed, {}) == argument(speed, {"v": 0.0}) == 0.25
    assert argument(speed, {"v": 0.5}) == 0.5
    assert argument(ServiceField("v", "float64", ""), {}) == 0.0
    frame = ServiceField("f", "float64[]", "", [1.0, 2.0])
    first = argument(frame, {"f": []})
    first.append(3.0)  # a list of one's own
    assert argument(frame, {}) == [1.0, 2.0]


def test_json_is_a_string_on_the_wire_and_data_in_here() -> None:
    field = ServiceField("it", "json", "")
    assert field.ros_type == "string"
    for value in ({"a": [1, None, "é"]}, [], 3.5, None):
        assert argument(field, {"it": json.dumps(value)}) == value
