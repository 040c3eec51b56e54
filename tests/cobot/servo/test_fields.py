"""Fields of servo messages. Oracle: Python's json module, and the rules of docs/servo.md by hand."""

from __future__ import annotations

import json
import math
import random
from typing import Any

import pytest

from cobot.servo.fields import MAX_TEXT, BrokenRule, Refusal, as_number, integer, number, parsed, within

SEED = 20261122


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "a message must be JSON"),
        ("[1]", "a message must be a JSON object, got a list of 1"),
        ("3", "a message must be a JSON object, got 3"),
        ("[" * 60_000, "a message must be JSON"),
        ("9" * 5000, "a message must be JSON"),
        (" " * (MAX_TEXT + 1), f"a message may have at most {MAX_TEXT} characters"),
    ],
)
def test_what_is_no_object_is_malformed(text: str, sentence: str) -> None:
    with pytest.raises(BrokenRule) as caught:
        parsed(text)
    assert caught.value.kind is Refusal.MALFORMED
    assert str(caught.value).startswith(sentence)


def _json(text: str) -> object:
    """What it says, or None if it is no JSON."""
    try:
        return json.loads(text)
    except ValueError:
        return None


def test_random_texts_are_read_or_refused() -> None:
    dice = random.Random(SEED)
    for _ in range(5000):
        text = "".join(dice.choice('{}[]",:0123456789.eE-truefalsn \\u') for _ in range(dice.randrange(40)))
        if isinstance(_json(text), dict):
            assert parsed(text) == _json(text)
        else:
            with pytest.raises(BrokenRule) as caught:
                parsed(text)
            assert caught.value.kind is Refusal.MALFORMED, text


@pytest.mark.parametrize(
    ("value", "expected"), [(3, 3), (3.0, 3), (-(2**63) + 1, -(2**63) + 1), (None, None)]
)
def test_integers_are_integers(value: Any, expected: int | None) -> None:
    assert integer({"point_id": value}, "point_id", Refusal.POINT_ID) == expected


@pytest.mark.parametrize("value", [True, 3.5, "3", 2**63, math.inf, math.nan, [3]])
def test_what_is_no_integer_is_refused_with_the_reason_of_its_field(value: Any) -> None:
    with pytest.raises(BrokenRule, match="point_id must be an integer of 64 bits") as caught:
        integer({"point_id": value}, "point_id", Refusal.POINT_ID)
    assert caught.value.kind is Refusal.POINT_ID


def test_numbers_have_defaults_and_bounds() -> None:
    assert number({}, "time", 0.5) == number({"time": None}, "time", 0.5) == 0.5
    assert number({"time": 2}, "time", 0.5) == 2.0
    assert within(1.0, 1.0, "time") == 1.0
    with pytest.raises(BrokenRule, match=r"time must be at most 1 s, got 1\.5"):
        within(1.5, 1.0, "time")
    for value in (True, "1", math.nan, -math.inf, 10**400, [1.0], {}):
        with pytest.raises(BrokenRule, match="time must consist of finite numbers") as caught:
            as_number(value, "time")
        assert caught.value.kind is Refusal.VALUE
        assert len(str(caught.value)) < 200
