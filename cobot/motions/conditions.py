"""Conditions on inputs, as the steps of sequences take them."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from cobot.loose_lists import RequestModel
from cobot.motions.fields import Finite

PointName = Annotated[str, Field(min_length=1, max_length=200)]
"""Name of an input or output, as in GET /robot/io."""


class StepCondition(RequestModel):
    """A condition on an input: `is` for a boolean one, `above` or `below` for the others."""

    input: PointName = Field(description="One of the inputs of GET /robot/io.")
    is_: bool | None = Field(None, alias="is", description="Value of a boolean input.")
    above: Finite | None = Field(None, description="The input is greater than this number.")
    below: Finite | None = Field(None, description="The input is less than this number.")

    @model_validator(mode="after")
    def _require_one_test(self) -> Self:
        if sum(each is not None for each in (self.is_, self.above, self.below)) != 1:
            raise ValueError('give one of "is" (true or false), "above" and "below" (a number)')
        return self

    def as_json(self) -> dict[str, Any]:
        """The condition as in the document."""
        return self.model_dump(by_alias=True, exclude_none=True)
