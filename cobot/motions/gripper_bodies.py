"""Requests to the gripper, as JSON."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from cobot.errors import InputError
from cobot.loose_lists import RequestModel
from cobot.motions.fields import Finite, example
from cobot.strict import sentences, shown

Width = Annotated[Finite, Field(ge=0.0, le=10.0, description="Width between the fingers, m.")]
Tolerance = Annotated[Finite, Field(ge=0.0, le=1.0)]
FingerSpeed = Annotated[
    Finite | None,
    Field(gt=0.0, le=10.0, description="Speed of the fingers, m/s; null: the gripper's default."),
]
GripForce = Annotated[
    Finite | None,
    Field(gt=0.0, le=10_000.0, description="Force of the fingers, N; null: the gripper's default."),
]


class GripperMove(RequestModel):
    """Move the fingers to a width."""

    model_config = example({"width": 0.04, "speed": 0.1})

    width: Width
    speed: FingerSpeed = None
    force: GripForce = None
    if_blocked: Literal["error", "success"] = Field(
        "error",
        description="Result if an object stops the fingers before the width. error: `success` is false. "
        "success: it is true, and the fingers hold the object.",
    )


class GripperGrasp(RequestModel):
    """Hold an object."""

    model_config = example({"width": 0.04, "tolerance_inner": 0.005, "tolerance_outer": 0.005, "force": 40.0})

    width: Width | None = Field(
        None,
        description="Width of the object, m; null: any. If it is wider than the current width, the fingers "
        "open inside it.",
    )
    tolerance_inner: Tolerance = Field(0.005, description="How much narrower the object may be, m.")
    tolerance_outer: Tolerance = Field(0.005, description="How much wider the object may be, m.")
    speed: FingerSpeed = None
    force: GripForce = None
    if_missed: Literal["error", "success"] = Field(
        "error",
        description="Result if the fingers close without an object. error: `success` is false. success: it "
        "is true. `object` is `none` in both cases.",
    )


class GripperRelease(RequestModel):
    """Release the object."""

    model_config = example({"width": 0.08})

    width: Width | None = Field(None, description="Width to open to, m; null: as far as possible.")


class GripperHome(RequestModel):
    """Find the reference, or activate the gripper. Its fingers may move."""

    model_config = example({})


AnyGripperCommand = GripperMove | GripperGrasp | GripperRelease | GripperHome
COMMANDS: dict[str, type[AnyGripperCommand]] = {
    "move": GripperMove,
    "grasp": GripperGrasp,
    "release": GripperRelease,
    "home": GripperHome,
}
UNITS = {"width": "m", "tolerance_inner": "m", "tolerance_outer": "m", "speed": "m/s", "force": "N"}


@dataclass(frozen=True, slots=True)
class GripperRequest:
    """A command to the gripper, with its name in `COMMANDS`."""

    name: str
    command: AnyGripperCommand

    @classmethod
    def of(cls, fields: Mapping[str, Any], valid: Collection[str] = tuple(COMMANDS)) -> GripperRequest:
        """Read a command.

        Args:
            fields: `command` and the fields of that command's body.
            valid: the permitted names.

        Raises:
            InputError: the command does not exist, or its fields are wrong.
        """
        name = fields.get("command")
        if not isinstance(name, str) or name not in valid:
            raise InputError(f"command: must be one of {', '.join(valid)}, got {shown(name)}")
        try:
            body = COMMANDS[name].model_validate(
                {key: value for key, value in fields.items() if key != "command"}
            )
        except ValidationError as exc:
            raise InputError(sentences(exc.errors())) from exc
        return cls(name, body)

    @property
    def words(self) -> str:
        """The command as human-readable text."""
        given = self.command.model_dump(exclude_defaults=True)
        values = [f"{name} {shown(value)} {UNITS.get(name, '')}".rstrip() for name, value in given.items()]
        return ", ".join([f"gripper {self.name}", *values])
