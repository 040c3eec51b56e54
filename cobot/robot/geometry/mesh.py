"""A triangle mesh as convex solids: exact for convex parts, and boxes within a tolerance for all other parts.

Each connected part is examined separately. A closed convex part is its own hull. All other parts become grid
cells: those that their triangles meet, and those that these cells enclose. The diagonal of a cell is the
tolerance: the boxes contain every point of the mesh, and reach at most the tolerance beyond it. Exception: a
cavity is filled if its entry is not wider than a cell.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cobot.errors import InputError, LimitError
from cobot.robot.geometry.solids import MAX_SOLIDS, coarser, joined
from cobot.types import Array

Indices = npt.NDArray[np.int64]
MAX_TRIANGLES = 20_000
MAX_CELLS = 300_000
"""Maximum number of cells in the grid around non-convex parts."""
MAX_CORNERS = 2_000
"""Maximum number of corners of all convex parts together."""
AT_ONCE = 200_000
"""Number of pairs of a triangle and a cell that are tested together."""
FLAT = 1e-6
"""A part is considered convex if no corner is outside a face by more than this share of the part's size."""


def parts(
    vertices: Array, triangles: Indices, tolerance_m: float, most: int = MAX_SOLIDS
) -> tuple[Array, list[Array]]:
    """The convex solids of a mesh.

    Args:
        vertices: coordinates of the vertices, shape (n, 3), m.
        triangles: indices of the vertices of each triangle, shape (m, 3).
        most: maximum number of solids.

    Returns:
        Middle and edges of each box, shape (k, 6), m, and the corners of each convex part, shape (n, 3) each,
        m.

    Raises:
        InputError: the mesh is invalid.
        LimitError: there are too many triangles or corners, or more solids than `most`. For too many solids,
            the message gives a tolerance that fits.
    """
    vertices, triangles = _weld(vertices, triangles)
    hulls, others = [], []
    for group in _components(len(vertices), triangles):
        if _is_convex(vertices, group):
            hulls.append(vertices[np.unique(group)])
        else:
            others.append(group)
    corners_count = sum(len(hull) for hull in hulls)
    if corners_count > MAX_CORNERS:
        raise LimitError(
            f"mesh: its convex parts have {corners_count} corners, allowed: {MAX_CORNERS}; simplify the mesh"
        )
    if len(hulls) > most:
        raise LimitError(f"mesh: has {len(hulls)} convex parts, allowed: {most}")
    if not others:
        return np.zeros((0, 6)), hulls
    return _fitting(vertices[np.concatenate(others)], tolerance_m, most - len(hulls)), hulls


