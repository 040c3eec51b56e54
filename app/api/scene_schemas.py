"""The scene as JSON."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Path
from pydantic import BaseModel, ConfigDict, Field, model_validator

from app.api.schemas import Finite
from cobot.strict import StrictModel

Name = Annotated[
    str,
    Path(pattern=r"^[A-Za-z0-9_.-]{1,64}$", description="Letters, digits, and _ . -; at the most 64."),
]
Coordinate = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False, description="m")]
Length = Annotated[float, Field(ge=1e-4, le=100.0, allow_inf_nan=False)]
FIELDS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}


def _example(body: Any) -> ConfigDict:
    return ConfigDict(json_schema_extra={"examples": [body]})


class Place(StrictModel):
    """Where something is."""

    model_config = _example({"x": 0.5, "y": 0.2, "z": 0.1, "a": 0.5})

    x: Coordinate
    y: Coordinate
    z: Coordinate
    a: Finite = Field(0.0, description="KUKA angle A about z, rad")
    b: Finite = Field(0.0, description="KUKA angle B about the new y, rad")
    c: Finite = Field(0.0, description="KUKA angle C about the newest x, rad")
    frame_id: str = Field(
        "",
        max_length=200,
        description="The frame of the pose: empty for the base, a named frame, or one that no joint moves. "
        "It counts where that is now.",
    )


class PutObject(Place):
    """A solid, given by its middle."""

    model_config = _example({"shape": "box", "size": [0.3, 0.4, 0.02], "x": 0.5, "y": -0.6, "z": 0.2})

    shape: Literal["box", "sphere", "cylinder", "capsule"]
    size: list[Length] | None = Field(
        None, min_length=3, max_length=3, description="Of a box: its edges along its x, y and z, m."
    )
    radius: Length | None = Field(None, description="Of a sphere, cylinder or capsule, m.")
    length: Length | None = Field(
        None, description="Of a cylinder or capsule, along its z, m; of a capsule without the round ends."
    )

    @model_validator(mode="after")
    def _of_its_shape(self) -> PutObject:
        wanted = FIELDS[self.shape]
        for name in ("size", "radius", "length"):
            if (getattr(self, name) is None) == (name in wanted):
                problem = "is missing" if name in wanted else "does not belong to it"
                raise ValueError(f"a {self.shape} has {' and '.join(wanted)}: {name} {problem}")
        return self

    def numbers(self) -> tuple[float, ...]:
        """As in `cobot.robot.scene.SceneObject.size`."""
        if self.size is not None:
            return tuple(self.size)
        return tuple(value for value in (self.radius, self.length) if value is not None)


class Attach(StrictModel):
    """What holds it."""

    model_config = _example({"touch": ["link7"]})

    touch: list[str] = Field(
        [], max_length=100, description="Bodies and objects that it may touch while it is attached."
    )


class Allowed(StrictModel):
    """Which pairs may touch."""

    model_config = _example({"pairs": [["table", "link1"]]})

    pairs: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = Field(
        max_length=1000, description="Of bodies and objects, by name. They replace those before."
    )


class ObjectAnswer(BaseModel):
    """A solid."""

    name: str
    shape: str
    size: list[float] = Field(description="m: a box's edges; a radius; a radius and a length.")
    position: list[float] = Field(
        description="Of its middle: x, y, z, m; in the base frame, attached in the TCP's."
    )
    quaternion: list[float] = Field(description="x, y, z, w, likewise.")
    attached: bool
    touch: list[str]


class FrameAnswer(BaseModel):
    """A named frame."""

    name: str
    position: list[float] = Field(description="In the base frame: x, y, z, m.")
    quaternion: list[float] = Field(description="x, y, z, w")


class SceneAnswer(BaseModel):
    """The scene as it is."""

    model_config = _example({"version": 3, "objects": [], "frames": [], "allowed": []})

    version: int = Field(description="Rises with each change; 0: nobody has changed anything yet.")
    objects: list[ObjectAnswer]
    frames: list[FrameAnswer]
    allowed: list[list[str]] = Field(description="Pairs that may touch.")


class ChangedAnswer(BaseModel):
    """What a change has done."""

    model_config = _example({"version": 4, "stopped": "", "contacts": []})

    version: int = Field(description="Of the scene from now on.")
    stopped: str = Field(description="Why the motion under way was stopped; empty if none was.")
    contacts: list[str] = Field(description="What the arm touches, or nearly, where it is now.")
