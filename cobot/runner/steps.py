"""Steps of sequences: waypoints, and the steps between them.

The key of a step is its kind: `{"set": {...}}`, `{"repeat": {...}, "do": [...]}`. A step without such a key
is a waypoint, see `cobot.runner.targets`.
"""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import BaseModel, Discriminator, Field, Tag, model_validator

from cobot.client.pallets import TOOL_FRAME, require_grid
from cobot.client.steps import MAX_RETRIES, MAX_TIME_S, WAIT_FOR_TIMEOUT_S
from cobot.errors import InputError
from cobot.loose_lists import RequestModel
from cobot.motions.bodies import (
    ARC,
    JOINT,
    KINDS,
    MOTION_TAGS,
    NAMED,
    POSE,
    FrameId,
    PathPose,
    kind_of,
)
from cobot.motions.conditions import PointName, StepCondition
from cobot.motions.fields import Coordinate, Finite
from cobot.motions.force_bodies import FollowMotion, InsertMotion, PressMotion, SearchMotion
from cobot.runner.gripper_step import COMMAND_TAGS, GripperCommand
from cobot.runner.targets import ArcTarget, Comment, JointTarget, Label, NamedTarget, PoseTarget

MAX_STEPS = 100_000
"""Maximum number of steps in one list."""
MAX_DEPTH = 20
"""Maximum nesting depth of lists of steps. A called sequence adds one level."""
MAX_ROUNDS = 1_000_000_000
FIXED_FRAMES = ("", "base", "world", TOOL_FRAME)
"""Names of frames that a pallet cannot use for its places."""

Seconds = Annotated[Finite, Field(ge=0.0, le=MAX_TIME_S)]


class Step(RequestModel):
    """Fields that every step can have."""

    label: Label = ""
    comment: Comment = ""

    def blocks(self) -> dict[str, Block]:
        """The lists of steps in this step, by their place in it."""
        return {}


class OutputValue(RequestModel):
    """An output and its value."""

    output: PointName = Field(description="Name of an output in GET /robot/io.")
    value: bool | int | Finite = Field(
        description="boolean: true or false; digital: a whole number of 0 or more; analog: a number."
    )


class SetStep(Step):
    """Set an output of the device, like PUT /robot/io/NAME."""

    set: OutputValue


class GripperStep(Step):
    """Command the gripper, and wait until its fingers have finished."""

    gripper: GripperCommand


class ForceStep(Step):
    """A motion with force: a body of POST /robot/force/... under its name in `FORCE_STEPS`."""


class PressStep(ForceStep):
    """Approach until contact, then hold a force."""

    press: PressMotion


class FollowStep(ForceStep):
    """Approach until contact, then move along a path while holding the force."""

    follow: FollowMotion


class SearchStep(ForceStep):
    """Approach until contact, then search for a hole or an edge while keeping contact."""

    search: SearchMotion


class InsertStep(ForceStep):
    """Search, then push in compliantly to a depth."""

    insert: InsertMotion


FORCE_STEPS: dict[str, type[ForceStep]] = {
    "press": PressStep,
    "follow": FollowStep,
    "search": SearchStep,
    "insert": InsertStep,
}


class WaitForStep(Step):
    """Wait until a condition holds."""

    wait_for: StepCondition
    timeout_s: Seconds = Field(
        WAIT_FOR_TIMEOUT_S, description="Time, s, after which the step fails if the condition does not hold."
    )


class WaitStep(Step):
    """Wait for a given time."""

    wait_s: Seconds = Field(description="Duration, s.")


class Rounds(RequestModel):
    """Number of repetitions of steps. If no field is given, the steps are repeated until the sequence is
    stopped.
    """

    count: int | None = Field(None, ge=1, le=MAX_ROUNDS, description="Maximum number of rounds.")
    while_: StepCondition | None = Field(
        None,
        alias="while",
        description="Checked before each round: the next round starts only while this condition holds.",
    )
    until: StepCondition | None = Field(
        None, description="Checked after each round: no further round starts once this condition holds."
    )


class RepeatStep(Step):
    """Repeat steps."""

    repeat: Rounds
    do: Block

    def blocks(self) -> dict[str, Block]:
        return {"do": self.do}


class IfStep(Step):
    """Run steps if a condition holds, or other steps if it does not."""

    if_: StepCondition = Field(alias="if")
    then: Block
    else_: Block = Field(default_factory=list, alias="else")

    def blocks(self) -> dict[str, Block]:
        return {"then": self.then, "else": self.else_}


class CallStep(Step):
    """Run another sequence file of the same folder once, its `home` included."""

    call: str = Field(min_length=1, max_length=200, description="File below the folder of programs.")


class Offset(RequestModel):
    """The offset from one place to the next, in the frame in which the origin is given, m."""

    x: Coordinate = Field(0.0, description="m")
    y: Coordinate = Field(0.0, description="m")
    z: Coordinate = Field(0.0, description="m")


