"""Requests to the gripper, as JSON."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cobot.loose_lists import RequestModel
from cobot.motions.fields import Finite, example

Width = Annotated[Finite, Field(ge=0.0, le=10.0, description="Between the fingers, m.")]
Tolerance = Annotated[Finite, Field(ge=0.0, le=1.0)]
FingerSpeed = Annotated[
    Finite | None, Field(gt=0.0, le=10.0, description="Of the fingers, m/s; null: the gripper's default.")
]
GripForce = Annotated[
    Finite | None, Field(gt=0.0, le=10_000.0, description="Of the grip, N; null: the gripper's default.")
]


class GripperMove(RequestModel):
    """Go to a width."""

    model_config = example({"width": 0.04, "speed": 0.1})

    width: Width
    speed: FingerSpeed = None
    force: GripForce = None


class GripperGrasp(RequestModel):
    """Hold an object."""

    model_config = example({"width": 0.04, "tolerance_inner": 0.005, "tolerance_outer": 0.005, "force": 40.0})

    width: Width | None = Field(
        None,
        description="Of the object, m; null: any. If it is wider than the present width, the fingers open "
        "inside of it.",
    )
    tolerance_inner: Tolerance = Field(0.005, description="How much narrower the object may be, m.")
    tolerance_outer: Tolerance = Field(0.005, description="How much wider the object may be, m.")
    speed: FingerSpeed = None
    force: GripForce = None
    if_missed: Literal["error", "success"] = Field(
        "error",
        description="What the answer says if the fingers have closed on nothing: `success` false, or true. "
        "`object` says `none` in both cases.",
    )


class GripperRelease(RequestModel):
    """Let go of the object."""

    model_config = example({"width": 0.08})

    width: Width | None = Field(None, description="To open to, m; null: as far as possible.")


class GripperHome(RequestModel):
    """Find the reference, or activate the gripper. Its fingers may move."""

    model_config = example({})


AnyGripperCommand = GripperMove | GripperGrasp | GripperRelease | GripperHome
