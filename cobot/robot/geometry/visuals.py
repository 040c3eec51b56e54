"""The appearance of a robot's links: the manifest next to its model, and the meshes that it names.

`cobot new-robot` writes the manifest `visuals.yaml`. A model that shares its folder with others has its own
manifest, which is named after it: `iiwa14.visuals.yaml` for `iiwa14.xml`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from cobot.errors import ConfigError, NotFoundError
from cobot.yaml_file import read_mapping

MANIFEST = "visuals.yaml"
MAX_MESH_BYTES = 50_000_000
NEEDED = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "mesh": ("file",),
}
"""The keys that describe each shape."""
Finite = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class Visual(BaseModel):
    """One entry of the manifest.

    Attributes:
        link: the body that carries it.
        position: in the link's frame, m.
        quaternion: w, x, y, z.
        color: red, green, blue and opacity; None means the mesh's own colours.
        scale: scale of a mesh along x, y, z.
        file: file of a mesh, relative to the manifest.
    """

    model_config = ConfigDict(extra="forbid", strict=False)

    link: str
    shape: Literal["box", "sphere", "cylinder", "capsule", "mesh"]
    position: Annotated[list[Finite], Field(min_length=3, max_length=3)]
    quaternion: Annotated[list[Finite], Field(min_length=4, max_length=4)]
    color: Annotated[list[Share], Field(min_length=4, max_length=4)] | None = None
    size: Annotated[list[Finite], Field(min_length=3, max_length=3)] | None = None
    radius: Annotated[list[Finite], Field(min_length=1, max_length=1)] | None = None
    length: Annotated[list[Finite], Field(min_length=1, max_length=1)] | None = None
    scale: Annotated[list[Finite], Field(min_length=3, max_length=3)] | None = None
    file: str | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        missing = [key for key in NEEDED[self.shape] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"a {self.shape} needs {' and '.join(missing)}")
        return self

    def sizes(self) -> list[float]:
        """The dimensions of the shape. Box: edges. Sphere: radius. Cylinder: radius and length. Mesh:
        scale.
        """
        if self.shape == "mesh":
            return self.scale or [1.0, 1.0, 1.0]
        return [*(self.size or []), *(self.radius or []), *(self.length or [])]


@dataclass(frozen=True, slots=True)
class RobotVisuals:
    """All entries of a manifest and their mesh files. `meshes` maps the file names in the entries to
    paths.
    """

    visuals: list[Visual]
    meshes: dict[str, Path]

    def number(self, visual: Visual) -> int | None:
        """The number of the visual's mesh, for `read_mesh`."""
        return None if visual.file is None else list(self.meshes).index(visual.file)

    def read_mesh(self, number: int) -> bytes:
        """The content of a mesh, as GLB.

        Raises:
            NotFoundError: there is no such mesh, or its file cannot be read or exceeds `MAX_MESH_BYTES`.
        """
        if not 0 <= number < len(self.meshes):
            raise NotFoundError(
                f"there is no mesh {number}; the robot has {len(self.meshes)}, numbered from 0"
            )
        file = list(self.meshes.values())[number]
        try:
            if (size := file.stat().st_size) > MAX_MESH_BYTES:
                raise NotFoundError(
                    f"mesh {number}: {file.name} has {size} bytes, allowed: {MAX_MESH_BYTES}; reduce it "
                    "and convert the robot again with `cobot new-robot`"
                )
            return file.read_bytes()
        except OSError as exc:
            raise NotFoundError(f"mesh {number}: {file.name} cannot be read: {exc.strerror}") from exc


def has_visuals(model_file: Path | None) -> bool:
    """Whether a manifest is next to the model."""
    return _manifest(model_file) is not None


def visuals_of(model_file: Path | None) -> RobotVisuals:
    """Read the manifest of a model; without one there are no visuals.

    Raises:
        ConfigError: the manifest is invalid, or names a mesh outside its folder.
    """
    manifest = _manifest(model_file)
    if manifest is None:
        return RobotVisuals([], {})
    try:
        entries = TypeAdapter(list[Visual]).validate_python(read_mapping(manifest).get("visuals"))
    except ValidationError as exc:
        first = exc.errors()[0]
        where = ".".join(str(each) for each in ("visuals", *first["loc"]))
        raise ConfigError(f"{manifest}: {where}: {first['msg']}, got {first['input']!r}"[:500]) from exc
    files = {each.file: _inside(manifest, each.file) for each in entries if each.file is not None}
    return RobotVisuals(entries, files)


def _manifest(model_file: Path | None) -> Path | None:
    if model_file is None:
        return None
    candidates = model_file.with_name(f"{model_file.stem}.{MANIFEST}"), model_file.with_name(MANIFEST)
    return next((file for file in candidates if file.is_file()), None)


def _inside(manifest: Path, name: str) -> Path:
    folder = manifest.parent.resolve()
    file = (folder / name).resolve()
    if not file.is_relative_to(folder):
        raise ConfigError(f"{manifest}: the mesh {name!r} is outside the folder of the manifest")
    return file
