"""Convex collision solids of parts and fixtures whose shape is a mesh file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from cobot.errors import CobotError, ConfigError, InputError, LimitError
from cobot.foreign import plain_text
from cobot.robot.geometry import mesh
from cobot.types import Array, Numbers3, Numbers6

MAX_FILE_BYTES = 20_000_000
MAX_SOLIDS = 64
"""Maximum number of convex solids of one body, because every cycle searches for their contacts."""
MIN_EDGE_M = 0.002


@dataclass(frozen=True, slots=True)
class MeshShape:
    """A mesh. The centre of its bounding box is the origin. All lengths are in m.

    Attributes:
        size: lengths of the edges of the bounding box.
        boxes: centre and edges of each box.
        hulls: corners of each convex solid that is not a box.
        vertices, triangles: the mesh of the file as flat sequences of numbers.
    """

    size: Numbers3
    boxes: tuple[Numbers6, ...]
    hulls: tuple[tuple[Numbers3, ...], ...]
    vertices: tuple[float, ...]
    triangles: tuple[int, ...]


def mesh_shape(
    folder: Path, name: str, scale: float, tolerance_m: float, hull: bool, max_m: float
) -> MeshShape:
    """Read a mesh file.

    Args:
        folder: the cell file's folder, which must contain the mesh.
        scale: metres per file unit.
        tolerance_m: how far boxes may reach beyond non-convex parts of the mesh.
        hull: whether the body is the convex hull of the mesh.
        max_m: maximum length of an edge of the bounding box.

    Raises:
        ConfigError: the file does not exist, or cannot be used as a body of a cell; the message gives the
            reason.
    """
    try:
        file = file_beside(folder, name)
        status = file.stat()
        if status.st_size > MAX_FILE_BYTES:
            raise ConfigError(
                f"file: {plain_text(name)} has {status.st_size / 1e6:.1f} MB, allowed: "
                f"{MAX_FILE_BYTES / 1e6:g} MB: simplify the mesh"
            )
        return _read(file, status.st_mtime_ns, status.st_size, scale, tolerance_m, hull, max_m)
    except (OSError, ValueError) as exc:
        raise ConfigError(f"file: {plain_text(name)}: {getattr(exc, 'strerror', None) or exc}") from exc


def file_beside(folder: Path, name: str) -> Path:
    """The file at a path that a cell file contains. The path is relative to the folder of the cell file.

    Raises:
        ConfigError: the file is missing, or outside the folder.
    """
    file = (folder / name).resolve()
    beyond = Path(name).is_absolute() or ".." in Path(name).parts
    if beyond or not file.is_relative_to(folder.resolve()):
        raise ConfigError(
            f"file: {plain_text(name)} is outside the folder of the cell file; copy it there, and name it "
            "by its path from there"
        )
    if not file.is_file():
        raise ConfigError(f"file: {plain_text(folder / name)}: no such file")
    return file


@lru_cache(maxsize=128)
def _read(
    file: Path, _changed: int, _size: int, scale: float, tolerance_m: float, hull: bool, max_m: float
) -> MeshShape:
    """Read a file. The result is cached until the file changes."""
    try:
        vertices, triangles = mesh.read(file.read_bytes())
        if not len(triangles) or not 0 <= triangles.min() <= triangles.max() < len(vertices):
            raise InputError(
                "triangles: the mesh has no triangles, or one of them refers to a vertex that does not exist"
            )
        if not np.isfinite(vertices).all():
            raise InputError("vertices: a coordinate is not a finite number")
        # Each vertex once, and only vertices that are part of the shape.
        vertices, numbers = np.unique(vertices[triangles.ravel()], axis=0, return_inverse=True)
        triangles = numbers.reshape(-1, 3)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        size = scale * (high - low)
        if not (size.min() >= MIN_EDGE_M and size.max() <= max_m):
            edges = " x ".join(f"{edge:.4g}" for edge in size)
            raise InputError(
                f"the bounding box is {edges} m, allowed: edges of {MIN_EDGE_M:g} to {max_m:g} m: set "
                "scale, 0.001 for a file in mm"
            )
        vertices = scale * (vertices - 0.5 * (low + high))
        boxes, hulls = _solids(vertices, triangles, tolerance_m, hull)
    except LimitError as exc:
        raise ConfigError(f"file: {file.name}: {exc}; set tolerance_m, or hull: true") from exc
    except CobotError as exc:
        raise ConfigError(f"file: {file.name}: {str(exc).removeprefix('file: ')}") from exc
    return MeshShape(
        _three(size),
        tuple(_six(box) for box in boxes),
        tuple(tuple(_three(corner) for corner in each) for each in hulls),
        tuple(vertices.ravel().tolist()),
        tuple(triangles.ravel().tolist()),
    )


def _solids(
    vertices: Array, triangles: mesh.Indices, tolerance_m: float, hull: bool
) -> tuple[Array, list[Array]]:
    """Boxes, and the corners of all other convex solids; see `mesh.parts`."""
    if not hull:
        return mesh.parts(vertices, triangles, tolerance_m, MAX_SOLIDS)
    corners = np.unique(vertices, axis=0)
    if len(corners) > mesh.MAX_CORNERS:
        raise InputError(
            f"the mesh has {len(corners)} corners, allowed: {mesh.MAX_CORNERS}; simplify the mesh"
        )
    return np.zeros((0, 6)), [corners]


def _three(values: Array) -> Numbers3:
    x, y, z = values.tolist()
    return x, y, z


def _six(values: Array) -> Numbers6:
    x, y, z, length, width, height = values.tolist()
    return x, y, z, length, width, height
