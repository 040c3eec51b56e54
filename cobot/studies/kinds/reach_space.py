"""The poses of a reach study: places in a box or on a surface, and orientations of the TCP at each place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from cobot.config import Location
from cobot.errors import ConfigError, InputError
from cobot.robot.quaternion import from_matrix
from cobot.strict import StrictModel, shown
from cobot.studies.robot_choice import Finite, hash_of_file, numbers7
from cobot.types import Array, Pose

MAX_PLACES = 5_000_000
MAX_DIRECTIONS = 1000
DOWN = ((0.0, 0.0, -1.0),)
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""Angle between consecutive directions of a spiral that covers a sphere evenly."""
PARALLEL = 0.9
"""If the cosine of the angle between a direction and the x axis is above this value, the y axis is used to
define the spin.
"""

Vector3 = Annotated[list[Finite], Field(min_length=3, max_length=3)]


class BoxSpace(StrictModel):
    """The grid in a box: from `low` in steps of the spacing up to `high`, m in the base frame."""

    low: Vector3
    high: Vector3

    @model_validator(mode="after")
    def _require_order(self) -> Self:
        for axis, low, high in zip("xyz", self.low, self.high, strict=True):
            if low > high:
                raise ValueError(f"low {axis} is {low:g}; it must be at most high {axis}, which is {high:g}")
        return self


