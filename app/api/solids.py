"""Conversion of a solid in a request into one of the scene or of a tool."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Sequence
from typing import cast

import numpy as np

from app.api.schemas.scene import PutObject
from cobot.errors import InputError, LimitError
from cobot.robot.frames import pose_from_abc
from cobot.robot.geometry.solids import cloud, columns
from cobot.robot.scene import SceneObject
from cobot.types import Array, Numbers3, Numbers6

FARTHEST_M = 100.0


def solid_of(name: str, body: PutObject, touch: Sequence[str] = ()) -> SceneObject:
    """The solid of a request. For a large mesh or cloud this takes a second.

    Args:
        name: name of the object, for messages.

    Raises:
        InputError, LimitError: the solid is invalid, or has too many parts.
    """
    try:
        boxes, hulls = _made(body)
    except (InputError, LimitError) as exc:
        raise type(exc)(f"{name}: {exc}") from exc
    size = body.numbers()
    if not size:
        corners = [boxes[:, :3] + sign * 0.5 * boxes[:, 3:] for sign in (-1.0, 1.0)] + hulls
        around = np.concatenate(corners)
        farthest = float(np.abs(around).max())
        if not farthest <= FARTHEST_M:
            raise LimitError(f"{name}: reaches {farthest:.4g} m from its origin, at most {FARTHEST_M:g} m")
        size = tuple(np.ptp(around, axis=0).tolist())
    return SceneObject(
        shape=body.shape,
        size=size,
        pose=pose_from_abc(body.x, body.y, body.z, body.a, body.b, body.c).numbers,
        touch=tuple(touch),
        mass=body.mass,
        centre=None if body.centre is None else cast(Numbers3, tuple(body.centre)),
        inertia=None if body.inertia is None else cast(Numbers6, tuple(body.inertia)),
        boxes=cast(tuple[Numbers6, ...], tuple(tuple(box) for box in boxes.tolist())),
        hulls=cast(
            tuple[tuple[Numbers3, ...], ...],
            tuple(tuple(tuple(corner) for corner in hull.tolist()) for hull in hulls),
        ),
        tolerance=body.tolerance if body.shape == "mesh" and len(boxes) else 0.0,
    )


def _made(body: PutObject) -> tuple[Array, list[Array]]:
    """The boxes and convex parts of a solid, if it consists of such parts."""
    if body.shape == "point_cloud":
        return cloud(np.array(body.points), body.voxel or 0.0), []
    if body.shape == "height_field":
        return _columns(body), []
    if body.shape == "mesh":
        from cobot.robot.geometry.mesh import parts, read

        if body.file is None:
            vertices, triangles = np.array(body.vertices), np.array(body.triangles)
        else:
            vertices, triangles = read(_decoded(body.file))
        vertices = body.scale * vertices
        if not (np.abs(vertices) <= FARTHEST_M).all():
            raise LimitError(f"vertices: x, y and z must be at most {FARTHEST_M:g} m after scaling")
        return parts(vertices, triangles, body.tolerance)
    return np.zeros((0, 6)), []


def _columns(body: PutObject) -> Array:
    rows = body.heights or []
    lengths = sorted({len(row) for row in rows})
    if len(lengths) != 1 or not lengths[0]:
        raise InputError(f"heights: all rows must be equally long and not empty, got lengths {lengths}")
    heights = np.array([[np.nan if height is None else height for height in row] for row in rows])
    return columns(heights, body.resolution or 0.0, body.floor, body.step or 0.0)


def _decoded(text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error as exc:
        raise InputError(f"file: is not base64: {exc}") from exc