def _weld(vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """The mesh after removing duplicate corners and triangles of zero area."""
    vertices = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
    triangles = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    if not len(triangles):
        raise InputError("triangles: the mesh has no triangles")
    if len(triangles) > MAX_TRIANGLES:
        raise LimitError(
            f"triangles: at most {MAX_TRIANGLES} are allowed, got {len(triangles)}: simplify the mesh"
        )
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        wrong = triangles[(triangles < 0) | (triangles >= len(vertices))][0]
        raise InputError(f"triangles: there is no vertex {wrong}; valid values: 0 to {len(vertices) - 1}")
    if not np.isfinite(vertices).all():
        raise InputError("vertices: a coordinate is not a finite number")
    size_m = float(np.ptp(vertices[triangles.ravel()], axis=0).max())
    if not size_m > 0.0:
        raise InputError("vertices: they are all at the same point")
    _, first, places = np.unique(
        np.round(vertices / (1e-7 * size_m)), axis=0, return_index=True, return_inverse=True
    )
    vertices, triangles = vertices[first], places.reshape(-1)[triangles]
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    solid = areas > 1e-14 * size_m**2
    if not solid.any():
        raise InputError("triangles: all have the area 0")
    return vertices, triangles[solid]


def _components(count: int, triangles: Indices) -> list[Indices]:
    """Groups of triangles that are connected through common corners."""
    least, before = np.arange(count), np.full(count, -1)
    while (least != before).any():  # each corner takes the lowest index among its neighbours
        before = least.copy()
        np.minimum.at(least, triangles, least[triangles].min(axis=1, keepdims=True))
        least = least[least]
    labels = least[triangles[:, 0]]
    order = np.argsort(labels, kind="stable")
    ends = [0, *(np.flatnonzero(np.diff(labels[order])) + 1).tolist(), len(triangles)]
    return [triangles[order[begin:end]] for begin, end in pairwise(ends)]


def _is_convex(vertices: Array, triangles: Indices) -> bool:
    """Whether a part is closed and no corner is outside any of its faces."""
    if len(np.unique(triangles)) > MAX_CORNERS:
        return False
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = {(int(a), int(b)) for a, b in edges}
    if len(there) != len(edges) or any((b, a) not in there for a, b in there):
        return False
    corners = vertices[np.unique(triangles)]
    size_m = float(np.ptp(corners, axis=0).max())
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    if float(np.einsum("ij,ij->", a - corners.mean(axis=0), normals)) < 0.0:
        normals = -normals  # all faces point inwards
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    if float(np.linalg.matrix_rank(corners - corners[0], tol=FLAT * size_m)) < 3:
        return False
    for normal, place in zip(normals, a, strict=True):
        if float(((corners - place) @ normal).max()) > FLAT * size_m:
            return False
    return True


def _fitting(corners: Array, tolerance_m: float, room: int) -> Array:
    """At most `room` boxes that cover the triangles with these `corners`, shape (n, 3, 3)."""
    boxes, cells = _boxes(corners, tolerance_m)
    if boxes is not None and len(boxes) <= room:
        return boxes

    def fits(tried_m: float) -> bool:
        tried, _ = _boxes(corners, tried_m)
        return tried is not None and len(tried) <= room

    made = f"{cells} cells, at most {MAX_CELLS}" if boxes is None else f"{len(boxes)} boxes, at most {room}"
    raise LimitError(
        f"mesh: its non-convex parts make {made} are allowed at a tolerance of {tolerance_m:g} m: "
        f"{coarser(fits, tolerance_m)}"
    )


def _boxes(corners: Array, tolerance_m: float) -> tuple[Array | None, int]:
    """The boxes, as rows of centre and edge lengths, shape (k, 6), and the number of cells. The boxes are
    None if there are too many cells.
    """
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    edge_m = tolerance_m / math.sqrt(3.0)
    counts = np.maximum(1, np.ceil((high - low) / edge_m - 1e-9)).astype(np.int64)
    total = math.prod(counts.tolist())
    if total > MAX_CELLS:
        return None, total
    # Cells of a flat part have the full edge length, half of it on each side.
    thin = (high - low) < 1e-9 * edge_m
    low = np.where(thin, low - 0.5 * edge_m, low)
    edges = np.where(thin, edge_m, (high - low) / counts)
    full = np.zeros(counts + 2, dtype=bool)
    met = cells_met((corners - low) / edges, counts) + 1
    full[met[:, 0], met[:, 1], met[:, 2]] = True
    boxes = joined((np.argwhere(~cells_outside(full)) - 1).astype(np.float64))
    first, last = low + boxes[:, :3] * edges, low + boxes[:, 3:] * edges
    return np.hstack([0.5 * (first + last), last - first]), total


def cells_outside(full: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The cells that can be reached from the first corner through cells that are not full."""
    free = ~full
    out = np.zeros_like(free)
    out[0, 0, 0] = True
    count = 0
    while (reached := int(out.sum())) != count:
        count = reached
        for axis in range(3):
            for way in (1, -1):
                ahead, open_ahead = (np.moveaxis(each, axis, 0)[::way] for each in (out, free))
                for index in range(1, len(ahead)):
                    ahead[index] |= ahead[index - 1] & open_ahead[index]
    return out


def cells_met(corners: Array, counts: Indices) -> Indices:
    """The cells that triangles meet or touch, shape (k, 3). The triangles have shape (n, 3, 3), the cells
    have edge 1, and the grid begins at the origin.

    Source for the test by separating axes: T. Akenine-Moller, "Fast 3D triangle-box overlap testing", 2001.
    """
    begin = np.clip(np.floor(corners.min(axis=1) - 1e-9), 0, counts - 1).astype(np.int64)
    end = np.clip(np.floor(corners.max(axis=1) + 1e-9), 0, counts - 1).astype(np.int64)
    spans = end - begin + 1
    numbers = spans.prod(axis=1)
    groups = np.cumsum(numbers) // AT_ONCE
    found = [
        _met_at_once(corners[rows], begin[rows], spans[rows], numbers[rows])
        for rows in np.split(np.arange(len(corners)), np.flatnonzero(np.diff(groups)) + 1)
    ]
    return np.asarray(np.concatenate(found))


def _met_at_once(
    corners: Array,
    begin: Indices,
    spans: Indices,
    numbers: Indices,
) -> Indices:
    """Test each triangle with each cell of its bounding box."""
    rows = np.repeat(np.arange(len(corners)), numbers)
    index = np.arange(len(rows)) - np.repeat(np.cumsum(numbers) - numbers, numbers)
    across, index = np.divmod(index, (spans[:, 1] * spans[:, 2])[rows])
    cells = begin[rows] + np.stack([across, *np.divmod(index, spans[rows, 2])], axis=1)
    sides = corners[:, [1, 2, 0]] - corners
    axes = [np.cross(sides[:, 0], sides[:, 1])]
    axes += [np.cross(unit, sides[:, side]) for unit in np.eye(3) for side in range(3)]
    for axis in axes:
        reach = 0.5 * np.abs(axis).sum(axis=1) * (1.0 + 1e-9) + 1e-12
        along = np.einsum("nij,nj->ni", corners, axis)
        middles = np.einsum("ij,ij->i", cells + 0.5, axis[rows])
        least, most = along.min(axis=1) - reach, along.max(axis=1) + reach
        near = (least[rows] <= middles) & (middles <= most[rows])
        cells, rows = cells[near], rows[near]
    return np.asarray(cells)


def read(content: bytes) -> tuple[Array, Indices]:
    """Read an STL (binary or text) or OBJ file.

    Returns:
        Vertices, shape (n, 3), and triangles, shape (m, 3).

    Raises:
        InputError: the content is neither STL nor OBJ.
    """
    try:
        if len(content) >= 84 and len(content) == 84 + 50 * int.from_bytes(content[80:84], "little"):
            record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
            corners = np.frombuffer(content, record, offset=84)["corners"].astype(np.float64).reshape(-1, 3)
            return corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
        lines = [line.split() for line in content.decode("utf-8").splitlines()]
        stl = [line[1:4] for line in lines if line[:1] == ["vertex"]]
        if stl:
            return np.array(stl, dtype=np.float64), np.arange(len(stl), dtype=np.int64).reshape(-1, 3)
        return _obj(lines)
    except (ValueError, IndexError) as exc:
        raise InputError(f"file: is not an STL or OBJ mesh: {exc}") from exc


def _obj(lines: list[list[str]]) -> tuple[Array, Indices]:
    vertices = [line[1:4] for line in lines if line[:1] == ["v"]]
    triangles = []
    for line in lines:
        if line[:1] == ["f"]:
            face = [int(corner.split("/")[0]) for corner in line[1:]]
            face = [index - 1 if index > 0 else len(vertices) + index for index in face]
            triangles += [[face[0], face[index], face[index + 1]] for index in range(1, len(face) - 1)]
    if not triangles:
        raise ValueError("the file contains no faces")
    return np.array(vertices, dtype=np.float64), np.array(triangles, dtype=np.int64)
