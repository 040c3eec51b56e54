"""JSON without the brackets of lists of one item. Oracle: the same document with all its brackets."""

from __future__ import annotations

from typing import Annotated, Any

import pytest
from pydantic import Field, ValidationError

from cobot.loose_lists import RequestModel


class Point(RequestModel):
    x: float


class Everything(RequestModel):
    number: float = 1.0
    numbers: list[float] = Field([])
    optional_numbers: Annotated[list[float], Field(min_length=1)] | None = None
    any_number_or_null: list[float] | None = None
    words: list[str] = Field([])
    rows: list[list[float | None]] = Field([])
    point: Point | None = None
    points: list[Point] = Field([])
    by_name: dict[str, list[str]] = Field({})
    point_by_name: dict[str, Point | None] = Field({})


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ({"numbers": 0.5}, {"numbers": [0.5]}),
        ({"optional_numbers": 1}, {"optional_numbers": [1]}),
        ({"words": "tool"}, {"words": ["tool"]}),
        ({"rows": 0.5}, {"rows": [[0.5]]}),
        ({"rows": [0.5, None]}, {"rows": [[0.5, None]]}),
        ({"points": {"x": 1.0}}, {"points": [{"x": 1.0}]}),
        ({"by_name": {"part": "finger"}}, {"by_name": {"part": ["finger"]}}),
        ({"number": []}, {}),
        ({"numbers": []}, {"numbers": []}),
        ({"optional_numbers": []}, {"optional_numbers": None}),
        ({"any_number_or_null": []}, {"any_number_or_null": []}),
        ({"point": []}, {"point": None}),
        ({"points": []}, {"points": []}),
        ({"by_name": []}, {"by_name": {}}),
        ({"by_name": {"part": []}}, {"by_name": {"part": []}}),
        ({"point_by_name": {"part": []}}, {"point_by_name": {"part": None}}),
    ],
)
def test_one_item_is_a_list_of_one_and_an_empty_list_is_nothing(
    written: dict[str, Any], meant: dict[str, Any]
) -> None:
    assert Everything.model_validate(written) == Everything.model_validate(meant)
    assert Everything.model_validate(written).model_fields_set == set(meant)


@pytest.mark.parametrize(
    "document",
    [
        {"numbers": "0.5"},
        {"numbers": None},
        {"numbers": {"x": 1.0}},
        {"words": 1.0},
        {"points": 1.0},
        {"point": [{"x": 1.0}]},
        {"number": [1.0]},
        {"number": None},
        {"by_name": {"part": 1.0}},
    ],
)
def test_what_is_no_such_item_either_is_rejected_as_it_was_written(document: dict[str, Any]) -> None:
    with pytest.raises(ValidationError) as caught:
        Everything.model_validate(document)
    assert caught.value.errors()[0]["input"] in (*document.values(), 1.0)


def test_a_field_that_is_needed_is_not_left_out_by_an_empty_list() -> None:
    with pytest.raises(ValidationError, match="valid number"):
        Point.model_validate({"x": []})


def test_the_document_itself_is_not_changed() -> None:
    document = {"numbers": 0.5, "number": []}
    Everything.model_validate(document)
    assert document == {"numbers": 0.5, "number": []}
