"""Convex solids of a mesh for collision checking: its hull, or several solids if the hull would be wrong.

A hull is wrong if it fills much free space, such as the inside of a yoke. This is measured on a grid, as the
depth in the hull of the cells that the mesh neither touches nor encloses.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy import ndimage

from cobot.errors import InputError
from cobot.robot.geometry.mesh import Indices, cells_met, cells_outside
from cobot.types import Array

VOID_M, VOID_SHARE = 0.02, 0.1
"""Limits for a hull: a distance, m, and a share of the mesh's size. A hull is wrong if one of its points
is further from the mesh than both.
"""
CELLS = 24
"""Number of grid cells along the longest side."""
CLUSTERS = 40
"""Number of cells along the longest side of the mesh. Before the decomposition, all vertices of a cell are
merged.
"""
MAX_SOLIDS = 8
CONCAVITY = 0.12
"""Concavity above which a solid is divided again, as a share of the solid's size."""
THICKNESS_SHARE, MIN_THICKNESS_M = 1e-3, 1e-3
"""Thickness that a flat mesh gets: a share of its size or a length, m, whichever is greater."""
COVERED_M = 1e-4


@dataclass(frozen=True, slots=True)
class Solids:
    """The convex solids of a mesh.

    Attributes:
        solids: convex hulls with outward faces.
        void_m: depth of the free space that the hull of the whole mesh fills.
        is_wrong: whether this depth is too large.
        flat: whether the mesh was flat and was given a thickness.
    """

    solids: list[trimesh.Trimesh]
    void_m: float
    is_wrong: bool
    flat: bool


def solids(vertices: Array, triangles: Indices, split: bool) -> Solids:
    """The solids that cover a mesh.

    Args:
        split: whether several solids cover a mesh whose hull would be wrong.

    Raises:
        InputError: the mesh is a line or a point.
    """
    corners = np.unique(vertices[np.unique(triangles)], axis=0)
    thick = _with_thickness(corners)
    if len(thick) != len(corners):
        return Solids([_hull(thick)], 0.0, False, True)
    hull = _hull(corners)
    size_m = float(np.ptp(corners, axis=0).max())
    void_m = _void(vertices, triangles, hull, size_m)
    is_wrong = void_m > max(VOID_M, VOID_SHARE * size_m)
    found = _decomposed(vertices, triangles, size_m) if split and is_wrong else [hull]
    return Solids(found, void_m, is_wrong, False)


def write_stl(file: Path, solid: trimesh.Trimesh) -> None:
    file.write_bytes(trimesh.exchange.stl.export_stl(solid))


def _hull(points: Array) -> trimesh.Trimesh:
    return trimesh.convex.convex_hull(points)


def _with_thickness(corners: Array) -> Array:
    """The points of a mesh. A flat mesh gets a second side, so that it has a volume."""
    middle = corners.mean(axis=0)
    _, _, axes = np.linalg.svd(corners - middle, full_matrices=False)
    extents = np.ptp((corners - middle) @ axes.T, axis=0)
    if len(corners) < 3 or not extents[1] > 1e-6 * extents[0]:
        raise InputError("is a line or a point, not a surface")
    thickness_m = max(THICKNESS_SHARE * extents[0], MIN_THICKNESS_M)
    if len(corners) > 3 and extents[2] > 1e-2 * thickness_m:
        return corners
    normal = np.cross(axes[0], axes[1])
    return np.concatenate([corners - 0.5 * thickness_m * normal, corners + 0.5 * thickness_m * normal])


def _void(vertices: Array, triangles: Indices, hull: trimesh.Trimesh, size_m: float) -> float:
    """The greatest distance of a point in the hull from the mesh and its interior, m. The result is accurate
    to one cell.
    """
    low = vertices[triangles].min(axis=(0, 1))
    high = vertices[triangles].max(axis=(0, 1))
    counts = np.maximum(1, np.ceil((high - low) / (size_m / CELLS) - 1e-9)).astype(np.int64)
    edges = (high - low) / counts
    full = np.zeros(counts + 2, dtype=bool)
    met = cells_met((vertices[triangles] - low) / edges, counts) + 1
    full[met[:, 0], met[:, 1], met[:, 2]] = True
    away = ndimage.distance_transform_edt(cells_outside(full), sampling=edges)
    cells = np.argwhere(away > 0.0)
    middles = low + (cells - 0.5) * edges
    normals, offsets = hull.face_normals, np.einsum("ij,ij->i", hull.face_normals, hull.triangles[:, 0])
    inside = np.ones(len(cells), dtype=bool)
    for normal, offset in zip(normals, offsets, strict=True):
        rest = np.flatnonzero(inside)
        inside[rest] = middles[rest] @ normal <= offset
    depths = away[tuple(cells[inside].T)]
    return float(depths.max()) if len(depths) else 0.0


def _decomposed(vertices: Array, triangles: Indices, size_m: float) -> list[trimesh.Trimesh]:
    """Decompose a coarser mesh with CoACD, then let each solid grow until all together cover the mesh.

    Source: Wei et al., "Approximate convex decomposition for 3D meshes with collision-aware concavity and
    tree search", 2022.
    """
    import coacd

    coacd.set_log_level("error")
    coarse, faces = _clustered(vertices, triangles, size_m / CLUSTERS)
    parts = coacd.run_coacd(
        coacd.Mesh(coarse, faces),
        threshold=CONCAVITY,
        max_convex_hull=MAX_SOLIDS,
        preprocess_mode="auto",
        preprocess_resolution=15,
        resolution=500,
        mcts_nodes=10,
        mcts_iterations=10,
        mcts_max_depth=2,
        seed=0,
    )
    hulls = [_hull(_with_thickness(np.asarray(corners, float))) for corners, _ in parts]
    return _covering(
        hulls, np.concatenate([vertices[triangles].mean(axis=1), vertices[np.unique(triangles)]])
    )


def _clustered(vertices: Array, triangles: Indices, cell_m: float) -> tuple[Array, Indices]:
    """The mesh after merging all vertices in the same cell."""
    _, first, places = np.unique(np.round(vertices / cell_m), axis=0, return_index=True, return_inverse=True)
    faces = places.reshape(-1)[triangles]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    _, kept = np.unique(np.sort(faces[distinct], axis=1), axis=0, return_index=True)
    return vertices[first], faces[distinct][kept]


def _covering(hulls: list[trimesh.Trimesh], points: Array) -> list[trimesh.Trimesh]:
    """The hulls, extended so that they cover all points: each point outside all hulls is added to the closest
    hull.
    """
    outside = np.stack([_beyond(hull, points) for hull in hulls])
    nearest, missed = outside.argmin(axis=0), outside.min(axis=0) > COVERED_M
    return [
        _hull(np.concatenate([hull.vertices, points[missed & (nearest == index)]]))
        for index, hull in enumerate(hulls)
    ]


def _beyond(hull: trimesh.Trimesh, points: Array) -> Array:
    """How far each point lies outside the planes of the hull. Shape: (n,), in m."""
    most = np.full(len(points), -np.inf)
    for normal, corner in zip(hull.face_normals, hull.triangles[:, 0], strict=True):
        most = np.maximum(most, (points - corner) @ normal)
    return most
