"""Convex bodies around the geoms of a model, and the tree of spheres around each body; see `covers.pyx`."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b

import mujoco
import numpy as np
import numpy.typing as npt

from cobot.robot.cloud import lane_nodes
from cobot.robot.covers import cover
from cobot.robot.kept_arrays import KeptArrays
from cobot.types import Array

LOSS_M = 0.008
"""Maximum error of the spheres, m: a geom may be farther away than its spheres by this distance."""
FLOOR_M = 0.004
"""Radius below which a sphere is not divided further."""
SIDES = 24
"""Number of faces of the prism around a cylinder."""
NO_DEPTH = -1.0
"""Value of the inner radius if the depth of the centre inside the body is not known."""
_BOX_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
_Geom = mujoco.mjtGeom

_TREES, _NODES = KeptArrays(32_000_000), KeptArrays(32_000_000)
"""The spheres around each shape, and the same spheres in the frame of a joint or of the world."""


@dataclass(frozen=True, slots=True)
class _Shape:
    """A shape that is enclosed by spheres.

    Attributes:
        key: the same for equal shapes. A mesh is represented by its digest.
        make: computes the spheres around the shape.
    """

    key: tuple[Hashable, ...]
    make: Callable[[], Array]


def tree_around(mj: mujoco.MjModel, geom: int) -> Array:
    """The spheres around a geom, in the geom's own frame, as rows in the same format as the rows of `cover`.
    The caller must not change them.
    """
    shape = _shape(mj, geom)
    return _TREES.get(shape.key, shape.make)


def nodes_around(mj: mujoco.MjModel, geom: int, turn: Array, offset: Array) -> npt.NDArray[np.float32]:
    """The same spheres in the form of `lane_nodes`, turned by a matrix and moved by an offset.

    The caller must not change them, because an arm in a different scene uses the same array again.
    """
    shape = _shape(mj, geom)

    def make() -> npt.NDArray[np.float32]:
        return lane_nodes(_TREES.get(shape.key, shape.make), turn, offset)

    return _NODES.get((shape.key, turn.tobytes(), offset.tobytes()), make)


def _shape(mj: mujoco.MjModel, geom: int) -> _Shape:
    kind, size = int(mj.geom_type[geom]), mj.geom_size[geom].tolist()
    if kind == _Geom.mjGEOM_MESH:
        hull = _hull(mj, int(mj.geom_dataid[geom]))
        if hull is not None:
            digest = blake2b(hull[0].tobytes() + hull[1].tobytes(), digest_size=16).digest()
            return _Shape((kind, digest), partial(_mesh_tree, *hull))
    if kind in (_Geom.mjGEOM_SPHERE, _Geom.mjGEOM_CAPSULE):
        half = size[1] if kind == _Geom.mjGEOM_CAPSULE else 0.0
        return _Shape((kind, size[0], half), partial(_capsule_tree, size[0], half))
    if kind == _Geom.mjGEOM_CYLINDER:
        return _Shape((kind, *size[:2]), partial(_cylinder_tree, *size[:2]))
    if kind == _Geom.mjGEOM_BOX:
        return _Shape((kind, *size), partial(_box_tree, *size))
    bounds = mj.geom_aabb[geom].tolist()
    return _Shape((kind, *bounds), partial(_bounding_tree, *bounds))


def _hull(mj: mujoco.MjModel, mesh: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]] | None:
    """The vertices of a mesh, and MuJoCo's graph of its convex hull; None if the mesh has no hull."""
    first = int(mj.mesh_graphadr[mesh])
    if first < 0:
        return None
    corners, faces = (int(number) for number in mj.mesh_graph[first : first + 2])
    begin, count = int(mj.mesh_vertadr[mesh]), int(mj.mesh_vertnum[mesh])
    return mj.mesh_vert[begin : begin + count], mj.mesh_graph[first : first + 2 + 3 * corners + 6 * faces]


def _mesh_tree(vertices: npt.NDArray[np.float32], graph: npt.NDArray[np.int32]) -> Array:
    corners, faces = int(graph[0]), int(graph[1])
    used, places = np.unique(graph[2 + 3 * corners + 3 * faces :], return_inverse=True)
    hull = vertices[used].astype(np.float64)
    return cover(hull, places.reshape(-1, 3), LOSS_M, FLOOR_M)


def _box_tree(x: float, y: float, z: float) -> Array:
    corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (-z, z)])
    return cover(corners, _BOX_FACES, LOSS_M, FLOOR_M)


def _bounding_tree(x: float, y: float, z: float, *half: float) -> Array:
    """The spheres around the bounding box of a shape. The box is given by its centre and its half sizes."""
    tree = _box_tree(*half)
    tree[:, :3] += (x, y, z)
    tree[:, 4] = NO_DEPTH
    return tree


def _cylinder_tree(radius_m: float, half_m: float) -> Array:
    """The spheres around the prism that encloses a cylinder. Depths in the prism are reduced by the most that
    they can exceed those in the cylinder.
    """
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = radius_m / np.cos(np.pi / SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    corners = np.vstack([np.column_stack([ring, np.full(SIDES, end)]) for end in (-half_m, half_m)])
    sides = [(i, (i + 1) % SIDES, SIDES + (i + 1) % SIDES, SIDES + i) for i in range(SIDES)]
    tree = cover(corners, [*sides, range(SIDES), range(SIDES, 2 * SIDES)], LOSS_M, FLOOR_M)
    tree[:, 4] -= radius_m * (1.0 - np.cos(np.pi / SIDES))
    return tree


def _capsule_tree(radius_m: float, half_m: float) -> Array:
    """One sphere around a capsule. Its children are a row of spheres from one end of the axis to the
    other.
    """
    if half_m == 0.0:
        return np.array([[0.0, 0.0, 0.0, radius_m, radius_m, 1.0, 0.0]])
    step_m = 2.0 * np.sqrt(LOSS_M * (LOSS_M + 2.0 * radius_m))
    count = 1 + int(np.ceil(2.0 * half_m / step_m))
    outer_m = float(np.hypot(radius_m, half_m / (count - 1)))
    rows = [[0.0, 0.0, 0.0, radius_m + half_m, radius_m, count + 1.0, 0.0]]
    for index, place_m in enumerate(np.linspace(-half_m, half_m, count)):
        rows.append([0.0, 0.0, float(place_m), outer_m, radius_m, index + 2.0, 1.0])
    return np.array(rows)
