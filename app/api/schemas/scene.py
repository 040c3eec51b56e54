"""The scene as JSON."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from app.api.schemas.names import Name
from cobot.loose_lists import RequestModel
from cobot.motions.fields import Angle, Finite, Within, limit_entries
from cobot.robot.scene import SceneObject
from cobot.units import require_way

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False, description="m")]
PlaceCoordinate = Annotated[float, Field(allow_inf_nan=False), Within(require_way, 100.0)]
Length = Annotated[float, Field(ge=1e-4, le=100.0, allow_inf_nan=False)]
FIELDS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "mesh": ("vertices", "triangles"),
    "height_field": ("heights", "resolution"),
    "point_cloud": ("points", "voxel"),
}
"""Fields that each shape requires, unless it uses the fields in `ENCODED`."""
ENCODED = {"mesh": ("file",), "point_cloud": ("points_base64", "voxel")}
"""Alternative fields of a shape. If the first one is given, the shape requires these instead of those in
`FIELDS`.
"""
OPTIONAL = {"mesh": ("scale", "tolerance"), "height_field": ("floor", "step")}
SHAPE_FIELDS = list(
    dict.fromkeys(name for each in (FIELDS, ENCODED, OPTIONAL) for names in each.values() for name in names)
)
MAX_POINTS = 200_000
Point = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
Indices = Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=3, max_length=3)]


def _example(body: Any) -> ConfigDict:
    return ConfigDict(json_schema_extra={"examples": [body]})


class Place(RequestModel):
    """A pose in a frame."""

    model_config = _example({"x": 0.5, "y": 0.2, "z": 0.1, "a": 0.5})

    x: PlaceCoordinate = Field(description="m")
    y: PlaceCoordinate = Field(description="m")
    z: PlaceCoordinate = Field(description="m")
    a: Angle = Field(0.0, description="KUKA angle A about z, rad")
    b: Angle = Field(0.0, description="KUKA angle B about the new y, rad")
    c: Angle = Field(0.0, description="KUKA angle C about the newest x, rad")
    frame_id: str = Field(
        "",
        max_length=200,
        description="Frame of the pose: empty for the base, a named frame, or a frame of the model that no "
        "joint moves. The frame's current pose is used.",
    )


class PutObject(Place):
    """A solid. The pose is the pose of its centre or, for a mesh, a height field or a point cloud, of its own
    origin.
    """

    model_config = _example({"shape": "box", "size": [0.3, 0.4, 0.02], "x": 0.5, "y": -0.6, "z": 0.2})

    shape: Literal["box", "sphere", "cylinder", "capsule", "mesh", "height_field", "point_cloud"] = Field(
        description="Kind of the solid."
    )
    size: list[Length] | None = Field(
        None, min_length=3, max_length=3, description="For a box: edges along its x, y and z axes, m."
    )
    radius: Length | None = Field(None, description="For a sphere, cylinder or capsule: radius, m.")
    length: Length | None = Field(
        None,
        description="For a cylinder or capsule: length along its z axis, m; for a capsule without the "
        "round ends.",
    )

    file: str | None = Field(
        None,
        max_length=40_000_000,
        description="For a mesh: an STL (binary or text) or OBJ file as base64, instead of `vertices` and "
        "`triangles`.",
    )
    vertices: list[Point] | None = Field(
        None, max_length=60_000, fail_fast=True, description="For a mesh: vertices, x, y, z each, m."
    )
    triangles: list[Indices] | None = Field(
        None,
        max_length=20_000,
        fail_fast=True,
        description="For a mesh: triangles, each with three indices of vertices from 0.",
    )
    scale: Annotated[float, Field(ge=1e-6, le=1e6, allow_inf_nan=False)] = Field(
        1.0, description="For a mesh: scale, for example 0.001 for a file in mm."
    )
    tolerance: Length = Field(
        0.02,
        description="For a mesh that is not convex: maximum deviation of the solids that replace it, m.",
    )
    heights: list[Annotated[list[Coordinate | None], Field(fail_fast=True)]] | None = Field(
        None,
        fail_fast=True,
        max_length=2000,
        description="For a height field: a list of rows along y, each with heights along x, m; null: an "
        "empty cell.",
    )
    resolution: Length | None = Field(
        None, description="For a height field: edge of a cell, m. The corner of the first cell is the origin."
    )
    floor: Coordinate = Field(0.0, description="For a height field: height of the bottom of its columns, m.")
    step: Length | None = Field(
        None,
        description="For a height field: heights are rounded up to multiples of this value, m; null: exact.",
    )
    points: list[Point] | None = Field(
        None,
        min_length=1,
        max_length=MAX_POINTS,
        fail_fast=True,
        description="For a point cloud: points, x, y, z each, m.",
    )
    points_base64: str | None = Field(
        None,
        max_length=16 * MAX_POINTS,
        description="For a large point cloud, instead of `points`: x, y, z of one point after the other, m, "
        "as float32 numbers, little-endian, in base64.",
    )
    voxel: Length | None = Field(
        None, description="For a point cloud: edge of the voxels, m; a voxel that contains a point is solid."
    )
    mass: Annotated[float, Field(ge=0.0, le=10_000.0, allow_inf_nan=False)] = Field(
        0.0,
        description="Mass, kg. The arm carries it in addition to the tool's mass while the object is "
        "attached.",
    )
    centre: list[Coordinate] | None = Field(
        None,
        min_length=3,
        max_length=3,
        description="Centre of mass: x, y, z from the object's centre along its own axes, m. Default: "
        "uniform density.",
    )
    inertia: list[Finite] | None = Field(
        None,
        min_length=6,
        max_length=6,
        description="Inertia about the centre of mass, along the object's own axes: xx, xy, xz, yy, yz, zz, "
        "kg·m². Default: uniform density.",
    )

    @model_validator(mode="after")
    def _of_some_mass(self) -> PutObject:
        if self.mass == 0.0 and {"centre", "inertia"} & self.model_fields_set:
            raise ValueError("mass: is missing; required with centre or inertia")
        return self

    @model_validator(mode="after")
    def _of_its_shape(self) -> PutObject:
        wanted, given = FIELDS[self.shape], self.model_fields_set
        encoded = ENCODED.get(self.shape, ())
        if encoded and getattr(self, encoded[0]) is not None:
            wanted, encoded = encoded, ()
        allowed = {*wanted, *OPTIONAL.get(self.shape, ())}
        for name in SHAPE_FIELDS:
            missing = name in wanted and getattr(self, name) is None
            if missing or (name in given and name not in allowed and getattr(self, name) is not None):
                problem = "is missing" if missing else "is not allowed"
                also = f", or {' and '.join(encoded)}" if encoded and name == wanted[0] else ""
                raise ValueError(f"{name} {problem}; a {self.shape} needs {' and '.join(wanted)}{also}")
        return self

    def numbers(self) -> tuple[float, ...]:
        """Return the numbers for `cobot.robot.scene.SceneObject.size`."""
        if self.size is not None:
            return tuple(self.size)
        return tuple(value for value in (self.radius, self.length) if value is not None)


class ChangeScene(RequestModel):
    """Changes to the scene, made in the order of these fields. Either all are made, or none."""

    model_config = _example(
        {"objects": {"table": {"shape": "box", "size": [0.3, 0.4, 0.02], "x": 0.5, "y": -0.6, "z": 0.2}}}
    )

    clear: bool = Field(False, description="Remove all objects, frames and allowed pairs first.")
    detach: list[Name] = Field(
        [],
        max_length=1000,
        fail_fast=True,
        description="Objects to release; each stays where it is now.",
    )
    frames: Annotated[dict[Name, Place | None], limit_entries(1000)] = Field(
        {}, max_length=1000, description="Frames by name, for `frame_id`; null deletes one."
    )
    objects: Annotated[dict[Name, PutObject | None], limit_entries(1000)] = Field(
        {}, max_length=1000, description="Solids by name, added or replaced; null removes one."
    )
    move: Annotated[dict[Name, Place], limit_entries(1000)] = Field(
        {},
        max_length=1000,
        description="New poses of objects by name. Shape, size and mass stay, so no file is needed again.",
    )
    attach: Annotated[dict[Name, Annotated[list[str], Field(max_length=100)]], limit_entries(1000)] = Field(
        {},
        max_length=1000,
        description="Objects to attach, each with the bodies and objects that it may touch.",
    )
    allowed: list[Pair] | None = Field(
        None,
        fail_fast=True,
        max_length=1000,
        description="Pairs of bodies and objects that may touch; they replace the previous pairs.",
    )

    @model_validator(mode="after")
    def _says_something(self) -> ChangeScene:
        if not self.model_fields_set:
            raise ValueError(f"nothing to change; valid fields: {', '.join(type(self).model_fields)}")
        return self


class ObjectAnswer(BaseModel):
    """A solid."""

    name: str = Field(description="Name of the object.")
    shape: str = Field(description="box, sphere, cylinder, capsule, mesh, height_field or point_cloud.")
    size: list[float] = Field(
        description="Size, m. Box: edges. Sphere: radius. Cylinder, capsule: radius and length. Others: "
        "edges of the bounding box."
    )
    solids: int = Field(
        1,
        description="Number of convex solids that represent the object in collision checks. For a point "
        "cloud: number of boxes that streams check; planners check its voxels.",
    )
    tolerance: float = Field(
        0.0,
        description="For a mesh: maximum deviation of these solids from it, m. For a point cloud: how far "
        "its boxes may reach beyond its voxels, m. 0: exact.",
    )
    voxels: int | None = Field(None, description="For a point cloud: number of its voxels.")
    voxel: float | None = Field(None, description="For a point cloud: edge of its voxels, m.")
    position: list[float] = Field(
        description="Position of the centre: x, y, z, m; in the base frame, or in the TCP frame if attached."
    )
    quaternion: list[float] = Field(description="Orientation in the same frame: x, y, z, w.")
    attached: bool = Field(description="Whether the object is attached to the tool.")
    touch: list[str] = Field(description="Bodies and objects that the object may touch while it is attached.")
    mass: float = Field(0.0, description="kg")
    centre: list[float] | None = Field(None, description="Centre of mass, m; null: uniform density.")
    inertia: list[float] | None = Field(
        None,
        description="Inertia about the centre of mass: xx, xy, xz, yy, yz, zz, kg·m²; null: uniform density.",
    )

    @classmethod
    def of(cls, name: str, each: SceneObject) -> ObjectAnswer:
        """Return an object in the scene or on the tool as JSON."""
        return cls(
            name=name,
            shape=each.shape,
            size=list(each.size),
            solids=each.solids,
            tolerance=each.tolerance,
            voxels=each.voxels if each.cells else None,
            voxel=each.voxel if each.cells else None,
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

    name: str = Field(description="Name of the frame.")
    position: list[float] = Field(description="Position in the base frame: x, y, z, m.")
    quaternion: list[float] = Field(description="Orientation in the base frame: x, y, z, w.")


class SceneAnswer(BaseModel):
    """The current scene."""

    model_config = _example({"version": 3, "objects": [], "frames": [], "allowed": []})

    version: int = Field(description="Version number, which increases with each change; 0: never changed.")
    objects: list[ObjectAnswer] = Field(description="The objects in the scene, including attached ones.")
    frames: list[FrameAnswer] = Field(description="Named frames.")
    allowed: list[list[str]] = Field(description="Pairs of bodies and objects that may touch.")


class ChangedAnswer(BaseModel):
    """The result of a change to the scene."""

    model_config = _example({"version": 4, "stopped": "", "contacts": []})

    version: int = Field(description="New version of the scene.")
    stopped: str = Field(description="Reason why the current motion was stopped; empty if it was not.")
    contacts: list[str] = Field(description="Bodies and objects that the arm touches or nearly touches now.")
