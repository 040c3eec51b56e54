"""Converts a solid in a request to a solid in the scene or of a tool."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import cast

import numpy as np

from app.api.schemas.scene import PutObject
from cobot.errors import InputError, LimitError
from cobot.robot.geometry.cells import boxes_of, packed, tree_of
from cobot.robot.geometry.solids import cloud, columns
from cobot.robot.scene import SceneObject
from cobot.types import Array, Numbers3, Numbers6, Pose

FARTHEST_M = 100.0
POINT_BYTES = 12


def solid_of(
    name: str, body: PutObject, touch: Sequence[str] = (), *, by_voxels: bool = False
) -> SceneObject:
    """Build the solid in a request. For a large mesh or cloud this takes a second.

    Args:
        name: name of the object, for messages.
        by_voxels: whether a point cloud keeps its voxels, of which there may be many. If false, it must
            consist of few boxes, like everything that the arm carries.

    Raises:
        InputError, LimitError: the solid is invalid, or has too many parts.
    """
    cells, tolerance = "", body.tolerance if body.shape == "mesh" else 0.0
    try:
        if by_voxels and body.shape == "point_cloud":
            cells = packed(_points(body), body.voxel or 0.0)
            boxes, tolerance = boxes_of(cells, body.voxel or 0.0)
            hulls: list[Array] = []
        else:
            boxes, hulls = _made(body)
    except (InputError, LimitError) as exc:
        raise type(exc)(f"{name}: {exc}") from exc
    size = body.numbers()
    if not size:
        corners = [boxes[:, :3] + sign * 0.5 * boxes[:, 3:] for sign in (-1.0, 1.0)] + hulls
        around = np.concatenate(corners)
        farthest = float(np.abs(around).max())
        if not farthest <= FARTHEST_M:
            raise LimitError(f"{name}: reaches {farthest:.4g} m from its origin, allowed: {FARTHEST_M:g} m")
        size = tuple(np.ptp(around, axis=0).tolist())
    return SceneObject(
        shape=body.shape,
        size=size,
        pose=Pose.from_abc(body.x, body.y, body.z, body.a, body.b, body.c).numbers,
        touch=tuple(touch),
        mass=body.mass,
        centre=None if body.centre is None else cast(Numbers3, tuple(body.centre)),
        inertia=None if body.inertia is None else cast(Numbers6, tuple(body.inertia)),
        boxes=cast(tuple[Numbers6, ...], tuple(tuple(box) for box in boxes.tolist())),
        hulls=cast(
            tuple[tuple[Numbers3, ...], ...],
            tuple(tuple(tuple(corner) for corner in hull.tolist()) for hull in hulls),
        ),
        tolerance=tolerance if len(boxes) else 0.0,
        cells=cells,
        voxel=body.voxel or 0.0 if cells else 0.0,
        voxels=tree_of(cells, body.voxel or 0.0).count if cells else 0,
    )


def _made(body: PutObject) -> tuple[Array, list[Array]]:
    """Return the boxes and convex parts of a solid, if it consists of such parts."""
    if body.shape == "point_cloud":
        return cloud(_points(body), body.voxel or 0.0), []
    if body.shape == "height_field":
        return _columns(body), []
    if body.shape == "mesh":
        from cobot.robot.geometry.mesh import parts, read

        if body.file is None:
            vertices, triangles = np.array(body.vertices), np.array(body.triangles)
        else:
            vertices, triangles = read(_decoded("file", body.file))
        vertices = body.scale * vertices
        if not (np.abs(vertices) <= FARTHEST_M).all():
            raise LimitError(f"vertices: x, y and z must be at most {FARTHEST_M:g} m after scaling")
        return parts(vertices, triangles, body.tolerance)
    return np.zeros((0, 6)), []


def _points(body: PutObject) -> Array:
    """Decode the points of a cloud, shape (n, 3), m.

    Raises:
        InputError: the points are not base64, or the data does not consist of whole points.
        LimitError: a point is not finite or is too far away.
    """
    if body.points_base64 is None:
        return np.array(body.points)
    data = _decoded("points_base64", body.points_base64)
    if not data or len(data) % POINT_BYTES:
        raise InputError(
            f"points_base64: has {len(data)} bytes; each point has {POINT_BYTES}: x, y and z as float32 "
            "(little-endian), and there must be at least one"
        )
    points = np.frombuffer(data, dtype="<f4").reshape(-1, 3).astype(np.float64)
    wrong = np.flatnonzero(~(np.abs(points) <= FARTHEST_M).all(axis=1))
    if len(wrong):
        which, shown = int(wrong[0]), ", ".join(f"{value:.6g}" for value in points[wrong[0]])
        raise LimitError(
            f"points_base64: point {which} is [{shown}], allowed: finite numbers from -{FARTHEST_M:g} "
            f"to {FARTHEST_M:g} m ({len(wrong)} of {len(points)} points are outside): leave such points "
            "out, and check the unit"
        )
    return points


def _columns(body: PutObject) -> Array:
    rows = body.heights or []
    lengths = sorted({len(row) for row in rows})
    if len(lengths) != 1 or not lengths[0]:
        raise InputError(f"heights: all rows must be equally long and not empty, got lengths {lengths}")
    heights = np.array([[np.nan if height is None else height for height in row] for row in rows])
    return columns(heights, body.resolution or 0.0, body.floor, body.step or 0.0)


def _decoded(field: str, text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except ValueError as exc:  # binascii.Error, or the text is not ASCII
        raise InputError(f"{field}: is not base64: {exc}") from exc
