"""The code and the values of a reason, next to its sentence, in an answer."""

from __future__ import annotations

from pydantic import BaseModel, Field


class ReasonFields(BaseModel):
    """The parts of a reason with which programs can translate it or react to it (docs/conventions.md)."""

    reason_code: str = Field("", description="Code of the reason; empty without a reason or a code.")
    reason_of: str = Field("", description="Names of the joint or links concerned, between commas.")
    reason_values: list[float | None] = Field(
        [None, None], description="Value and limit, in `reason_unit`; null for none."
    )
    reason_unit: str = Field("", description="Unit of these values.")
