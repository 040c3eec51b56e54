"""Convex bodies around the geoms of a model, and the tree of spheres around each body; see `covers.pyx`."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from cobot.robot.cloud import lane_nodes
from cobot.robot.covers import cover
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


Shape = tuple[Callable[..., Array], *tuple[Any, ...]]
"""A function that returns the spheres around a shape, followed by the arguments of this function."""


def tree_around(mj: mujoco.MjModel, geom: int) -> Array:
    """The spheres around a geom, in the geom's own frame, as rows of the same form as those of `cover`. The
    caller must not change them.
    """
    tree, *arguments = _shape(mj, geom)
    return tree(*arguments)


def nodes_around(mj: mujoco.MjModel, geom: int, turn: Array, offset: Array) -> npt.NDArray[np.float32]:
    """The same spheres in the form of `lane_nodes`, turned by a matrix and moved by an offset.

    The caller must not change them, because an arm in a different scene uses the same array again.
    """
    return _nodes(_shape(mj, geom), turn.tobytes(), offset.tobytes())


@lru_cache(maxsize=256)
def _nodes(shape: Shape, turn: bytes, offset: bytes) -> npt.NDArray[np.float32]:
    tree, *arguments = shape
    return lane_nodes(tree(*arguments), np.frombuffer(turn).reshape(3, 3), np.frombuffer(offset))


def _shape(mj: mujoco.MjModel, geom: int) -> Shape:
    kind, size = int(mj.geom_type[geom]), mj.geom_size[geom].tolist()
    if kind == _Geom.mjGEOM_MESH:
        hull = _hull(mj, int(mj.geom_dataid[geom]))
        if hull is not None:
            return _mesh_tree, *hull
    if kind in (_Geom.mjGEOM_SPHERE, _Geom.mjGEOM_CAPSULE):
        return _capsule_tree, size[0], size[1] if kind == _Geom.mjGEOM_CAPSULE else 0.0
    if kind == _Geom.mjGEOM_CYLINDER:
        return _cylinder_tree, size[0], size[1]
    if kind == _Geom.mjGEOM_BOX:
        return _box_tree, *size
    return _bounding_tree, *mj.geom_aabb[geom].tolist()


def _hull(mj: mujoco.MjModel, mesh: int) -> tuple[bytes, bytes] | None:
    """The vertices of a mesh, and MuJoCo's graph of its convex hull; None if the mesh has no hull."""
    first = int(mj.mesh_graphadr[mesh])
    if first < 0:
        return None
    corners, faces = (int(number) for number in mj.mesh_graph[first : first + 2])
    begin, count = int(mj.mesh_vertadr[mesh]), int(mj.mesh_vertnum[mesh])
    graph = mj.mesh_graph[first : first + 2 + 3 * corners + 6 * faces]
    return mj.mesh_vert[begin : begin + count].tobytes(), graph.tobytes()


@lru_cache(maxsize=256)
def _mesh_tree(vertices: bytes, graph: bytes) -> Array:
    points, numbers = np.frombuffer(vertices, dtype=np.float32), np.frombuffer(graph, dtype=np.int32)
    corners, faces = int(numbers[0]), int(numbers[1])
    used, places = np.unique(numbers[2 + 3 * corners + 3 * faces :], return_inverse=True)
    hull = points.reshape(-1, 3)[used].astype(np.float64)
    return cover(hull, places.reshape(-1, 3), LOSS_M, FLOOR_M)


@lru_cache(maxsize=256)
def _box_tree(x: float, y: float, z: float) -> Array:
    corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (-z, z)])
    return cover(corners, _BOX_FACES, LOSS_M, FLOOR_M)


def _bounding_tree(x: float, y: float, z: float, *half: float) -> Array:
    """The spheres around the bounding box of a different shape. The box is given by its centre and its half
    sizes.
    """
    tree = _box_tree(*half).copy()
    tree[:, :3] += (x, y, z)
    tree[:, 4] = NO_DEPTH
    return tree


@lru_cache(maxsize=256)
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


@lru_cache(maxsize=256)
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
