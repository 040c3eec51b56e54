"""The reason why there is no motion, as JSON: the failed checks, the changes that work, and those that do
not.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from operator import not_
from typing import Annotated, Any

from pydantic import BaseModel, Field

from cobot.errors import CobotError
from cobot.findings import Check, Failure, Finding, Kind


class FailedCheck(BaseModel):
    """The result of one failed check."""

    check: Check = Field(description="Name of the check.")
    quantity: str = Field(description="The checked quantity.")
    value: float = Field(description="Value of the quantity, in `unit`.")
    limit: float = Field(description="Its limit, in `unit`.")
    by: float = Field(description="Distance of the value beyond the limit, in `unit`.")
    unit: str = Field(description="SI unit; empty for a share.")
    share: float | None = Field(
        description="Place, as a share of the path (of its duration, if it has been timed): 0 is the start, "
        "1 the goal; null: no particular place."
    )
    of: list[str] = Field(
        description="Names of the joint, or of the two bodies that are too close to each other."
    )


class Works(BaseModel):
    """A changed request that was planned with all checks."""

    change: Kind = Field(description="Kind of the change.")
    says: str = Field(description="The change in words.")
    endpoint: str = Field(
        description="The endpoint for `body`; /robot/move/... accepts the same body without `samples`."
    )
    body: dict[str, Any] = Field(description="The complete changed request.")
    duration_s: float = Field(description="Duration of the changed motion, s.")


class Tried(BaseModel):
    """A change that does not work."""

    change: Kind = Field(description="Kind of the change.")
    count: int = Field(description="Number of variants that were tried.")
    says: str = Field(description="The first variant.")
    why: str = Field(description="Reason why the change does not work.")


class Explain(BaseModel):
    """The reason why there is no motion, and changes that make one possible."""

    checks: list[FailedCheck] = Field(description="The failed checks, the decisive one first.")
    motion: int | None = Field(
        None, description="In a sequence: number of the motion that `works` changes, from 1."
    )
    works: list[Works] = Field(
        [], description="Changes that work, at most one of each kind; only for /robot/plan."
    )
    tried: list[Tried] = Field([], description="Changes that were tried and do not work.")
    spent_s: float = Field(0.0, description="Time spent on the search, s.")
    budget_s: float = Field(0.0, description="Time limit of the search, s: `planning.explain_s`, or less.")


Details = Annotated[
    dict[str, Any] | None,
    Field(
        exclude_if=not_,
        description="Further values for programs, only with some codes; see docs/conventions.md.",
    ),
]


def explain_of(error: CobotError) -> Explain | None:
    """Return an error's failed checks; None if it has none."""
    if not error.findings:
        return None
    checks = [_check(found) for found in error.findings]
    return Explain(checks=checks, motion=None, works=[], tried=[], spent_s=0.0, budget_s=0.0)


def _check(found: Finding) -> FailedCheck:
    return FailedCheck(
        check=found.check,
        quantity=found.quantity,
        value=_in_json(found.value),
        limit=_in_json(found.limit),
        by=_in_json(found.excess),
        unit=found.unit,
        share=found.share,
        of=list(found.of),
    )


def _in_json(value: float) -> float:
    """Limit a value to the range of floats. Extreme requests overflow, and JSON has no infinity."""
    return max(-sys.float_info.max, min(sys.float_info.max, value))


def tried_of(tried: Sequence[Failure]) -> list[Tried]:
    return [Tried(change=each.kind, count=each.count, says=each.says, why=each.why) for each in tried]
