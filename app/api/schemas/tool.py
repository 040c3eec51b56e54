"""The tool as JSON."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from app.api.schemas.names import Name
from app.api.schemas.scene import ObjectAnswer, PutObject
from cobot.loose_lists import RequestModel
from cobot.motions.bodies import Joints
from cobot.motions.fields import Angle, Finite, Within, limit_entries
from cobot.robot.tcp_fit import MAX_POSES, MIN_POSES
from cobot.units import MAX_TIP_M, require_way

TipCoordinate = Annotated[float, Field(allow_inf_nan=False), Within(require_way, MAX_TIP_M)]
INERTIA = [0.004, 0.0, 0.0, 0.004, 0.0, 0.002]
EXAMPLE_POINTS = [
    [0.181, 0.087, 0.11, -1.799, -0.433, 1.404, 0.397],
    [-0.168, 0.087, -0.124, -1.799, 0.434, 1.405, -0.049],
    [0.0, 0.316, 0.0, -1.519, 0.0, 1.741, 0.0],
    [0.062, -0.241, -0.051, -2.1, -0.022, 0.845, -0.328],
]
"""Example for the documentation: the default arm touches one point with a tip 0.15 m in front of its
flange.
"""


def _example(body: Any) -> ConfigDict:
    return ConfigDict(json_schema_extra={"examples": [body]})


class ToolTip(RequestModel):
    """The pose of the TCP in the flange frame."""

    model_config = _example({"x": 0.0, "y": 0.0, "z": 0.15})

    x: TipCoordinate = Field(0.0, description="m")
    y: TipCoordinate = Field(0.0, description="m")
    z: TipCoordinate = Field(0.0, description="m")
    a: Angle = Field(0.0, description="KUKA angle A about z, rad")
    b: Angle = Field(0.0, description="KUKA angle B about the new y, rad")
    c: Angle = Field(0.0, description="KUKA angle C about the newest x, rad")
    quaternion: list[Finite] | None = Field(
        None, min_length=4, max_length=4, description="x, y, z, w of length 1, instead of a, b and c."
    )

    @model_validator(mode="after")
    def _one_orientation(self) -> ToolTip:
        if self.quaternion is not None and {"a", "b", "c"} & self.model_fields_set:
            raise ValueError("give either quaternion or a, b and c")
        return self


class ToolShape(PutObject):
    """A solid of the tool. The pose is the pose of its centre in the flange frame."""

    model_config = _example(
        {"shape": "cylinder", "radius": 0.05, "length": 0.1, "x": 0.0, "y": 0.0, "z": 0.06}
    )

    touch: list[str] = Field([], max_length=100, description="Bodies and objects that the shape may touch.")

    @model_validator(mode="after")
    def _on_the_flange(self) -> ToolShape:
        if self.frame_id:
            raise ValueError("frame_id: omit it; a shape of the tool is always given in the flange's frame")
        if self.mass:
            raise ValueError("mass: omit it; the mass of a shape is part of the tool's mass")
        return self


class ChangeTool(RequestModel):
    """A change of the tool. Omitted fields keep their values, but mass, centre and inertia are set
    together.
    """

    model_config = _example(
        {"name": "gripper", "mass": 1.2, "centre": [0.0, 0.0, 0.06], "inertia": INERTIA, "tcp": {"z": 0.15}}
    )

    clear: bool = Field(False, description="true: first reset the tool to the bare flange of the model file.")
    name: Annotated[str, Field(max_length=64)] | None = Field(None, description="Displayed name.")
    mass: Finite | None = Field(
        None,
        description="Mass of tool and load, kg, in addition to the masses of the model. Maximum: "
        "robot.max_payload_kg.",
    )
    centre: list[Finite] | None = Field(
        None, min_length=3, max_length=3, description="Centre of that mass: x, y, z in the flange's frame, m."
    )
    inertia: list[Finite] | None = Field(
        None,
        min_length=6,
        max_length=6,
        description="Inertia about the centre of mass, along the flange's axes: xx, xy, xz, yy, yz, zz, "
        "kg·m².",
    )
    tcp: ToolTip | None = Field(
        None, description="Pose of the TCP in the flange frame; null: the TCP of the model's file."
    )
    shapes: Annotated[dict[Name, ToolShape], limit_entries(50)] | None = Field(
        None,
        max_length=50,
        description="Solids for the collision checks, by name; they replace the previous ones.",
    )
    gravity: list[Finite] | None = Field(
        None,
        min_length=3,
        max_length=3,
        description="Gravitational acceleration in the base frame, m/s², for a tilted base; null: the value "
        "of the model's file.",
    )

    @model_validator(mode="after")
    def _says_something(self) -> ChangeTool:
        given = self.model_fields_set
        if not given:
            raise ValueError(f"nothing to change; valid fields: {', '.join(type(self).model_fields)}")
        if {"centre", "inertia"} & given and self.mass is None:
            raise ValueError("mass: is missing; required with centre or inertia")
        return self


class TouchedPoints(RequestModel):
    """Joint positions that each place the tool's tip on the same fixed point."""

    model_config = _example({"points": EXAMPLE_POINTS})

    points: list[Joints] = Field(
        min_length=MIN_POSES,
        max_length=MAX_POSES,
        description="Joint positions, between which the flange turns by 20° or more, about two axes in "
        "total.",
    )


class TcpFitAnswer(BaseModel):
    """The TCP that fits the points best. Nothing has changed yet."""

    model_config = _example(
        {"position": [0.0, 0.0, 0.15], "point": [0.5, 0.0, 0.3], "error_m": 0.0004, "errors_m": [0.0004] * 4}
    )

    position: list[float] = Field(description="Position of the TCP in the flange frame: x, y, z, m.")
    point: list[float] = Field(description="The touched point in the base frame: x, y, z, m.")
    error_m: float = Field(description="Root mean square of `errors_m`, m.")
    errors_m: list[float] = Field(
        description="Distance of the tip from the touched point, for each joint position, m."
    )


class ToolAnswer(BaseModel):
    """The current tool, in the flange frame."""

    model_config = _example(
        {
            "version": 3,
            "name": "gripper",
            "mass": 1.2,
            "centre": [0.0, 0.0, 0.06],
            "inertia": INERTIA,
            "position": [0.0, 0.0, 0.15],
            "quaternion": [0.0, 0.0, 0.0, 1.0],
            "shapes": [],
            "gravity": [0.0, 0.0, -9.81],
            "contacts": [],
        }
    )

    version: int = Field(description="Version number, which increases with each change; 0: never changed.")
    name: str = Field(description="The name of the tool.")
    mass: float = Field(description="Mass of tool and load, kg.")
    centre: list[float] = Field(description="Centre of that mass: x, y, z, m.")
    inertia: list[float] | None = Field(
        description="Inertia about the centre of mass: xx, xy, xz, yy, yz, zz, kg·m²; or none."
    )
    position: list[float] = Field(description="Position of the TCP: x, y, z, m.")
    quaternion: list[float] = Field(description="Orientation of the TCP: x, y, z, w.")
    shapes: list[ObjectAnswer] = Field(
        description="Shapes of the tool for collision checks, in the flange frame."
    )
    gravity: list[float] = Field(description="Gravitational acceleration in the base frame, m/s².")
    contacts: list[str] = Field(
        description="After a change: bodies and objects that the arm touches or nearly touches now."
    )
