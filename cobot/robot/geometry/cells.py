"""Point clouds as the cubes of a grid that contain their points, and these cubes as text for files."""

from __future__ import annotations

import base64
import binascii
import threading
import zlib
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from cobot.errors import InputError
from cobot.robot.cloud import CloudTree, in_order
from cobot.robot.geometry.solids import HOPELESS, MAX_SOLIDS, joined
from cobot.types import Array

LEVEL = 3
"""Level of compression. The default level, 6, makes the text 8 % shorter but takes four times as long."""
MAX_VOXELS = 500_000
"""Maximum number of voxels in all point clouds of a scene together. A process needs about 200 bytes for
each.
"""

_LOCK = threading.Lock()
_KEPT: OrderedDict[tuple[str, float], _Voxels] = OrderedDict()
"""Voxels by their text and edge; the most recently used ones are at the end. Their total is at most the
maximum of one scene, so the voxels of the current scene stay. Guarded by `_LOCK`.
"""


@dataclass(slots=True)
class _Voxels:
    """Voxels, and the boxes that fill exactly the same volume. The boxes are None if there are too many for a
    scene.
    """

    tree: CloudTree
    boxes: Array | None = None
    are_joined: bool = False


def packed(points: Array, voxel_m: float) -> str:
    """The voxels that contain points, as text of about 3 bytes per voxel; `tree_of` reads it. The tree of the
    voxels is kept, so the text of a new cloud need not be read back.

    Args:
        points: coordinates of the points, shape (n, 3), m. They must be finite and at most 100 m from the
            origin along each axis.
        voxel_m: edge of a voxel, at least 0.1 mm; the grid begins at the origin.
    """
    cells = in_order(np.floor(np.asarray(points, dtype=np.float64).reshape(-1, 3) / voxel_m).astype(np.int64))
    steps = np.diff(cells, axis=0, prepend=np.zeros((1, 3), dtype=np.int32)).astype("<i4")
    text = base64.b64encode(zlib.compress(steps.tobytes(), LEVEL)).decode("ascii")
    _keep(text, voxel_m, _Voxels(CloudTree(cells, voxel_m)))
    return text


def tree_of(text: str, voxel_m: float) -> CloudTree:
    """The tree of the voxels that `packed` has written as text.

    Raises:
        InputError: the text is not a text of `packed`.
    """
    return _voxels_of(text, voxel_m).tree


def boxes_of(text: str, voxel_m: float, room: int = MAX_SOLIDS) -> tuple[Array, float]:
    """Boxes that cover the voxels, at most `room` of them, shape (k, 6). Also returns the distance by which
    the boxes may extend beyond the voxels. All values are in m.

    If the voxels can be joined to at most `room` boxes, the boxes are exact and the second value is 0 m.
    """
    voxels = _voxels_of(text, voxel_m)
    if not voxels.are_joined:
        boxes = joined(voxels.tree.cells.astype(np.float64), HOPELESS)
        voxels.boxes, voxels.are_joined = boxes if len(boxes) <= MAX_SOLIDS else None, True
    exact = voxels.boxes
    if exact is not None and len(exact) <= room:
        low, high = voxel_m * exact[:, :3], voxel_m * exact[:, 3:]
        return np.hstack([0.5 * (low + high), high - low]), 0.0
    return voxels.tree.boxes(room)


def _voxels_of(text: str, voxel_m: float) -> _Voxels:
    with _LOCK:
        if (known := _KEPT.get((text, voxel_m))) is not None:
            _KEPT.move_to_end((text, voxel_m))
            return known
    found = _Voxels(_read(text, voxel_m))
    _keep(text, voxel_m, found)
    return found


def _keep(text: str, voxel_m: float, found: _Voxels) -> None:
    with _LOCK:
        _KEPT[text, voxel_m] = found
        count = sum(each.tree.count for each in _KEPT.values())
        while count > MAX_VOXELS and len(_KEPT) > 1:
            count -= _KEPT.popitem(last=False)[1].tree.count


def _read(text: str, voxel_m: float) -> CloudTree:
    try:
        steps = np.frombuffer(zlib.decompress(base64.b64decode(text, validate=True)), dtype="<i4")
        cells = np.cumsum(steps.reshape(-1, 3), axis=0, dtype=np.int32)
        if len(cells) and np.array_equal(cells, in_order(cells)):
            return CloudTree(cells, voxel_m)
    except (binascii.Error, zlib.error, ValueError) as exc:
        raise InputError(f"cells: are damaged: {exc}; add the point cloud again") from exc
    raise InputError("cells: are damaged, because they are not in order; add the point cloud again")