class Origin(PathPose):
    """The pose of the first place."""

    frame_id: FrameId = ""


class Grid(RequestModel):
    """A grid of places. The first direction changes fastest."""

    frame: str = Field(
        "place",
        min_length=1,
        max_length=200,
        description="Name of the places for use as `frame_id` in the steps: poses with it are relative to "
        "the current place.",
    )
    origin: Origin
    counts: list[int] = Field(min_length=1, max_length=3, description="Number of places in each direction.")
    offsets: list[Offset] = Field(
        min_length=1, max_length=3, description="For each direction, the offset from one place to the next."
    )

    @model_validator(mode="after")
    def _require_places(self) -> Self:
        if self.frame in FIXED_FRAMES:
            raise ValueError(
                f"frame: {self.frame!r} is the name of an existing frame; choose a name such as 'place'"
            )
        if self.origin.frame_id == TOOL_FRAME:
            raise ValueError("origin.frame_id: 'tool' moves with the arm; a pallet needs a fixed frame")
        try:
            require_grid(self.counts, [each.model_dump() for each in self.offsets])
        except InputError as exc:
            raise ValueError(str(exc)) from exc
        return self


class PalletStep(Step):
    """Run steps at each place of a grid."""

    pallet: Grid
    do: Block

    def blocks(self) -> dict[str, Block]:
        return {"do": self.do}


class Recovery(RequestModel):
    """The reaction when a motion, a wait or a device fails while steps run."""

    retry: int = Field(0, ge=0, le=MAX_RETRIES, description="Number of further attempts.")
    run: Block = Field(default_factory=list, description="Steps that run after each failed attempt.")
    go_on: bool = Field(
        False,
        description="true: after the last attempt the sequence continues. false: it ends with the error.",
    )


class OnErrorStep(Step):
    """Run steps, and run them again if they fail."""

    on_error: Recovery
    do: Block

    def blocks(self) -> dict[str, Block]:
        return {"on_error.run": self.on_error.run, "do": self.do}


_KINDS: dict[str, type[Step]] = {
    "gripper": GripperStep,
    **FORCE_STEPS,
    "set": SetStep,
    "wait_for": WaitForStep,
    "wait_s": WaitStep,
    "repeat": RepeatStep,
    "if": IfStep,
    "call": CallStep,
    "pallet": PalletStep,
    "on_error": OnErrorStep,
}
TAGS = {key: f"{key} step" for key in _KINDS}
"""The tag of each kind of step in pydantic's errors, by its key."""
IGNORED_TAGS = (*MOTION_TAGS, *TAGS.values(), *COMMAND_TAGS)
A_STEP = f"must be a step with one of {', '.join(TAGS)}, or a waypoint with joints, named, angle or x, y, z"


def _kind(value: Any) -> str | None:
    """The tag of the kind of a step; None for an object that is neither a step nor a waypoint."""
    if isinstance(value, BaseModel):
        return next((TAGS[key] for key, kind in _KINDS.items() if isinstance(value, kind)), kind_of(value))
    if not isinstance(value, dict):
        return None
    tag = next((TAGS[key] for key in TAGS if key in value), None)
    is_waypoint = bool(value.keys() & {*KINDS, *PoseTarget.model_fields, *ArcTarget.model_fields})
    return tag or (kind_of(value) if is_waypoint else None)


AnyStep = Annotated[
    Annotated[JointTarget, Tag(JOINT)]
    | Annotated[NamedTarget, Tag(NAMED)]
    | Annotated[ArcTarget, Tag(ARC)]
    | Annotated[PoseTarget, Tag(POSE)]
    | Annotated[GripperStep, Tag(TAGS["gripper"])]
    | Annotated[PressStep, Tag(TAGS["press"])]
    | Annotated[FollowStep, Tag(TAGS["follow"])]
    | Annotated[SearchStep, Tag(TAGS["search"])]
    | Annotated[InsertStep, Tag(TAGS["insert"])]
    | Annotated[SetStep, Tag(TAGS["set"])]
    | Annotated[WaitForStep, Tag(TAGS["wait_for"])]
    | Annotated[WaitStep, Tag(TAGS["wait_s"])]
    | Annotated[RepeatStep, Tag(TAGS["repeat"])]
    | Annotated[IfStep, Tag(TAGS["if"])]
    | Annotated[CallStep, Tag(TAGS["call"])]
    | Annotated[PalletStep, Tag(TAGS["pallet"])]
    | Annotated[OnErrorStep, Tag(TAGS["on_error"])],
    Discriminator(_kind, custom_error_type="step", custom_error_message=A_STEP),
]
Block = Annotated[list[AnyStep], Field(min_length=1, max_length=MAX_STEPS)]
