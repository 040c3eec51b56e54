"""Actions and conditions in requests for motions, as JSON. See `cobot.motions.signals`."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import FailFast, Field, model_validator

from cobot.loose_lists import RequestModel
from cobot.motions.conditions import InputTest, PointName, StepCondition
from cobot.motions.fields import Direction, Finite
from cobot.motions.signals import Unit
from cobot.types import MAX_ACTIONS

MAX_FORCE = 10_000.0
DEFAULT_FORCE_N, DEFAULT_TORQUE_NM = 20.0, 5.0
"""Default thresholds of `until`; see "Thresholds" in docs/signals-and-contact.md."""
MAX_TEXT = 200
MAX_RETRACT_M = 1.0


class ActionPlace(RequestModel):
    """A point on the path of the motion. Give one of `distance_m`, `time_s` and `fraction`."""

    distance_m: Annotated[
        Finite | None, Field(ge=0.0, le=1000.0, description="Distance along the TCP path, m.")
    ] = None
    time_s: Annotated[
        Finite | None,
        Field(ge=0.0, description="Time at the planned speed, s; the speed override scales it."),
    ] = None
    fraction: Annotated[
        Finite | None,
        Field(
            ge=0.0,
            le=1.0,
            description="Share of the length of the TCP path, or of the time if the TCP only turns.",
        ),
    ] = None

    from_: Literal["start", "end"] = Field(
        "start",
        alias="from",
        description="End of the path from which distance, time or fraction are measured.",
    )

    @model_validator(mode="after")
    def _require_one(self) -> Self:
        given = [name for name in PLACE_UNITS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of {', '.join(PLACE_UNITS)}, got {', '.join(given) or 'none'}")
        return self


PLACE_UNITS: tuple[Unit, ...] = ("distance_m", "time_s", "fraction")


class SetAction(RequestModel):
    """An output and its value."""

    output: PointName = Field(description="Name of an output in GET /robot/io.")
    value: bool | int | Finite = Field(
        description="boolean: true or false; digital: a whole number of 0 or more; analog: a number."
    )


class PathAction(RequestModel):
    """An action at a point on the path. Give one of `set`, `event` and `gripper`."""

    at: ActionPlace = Field(description="Place on the path.")
    set: SetAction | None = Field(
        None, description="Output to set in the cycle in which the arm reaches the point."
    )
    event: Annotated[
        str | None,
        Field(min_length=1, max_length=MAX_TEXT, description="Text of an event in GET /events."),
    ] = None
    gripper: Annotated[
        dict[str, Any] | None,
        Field(
            max_length=8,
            description="Command of the gripper: `command` is move, grasp or release; the other fields are "
            "those of POST /robot/gripper/move, grasp and release.",
        ),
    ] = None
    on_failure: Literal["continue", "stop"] = Field(
        "continue", description="Reaction of the motion if the device rejects the output."
    )

    @model_validator(mode="after")
    def _require_one(self) -> Self:
        given = [name for name in ("set", "event", "gripper") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of set, event and gripper, got {', '.join(given) or 'none'}")
        return self


class _EdgeTest(InputTest):
    TESTS = (*InputTest.TESTS, "edge")

    edge: Literal["rising", "falling"] | None = Field(
        None, description="The condition holds once the boolean input has changed to this value."
    )


class InputCondition(_EdgeTest, StepCondition):
    """A condition on an input. Give one of `is`, `above`, `below` and `edge`."""


class ForceThreshold(RequestModel):
    """A force at the TCP."""

    direction: Direction | None = Field(
        None,
        description="Direction along which the force is compared, in either sense. null: any direction.",
    )
    frame: Literal["base", "tool"] = Field("base", description="Frame of the direction.")
    threshold: Finite = Field(DEFAULT_FORCE_N, gt=0.0, le=MAX_FORCE, description="N")


class TorqueThreshold(RequestModel):
    """A torque on a joint or at the TCP."""

    joint: PointName | None = Field(
        None,
        description="Name of the joint whose external torque is compared. null: the torque at the TCP.",
    )
    direction: Direction | None = Field(
        None, description="Axis about which the torque at the TCP is compared. null: any axis."
    )
    frame: Literal["base", "tool"] = Field("base", description="Frame of the direction.")
    threshold: Finite = Field(DEFAULT_TORQUE_NM, gt=0.0, le=MAX_FORCE, description="N·m")

    @model_validator(mode="after")
    def _require_one_place(self) -> Self:
        if self.joint is not None and self.direction is not None:
            raise ValueError("joint, direction: give one of them; the torque on a joint has no direction")
        return self


class UntilCondition(_EdgeTest):
    """A condition that ends a motion. Give one of `input`, `force` and `torque`."""

    input: PointName | None = Field(None, description="Name of an input in GET /robot/io.")
    force: ForceThreshold | None = Field(None, description="A force at the TCP exceeds a threshold.")
    torque: TorqueThreshold | None = Field(
        None, description="A torque on a joint or at the TCP exceeds a threshold."
    )
    relative_to: Literal["start", "zero"] = Field(
        "start",
        description="start: forces and torques are relative to those at the start of the motion. zero: "
        "they are relative "
        "to those at the last POST /robot/force/zero.",
    )
    stop: Literal["fast", "path"] = Field(
        "fast",
        description="fast: each joint stops as fast as its limits permit, so the arm leaves its path. "
        "path: the arm stops on its path, over a longer distance.",
    )
    retract: Finite = Field(
        0.0,
        ge=0.0,
        le=MAX_RETRACT_M,
        description="Distance that the TCP then moves back along its path, m.",
    )
    if_not_met: Literal["error", "success"] = Field(
        "error", description="Result of a motion that reaches its goal without meeting the condition."
    )

    @model_validator(mode="after")
    def _require_condition(self) -> Self:
        given = [name for name in ("input", "force", "torque") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of input, force and torque, got {', '.join(given) or 'none'}")
        if self.input is not None:
            self._require_one_test()
        elif self.tests:
            raise ValueError(f"{self.tests[0]}: is a test of an input; give input too")
        return self


class SignalFields(RequestModel):
    """Fields of a motion with actions on its path and conditions."""

    actions: Annotated[list[PathAction], FailFast()] = Field(
        [], max_length=MAX_ACTIONS, description="Actions at points on the path. Each is executed once."
    )
    start_when: InputCondition | None = Field(
        None,
        description="The motion waits at its start until this condition holds. In the queue the arm stops "
        "before it.",
    )
    pause_while: InputCondition | None = Field(
        None, description="The arm waits on its path while this condition holds."
    )
    until: UntilCondition | None = Field(
        None,
        description="The motion ends with success when this condition is met, for example at a contact. In "
        "the queue the arm then stops, and the next motions are planned from there.",
    )