class MeshSpace(StrictModel):
    """Places on the surface of a mesh.

    Attributes:
        file: STL, OBJ, PLY or another file that trimesh reads; in m.
        pose: x, y, z (m) and w, x, y, z of the mesh in the base frame.
        standoff_m: distance of the places from the surface, on its outer side.
    """

    file: Location
    pose: Annotated[list[Finite], Field(min_length=7, max_length=7)] = Field(
        default_factory=lambda: [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    )
    standoff_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class PlacesSpace(StrictModel):
    """Either a box or a mesh.

    Attributes:
        spacing_m: distance between neighbouring places.
    """

    box: BoxSpace | None = None
    mesh: MeshSpace | None = None
    spacing_m: Annotated[float, Field(gt=0.0, le=10.0)]

    @model_validator(mode="after")
    def _require_one(self) -> Self:
        if (self.box is None) == (self.mesh is None):
            raise ValueError("must have either box or mesh")
        return self

    def contents(self) -> dict[str, str]:
        """Hashes of the files that are used, by readable names."""
        return {} if self.mesh is None else {"mesh": hash_of_file(self.mesh.file)}


@dataclass(frozen=True, slots=True)
class Places:
    """Positions (m) in the base frame, and the outward normals at these positions. Both have shape (n, 3).
    The places of a box have no normals (None).
    """

    positions: Array
    normals: Array | None


def places_of(space: PlacesSpace) -> Places:
    """The places of a space.

    Raises:
        InputError: there are too many places.
        ConfigError: the mesh cannot be read.
    """
    if space.box is not None:
        return Places(_grid(space.box, space.spacing_m), None)
    assert space.mesh is not None
    return _surface(space.mesh, space.spacing_m)


def _grid(box: BoxSpace, spacing_m: float) -> Array:
    edges = np.array(box.high) - np.array(box.low)
    counts = np.floor(edges / spacing_m + 1e-9).astype(np.int64) + 1
    _require_few(float(np.prod(counts.astype(float))), spacing_m)
    axes = [low + spacing_m * np.arange(count) for low, count in zip(box.low, counts, strict=True)]
    # The z axis changes slowest, so that the first part of the results is the lower part of the space.
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def _require_few(places: float, spacing_m: float) -> None:
    if places > MAX_PLACES:
        raise InputError(
            f"space.spacing_m: {spacing_m:g} gives {places:.3g} places, allowed: {MAX_PLACES}; use a "
            "larger spacing"
        )


def _surface(mesh: MeshSpace, spacing_m: float) -> Places:
    """Points on the surface. They are the middles of its triangles, which are divided until no edge is longer
    than the spacing.
    """
    vertices, triangles = read_mesh(mesh.file)
    corners = vertices[triangles]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(normals, axis=1)
    solid = sizes > 0.0
    parts = np.maximum(1, np.ceil(lengths[solid] / spacing_m)).astype(np.int64)
    _require_few(float((parts.astype(float) ** 2).sum()), spacing_m)
    positions, directions = [], []
    for corner, normal, count in zip(corners[solid], normals[solid] / sizes[solid, None], parts, strict=True):
        weights = _middles(int(count))
        positions.append(weights @ corner)
        directions.append(np.broadcast_to(normal, (len(weights), 3)))
    pose = Pose.from_numbers(numbers7(list(mesh.pose), "space.mesh.pose"))
    outside = np.vstack(directions) @ pose.rotation.T
    return Places(pose.apply(np.vstack(positions)) + mesh.standoff_m * outside, outside)


def _middles(parts: int) -> Array:
    """Barycentric coordinates of the middles of `parts`² equal triangles, shape (`parts`², 3)."""
    rows = []
    for i in range(parts):
        for j in range(parts - i):
            rows.append((i + 1 / 3, j + 1 / 3))
            if j < parts - i - 1:
                rows.append((i + 2 / 3, j + 2 / 3))
    pairs = np.array(rows) / parts
    return np.column_stack([1.0 - pairs.sum(axis=1), pairs])


def read_mesh(path: Path) -> tuple[Array, np.ndarray]:
    """Read a mesh. Returns its vertices (m), shape (n, 3), and its triangles, shape (m, 3).

    Raises:
        ConfigError: the file is missing or is not a mesh.
    """
    import trimesh

    if not path.is_file():
        raise ConfigError(f"space.mesh.file: {path}: no such file")
    try:
        found = trimesh.load_mesh(path)
        vertices, triangles = np.array(found.vertices, dtype=float), np.array(found.faces, dtype=np.int64)
    except Exception as exc:
        raise ConfigError(f"space.mesh.file: {path}: cannot be read as a mesh: {exc}") from exc
    if not len(triangles) or not np.isfinite(vertices).all():
        raise ConfigError(f"space.mesh.file: {path}: has no triangles")
    return vertices, triangles


def _checked_approach(value: Any) -> Any:
    """Check `approach`. This gives a single error message instead of one for each alternative."""
    if value in ("down", "inward") or (type(value) is int and 1 <= value <= MAX_DIRECTIONS):
        return value
    if isinstance(value, list) and 0 < len(value) <= MAX_DIRECTIONS and all(map(_is_direction, value)):
        return value
    raise ValueError(
        f"must be down, inward, a number of directions from 1 to {MAX_DIRECTIONS}, or a list of directions "
        f"[x, y, z], got {shown(value)}"
    )


def _is_direction(value: Any) -> bool:
    if not isinstance(value, list) or len(value) != 3:
        return False
    if not all(type(number) in (int, float) and abs(number) <= 1e6 for number in value):
        return False
    return any(number != 0 for number in value)


Approach = Annotated[Any, BeforeValidator(_checked_approach)]
"""Directions of the TCP's z axis. down: downwards. inward: against the normals of a mesh. A number: that many
directions, which cover the sphere evenly. Or a list of directions.
"""


def orientations(approach: Any, spins: int, normal: Array | None) -> Array:
    """Quaternions w, x, y, z of the TCP at a place, shape (n, 4).

    Args:
        spins: number of turns about each direction, evenly spaced from 0.
        normal: normal of the surface, for the approach inward.
    """
    found = []
    for direction in _directions(approach, normal):
        z = direction / np.linalg.norm(direction)
        mark = np.array([0.0, 1.0, 0.0]) if abs(z[0]) > PARALLEL else np.array([1.0, 0.0, 0.0])
        x = mark - (mark @ z) * z
        x /= np.linalg.norm(x)
        y = np.cross(z, x)
        for angle in 2.0 * np.pi * np.arange(spins) / spins:
            first = np.cos(angle) * x + np.sin(angle) * y
            matrix = np.column_stack([first, np.cross(z, first), z])
            found.append(from_matrix(matrix.ravel().tolist()))
    return np.array(found)


def _directions(approach: Any, normal: Array | None) -> Array:
    if approach == "inward":
        if normal is None:
            raise InputError(
                "approach: inward needs space.mesh, because a box has no surface; use down or directions"
            )
        return -normal[None, :]
    if approach == "down":
        return np.array(DOWN)
    if isinstance(approach, int):
        heights = 1.0 - (2.0 * np.arange(approach) + 1.0) / approach
        radii, angles = np.sqrt(1.0 - heights**2), GOLDEN * np.arange(approach)
        return np.column_stack([radii * np.cos(angles), radii * np.sin(angles), heights])
    return np.array(approach, dtype=float)
