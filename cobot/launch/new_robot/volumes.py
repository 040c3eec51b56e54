"""Volumes and sizes of the shapes of a robot's links. If shapes of a link overlap, the overlap is counted
once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from cobot.robot.rotations import matrix_of
from cobot.types import Array

SAMPLES = 1000
"""Maximum number of random points in each shape of a link with several shapes."""
MAX_POINTS = 20_000
"""Maximum number of random points in a link."""
KINDS = mujoco.mjtGeom


class Solid:
    """The shapes of one link.

    Attributes:
        centre: centre of the shapes' extent, in the link's frame, m.
        reach: greatest distance from the centre, m.
    """

    def __init__(self, shapes: list[_Shape]) -> None:
        self._shapes = shapes
        corners = np.concatenate([shape.corners for shape in shapes])
        self.centre: Array = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        self.reach = float(np.linalg.norm(corners - self.centre, axis=1).max())

    @cached_property
    def volume(self) -> float:
        """Volume of the union of the shapes, m³."""
        return self.overlap * sum(shape.volume for shape in self._shapes)

    @cached_property
    def overlap(self) -> float:
        """The volume of the union of the shapes, as a share of the sum of their volumes."""
        shapes = [shape for shape in self._shapes if shape.volume > 0.0]
        if len(shapes) < 2:
            return 1.0
        random, shared = np.random.default_rng(0), 0.0
        number = max(1, min(SAMPLES, MAX_POINTS // len(shapes)))
        sampled = [shape.sampled(random, number) for shape in shapes]
        points = np.concatenate(sampled)
        counts = np.zeros(len(points))
        for shape in shapes:
            counts += shape.holds(points)
        ends = np.cumsum([len(each) for each in sampled])[:-1]
        for shape, inside in zip(shapes, np.split(counts, ends), strict=True):
            # The weight of each point is one divided by the number of shapes that contain it.
            shared += shape.volume * float(np.mean(1.0 / np.maximum(inside, 1)))
        return shared / sum(shape.volume for shape in shapes)


def solid(mj: mujoco.MjModel, body: int, chosen: Array) -> Solid | None:
    """The solid that consists of a body's shapes. Only the shapes that the mask `chosen` selects are used;
    None if there are none.
    """
    shapes = [_Shape(mj, int(geom)) for geom in np.flatnonzero((mj.geom_bodyid == body) & chosen)]
    return Solid(shapes) if shapes else None


class _Shape:
    """A geom of MuJoCo's model. As in collision checks, a mesh is represented by its convex hull."""

    def __init__(self, mj: mujoco.MjModel, geom: int) -> None:
        self._kind, self._size = int(mj.geom_type[geom]), np.array(mj.geom_size[geom])
        self._place, self._turn = np.array(mj.geom_pos[geom]), matrix_of(mj.geom_quat[geom])
        middle, half = mj.geom_aabb[geom, :3], mj.geom_aabb[geom, 3:]
        self._low, self._high = middle - half, middle + half
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = middle + signs * half
        if self._kind == KINDS.mjGEOM_MESH:
            mesh = int(mj.geom_dataid[geom])
            begin, count = int(mj.mesh_vertadr[mesh]), int(mj.mesh_vertnum[mesh])
            corners = np.array(mj.mesh_vert[begin : begin + count], dtype=float)
        self._points = corners
        self.corners: Array = self._place + corners @ self._turn.T

    @cached_property
    def _hull(self) -> ConvexHull | None:
        """Convex hull of a mesh; None if it is flat."""
        try:
            return ConvexHull(self._points)
        except QhullError:
            return None

    @cached_property
    def volume(self) -> float:
        """Volume of the shape, m³; 0 if shapes of this kind have no volume."""
        if self._kind == KINDS.mjGEOM_MESH:
            return 0.0 if self._hull is None else float(self._hull.volume)
        return float(_VOLUMES[self._kind](*self._size)) if self._kind in _VOLUMES else 0.0

    @cached_property
    def _planes(self) -> Array:
        """Equations of the hull's faces, shape (n, 4). Coplanar triangles are merged into one face."""
        return np.zeros((0, 4)) if self._hull is None else np.unique(self._hull.equations.round(6), axis=0)

    def sampled(self, random: np.random.Generator, number: int) -> Array:
        """Random points in the shape, in the link's frame. There are at least one and at most `number` of
        them.
        """
        points = random.uniform(self._low, self._high, (number, 3))
        inside = points[self._inside(points)]
        if not len(inside):  # a thin shape
            inside = 0.5 * (self._low + self._high)[np.newaxis]
        return np.asarray(self._place + inside @ self._turn.T)

    def holds(self, points: Array) -> Array:
        """For each point, whether it is in the shape. The points are given in the link's frame."""
        points = (points - self._place) @ self._turn
        found = ((points >= self._low) & (points <= self._high)).all(axis=1)
        found[found] = self._inside(points[found])
        return np.asarray(found)

    def _inside(self, points: Array) -> Array:
        if self._kind == KINDS.mjGEOM_MESH:
            return np.asarray((points @ self._planes[:, :3].T + self._planes[:, 3] <= 1e-5).all(axis=1))
        if self._kind == KINDS.mjGEOM_BOX:
            return np.asarray((np.abs(points) <= self._size).all(axis=1))
        if self._kind == KINDS.mjGEOM_ELLIPSOID:
            return np.asarray(np.square(points / self._size).sum(axis=1) <= 1.0)
        along, across = np.abs(points[:, 2]), np.square(points[:, :2]).sum(axis=1)
        radius = self._size[0] ** 2
        if self._kind == KINDS.mjGEOM_CYLINDER:
            return np.asarray((along <= self._size[1]) & (across <= radius))
        half = 0.0 if self._kind == KINDS.mjGEOM_SPHERE else self._size[1]
        return np.asarray(across + np.square(np.maximum(along - half, 0.0)) <= radius)


_VOLUMES: dict[int, Callable[[float, float, float], float]] = {
    int(KINDS.mjGEOM_BOX): lambda x, y, z: 8.0 * x * y * z,
    int(KINDS.mjGEOM_SPHERE): lambda r, _y, _z: 4.0 / 3.0 * np.pi * r**3,
    int(KINDS.mjGEOM_ELLIPSOID): lambda x, y, z: 4.0 / 3.0 * np.pi * x * y * z,
    int(KINDS.mjGEOM_CYLINDER): lambda r, half, _z: 2.0 * np.pi * r**2 * half,
    int(KINDS.mjGEOM_CAPSULE): lambda r, half, _z: 2.0 * np.pi * r**2 * (half + 2.0 / 3.0 * r),
}
"""Functions that compute the volume of each kind of shape from MuJoCo's three sizes."""
