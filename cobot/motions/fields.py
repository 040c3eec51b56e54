"""Types of the fields in request bodies: their bounds, units and descriptions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
)
from pydantic_core.core_schema import CoreSchema, literal_schema, no_info_after_validator_function

from cobot.loose_lists import RequestModel
from cobot.motions.planners import ANY_GOAL, PLANNERS, summaries
from cobot.types import MAX_BUDGET_S, PLANNED_JERK, Algorithm
from cobot.units import MAX_POSE_ANGLE_RAD, require_angle, require_way

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]


def example(body: Any) -> ConfigDict:
    """Return an example for the Swagger page: a request that works without changes, or an answer."""
    return ConfigDict(json_schema_extra={"examples": [body]})


MAX_ARC_RAD = 200.0
Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Within:
    """Bounds of a number. If a number that is out of bounds looks like a value in a different unit, the error
    points this out; see `cobot.units`.
    """

    require: Callable[..., float]
    most: float

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_after_validator_function(partial(self.require, most=self.most), handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), "minimum": -self.most, "maximum": self.most}


Angle = Annotated[float, Field(allow_inf_nan=False), Within(require_angle, MAX_POSE_ANGLE_RAD)]
"""Angle of a pose, rad."""
Coordinate = Annotated[float, Field(allow_inf_nan=False), Within(require_way, 1000.0)]
"""Coordinate in m. The bound is beyond the reach of any arm, and small enough that nothing overflows."""


@dataclass(frozen=True, slots=True)
class OneOf:
    """A word from a table. Its schema and its error are the same as for a `Literal`."""

    words: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return literal_schema([str(word) for word in self.words])


def _lower(value: Any) -> Any:
    return value.lower() if isinstance(value, str) else value


def limit_entries(most: int) -> BeforeValidator:
    """Limit the number of entries of a dictionary. Too many are rejected before the entries are validated."""

    def check(value: Any) -> Any:
        if isinstance(value, dict) and len(value) > most:
            raise ValueError(f"may have up to {most} entries, got {len(value)}")
        return value

    return BeforeValidator(check)


Speed = Annotated[
    float,
    Field(ge=0.01, le=1.0, description="Share of the velocity limits."),
]
AccelScale = Annotated[
    float,
    Field(
        ge=0.0,
        le=1.0,
        description=f"Share of the acceleration and jerk limits (of the jerk at most {PLANNED_JERK:g}). 0: "
        "the same as `speed`.",
    ),
]
BudgetS = Annotated[
    Finite,
    Field(
        ge=0.0,
        le=MAX_BUDGET_S,
        description="Time for planning, s. Time left after the first motion is used to find faster ones "
        "(ompl, chomp and auto). 0: the first motion is used.",
    ),
]
Budget = Annotated[BudgetS | None, Field(description="Default: `planning.budget_s`.")]
SynchronizationName = Annotated[
    Literal["time", "phase"],
    Field(
        description="Synchronization of the joints in ptp. time: they start and end together, in the "
        "shortest time; the path is in general not straight in joint space. phase: the path is straight in "
        "joint space."
    ),
]
Planner = Annotated[
    str,
    OneOf(tuple(PLANNERS)),
    BeforeValidator(_lower),
    Field(description=summaries(PLANNERS)),
]
JointPlanner = Annotated[
    str,
    OneOf(ANY_GOAL),
    BeforeValidator(_lower),
    Field(description="See the same field of a motion to a pose."),
]
OmplAlgorithm = Annotated[Algorithm, Field(description="Algorithm of planner ompl, by its name in OMPL.")]


class Direction(RequestModel):
    """A direction. Its length does not matter, but must not be 0."""

    x: Coordinate = Field(description="x component, in any unit.")
    y: Coordinate = Field(description="y component, in any unit.")
    z: Coordinate = Field(description="z component, in any unit.")
