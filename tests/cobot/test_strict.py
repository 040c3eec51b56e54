"""Sentences about what others have written. Oracle: the sentences as they are documented, written by hand."""

from __future__ import annotations

import json

import pytest
from pydantic import Field, ValidationError

from cobot.strict import (
    SHOWN_CHARACTERS,
    StrictModel,
    sentences,
    shown,
    unit_advice,
    unknown_key,
    without_repetition,
)


class Target(StrictModel):
    x: float
    name: str = ""


class Document(StrictModel):
    targets: list[Target]


class Pair(StrictModel):
    numbers: list[int] = Field(min_length=1, max_length=2)


def mistake(content: object) -> str:
    with pytest.raises(ValidationError) as caught:
        Document.model_validate(content)
    return sentences(caught.value.errors())


def test_the_place_the_reason_and_the_value_are_named() -> None:
    assert mistake({"targets": [{"x": "1"}]}) == "targets[0].x: must be a number, got '1'"
    assert mistake({"targets": [{"x": 1.0}, {}]}) == "targets[1].x: is missing"
    assert mistake({}) == "targets: is missing"


def test_a_length_is_told_in_the_words_of_json() -> None:
    for content, wanted in (([], "at least 1 item, got []"), ([1, 2, 3], "at most 2 items, got [1, 2, 3]")):
        with pytest.raises(ValidationError) as caught:
            Pair.model_validate({"numbers": content})
        assert sentences(caught.value.errors()) == f"numbers: must have {wanted}"


def test_an_unknown_key_names_the_one_that_may_have_been_meant_and_the_valid_ones() -> None:
    assert mistake({"targets": [{"x": 1.0, "nam": ""}]}) == (
        "targets[0]: unknown key 'nam' (did you mean 'name'?); valid keys: x, name"
    )
    assert unknown_key("zzz", ["x", "name"]) == "unknown key 'zzz'; valid keys: x, name"


def test_of_many_mistakes_the_first_are_told_and_the_others_counted() -> None:
    text = mistake({"targets": [{"x": None} for _ in range(25)]})
    assert text.count("; ") == 10
    assert text.endswith("and 15 more")


def test_a_value_is_shown_in_a_readable_length() -> None:
    assert shown("é") == "'é'"
    for value in ("x" * 10**6, list(range(10**6)), {n: n for n in range(10**5)}, 10**4000):
        assert len(shown(value)) <= SHOWN_CHARACTERS + 3


def test_a_key_may_not_stand_twice() -> None:
    assert json.loads('{"a": {"a": 1}}', object_pairs_hook=without_repetition) == {"a": {"a": 1}}
    with pytest.raises(ValueError, match="the key 'a' occurs twice in one object"):
        json.loads('{"a": 1, "b": 2, "a": 3}', object_pairs_hook=without_repetition)


class Shelf(StrictModel):
    parts: dict[str, Target]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("bolt é", "bolt é"),
        ("\x1b[2Jx\n", r"'\x1b[2Jx\n'"),
        ("x" * 10**6, f"'{'x' * (SHOWN_CHARACTERS - 1)}..."),
    ],
)
def test_a_place_that_a_client_has_named_is_cut_and_does_nothing_to_a_terminal(name: str, told: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Shelf.model_validate({"parts": {name: {}}})
    assert sentences(caught.value.errors()) == f"parts.{told}.x: is missing"


@pytest.mark.parametrize(
    ("place", "value", "limit", "told"),
    [
        ("timeout_s", 60000, 3600.0, "; this looks like milliseconds: 60000 ms are 60 s"),
        ("motions[2].until.within_s", "1500", 2.0, "; this looks like milliseconds: 1500 ms are 1.5 s"),
        ("radii[3]", 50, 1.0, "; this looks like millimetres: 50 mm are 0.05 m"),
        ("depth", 20.0, 0.5, "; this looks like millimetres: 20 mm are 0.02 m"),
        ("at.distance_m", 200, 1.0, "; this looks like millimetres: 200 mm are 0.2 m"),
        ("timeout_s", 4000, 3.0, ""),  # neither in s nor in ms
        ("timeout_s", 4.5, 3.0, ""),
        ("speed_m_s", 1500, 2.0, ""),  # not a time
        ("radius", 1.5, 1.0, ""),  # little above the limit
        ("speed", 50, 1.0, ""),
        ("radius", [50], 1.0, ""),
        ("radius", 10**400, 1.0, ""),
    ],
)
def test_a_value_that_looks_like_another_unit_is_named(
    place: str, value: object, limit: float, told: str
) -> None:
    assert unit_advice(place, value, limit) == told
