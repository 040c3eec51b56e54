"""Conditions on inputs in requests and sequences, as JSON."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from cobot.loose_lists import RequestModel
from cobot.motions.fields import Finite

PointName = Annotated[str, Field(min_length=1, max_length=200)]
"""Name of an input or output, as in GET /robot/io."""


class InputTest(RequestModel):
    """A test of an input value."""

    TESTS: ClassVar[tuple[str, ...]] = ("is", "above", "below")

    is_: bool | None = Field(
        None, alias="is", description="The condition holds while the boolean input has this value."
    )
    above: Finite | None = Field(
        None, description="The condition holds while the digital or analog input is greater than this."
    )
    below: Finite | None = Field(
        None, description="The condition holds while the digital or analog input is less than this."
    )

    @property
    def tests(self) -> list[str]:
        """Names of the tests that are given."""
        names = {field.alias or name: name for name, field in type(self).model_fields.items()}
        return [test for test in self.TESTS if getattr(self, names[test]) is not None]

    def _require_one_test(self) -> None:
        if len(self.tests) != 1:
            raise ValueError(f"give one of {', '.join(self.TESTS)}, got {', '.join(self.tests) or 'none'}")


class StepCondition(InputTest):
    """A condition on an input value. Give one of `is`, `above` and `below`."""

    input: PointName = Field(description="Name of an input in GET /robot/io.")

    @model_validator(mode="after")
    def _require_test(self) -> Self:
        self._require_one_test()
        return self

    def as_json(self) -> dict[str, Any]:
        """The condition as it is written in the document."""
        return self.model_dump(by_alias=True, exclude_none=True)
