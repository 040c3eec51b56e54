"""The scene as JSON."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from app.api.schemas import Finite
from cobot.robot.scene import SceneObject
from cobot.strict import StrictModel

Name = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$", description="Letters, digits, and _ . -; at the most 64."),
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

    x: Coordinate = Field(description="m")
    y: Coordinate = Field(description="m")
    z: Coordinate = Field(description="m")
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

    shape: Literal["box", "sphere", "cylinder", "capsule"] = Field(description="Of the solid.")
    size: list[Length] | None = Field(
        None, min_length=3, max_length=3, description="Of a box: its edges along its x, y and z, m."
    )
    radius: Length | None = Field(None, description="Of a sphere, cylinder or capsule, m.")
    length: Length | None = Field(
        None, description="Of a cylinder or capsule, along its z, m; of a capsule without the round ends."
    )

    mass: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = Field(
        0.0, description="kg; the arm carries it while the object is attached, together with the tool's."
    )
    centre: list[Coordinate] | None = Field(
        None,
        min_length=3,
        max_length=3,
        description="Of the mass, x, y, z from the middle along its own axes, m; without it the solid has "
        "one density.",
    )
    inertia: list[Finite] | None = Field(
        None,
        min_length=6,
        max_length=6,
        description="About the centre, along its own axes: xx, xy, xz, yy, yz, zz, kg·m²; without it the "
        "solid has one density.",
    )

    @model_validator(mode="after")
    def _of_some_mass(self) -> PutObject:
        if self.mass == 0.0 and {"centre", "inertia"} & self.model_fields_set:
            raise ValueError("mass: is missing; centre and inertia are of no mass")
        return self

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


class ChangeScene(StrictModel):
    """Changes that are made together, in the order of these fields, or not at all."""

    model_config = _example(
        {"objects": {"table": {"shape": "box", "size": [0.3, 0.4, 0.02], "x": 0.5, "y": -0.6, "z": 0.2}}}
    )

    clear: bool = Field(False, description="Remove all objects, frames and allowed pairs first.")
    detach: list[Name] = Field(
        [], max_length=1000, description="Objects that the hand lets go: they stand where they are now."
    )
    frames: dict[Name, Place | None] = Field(
        {}, max_length=1000, description="Places by name, for `frame_id`; null forgets one."
    )
    objects: dict[Name, PutObject | None] = Field(
        {}, max_length=1000, description="Solids by name, added or replaced; null removes one."
    )
    attach: dict[Name, Annotated[list[str], Field(max_length=100)]] = Field(
        {},
        max_length=1000,
        description="Objects that the hand holds from now on, each with what it may touch meanwhile.",
    )
    allowed: list[Annotated[list[str], Field(min_length=2, max_length=2)]] | None = Field(
        None,
        max_length=1000,
        description="Pairs of bodies and objects that may touch, not those before.",
    )

    @model_validator(mode="after")
    def _says_something(self) -> ChangeScene:
        if not self.model_fields_set:
            raise ValueError(f"nothing to change; valid are: {', '.join(type(self).model_fields)}")
        return self


class ObjectAnswer(BaseModel):
    """A solid."""

    name: str = Field(description="Of the object.")
    shape: str = Field(description="box, sphere, cylinder or capsule.")
    size: list[float] = Field(description="m: a box's edges; a radius; a radius and a length.")
    position: list[float] = Field(
        description="Of its middle: x, y, z, m; in the base frame, attached in the TCP's."
    )
    quaternion: list[float] = Field(description="x, y, z, w, likewise.")
    attached: bool = Field(description="The hand holds it.")
    touch: list[str] = Field(description="What it may touch while the hand holds it.")
    mass: float = Field(0.0, description="kg")
    centre: list[float] | None = Field(None, description="Of the mass, m; null: of one density.")
    inertia: list[float] | None = Field(
        None, description="About the centre: xx, xy, xz, yy, yz, zz, kg·m²; null: of one density."
    )

    @classmethod
    def of(cls, name: str, each: SceneObject) -> ObjectAnswer:
        """An object as it stands in the scene or on the tool."""
        return cls(
            name=name,
            shape=each.shape,
            size=list(each.size),
            position=list(each.pose[:3]),
            quaternion=[*each.pose[4:], each.pose[3]],
            attached=each.attached,
            touch=list(each.touch),
            mass=each.mass,
            centre=None if each.centre is None else list(each.centre),
            inertia=None if each.inertia is None else list(each.inertia),
        )


class FrameAnswer(BaseModel):
    """A named frame."""

    name: str = Field(description="Of the frame.")
    position: list[float] = Field(description="In the base frame: x, y, z, m.")
    quaternion: list[float] = Field(description="x, y, z, w")


class SceneAnswer(BaseModel):
    """The scene as it is."""

    model_config = _example({"version": 3, "objects": [], "frames": [], "allowed": []})

    version: int = Field(description="Rises with each change; 0: nobody has changed anything yet.")
    objects: list[ObjectAnswer] = Field(description="What stands there, or is held.")
    frames: list[FrameAnswer] = Field(description="Places with names.")
    allowed: list[list[str]] = Field(description="Pairs that may touch.")


class ChangedAnswer(BaseModel):
    """What a change has done."""

    model_config = _example({"version": 4, "stopped": "", "contacts": []})

    version: int = Field(description="Of the scene from now on.")
    stopped: str = Field(description="Why the motion under way was stopped; empty if none was.")
    contacts: list[str] = Field(description="What the arm touches, or nearly, where it is now.")
