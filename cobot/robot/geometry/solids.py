"""Point clouds and height fields as boxes.

Each box consists of whole cells of a grid, and neighbouring cells are joined. Together the boxes are exactly
the cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import permutations

import numpy as np

from cobot.errors import InputError, LimitError
from cobot.types import Array

MAX_SOLIDS = 500
"""Maximum number of solids in a scene, because a streaming session checks all of them in each cycle."""
HOPELESS = 4 * MAX_SOLIDS
"""If the first order of the axes gives more boxes than this, the other orders are not tried, because that
would take too long.
"""
MIN_M = 1e-6
"""Minimum height of a column. Lower columns are ignored."""
MAX_M = 200.0
"""Coarsest resolution that is tried in the search for a resolution that fits, m."""
TRIES = 4
"""Number of bisections between the last resolution that did not fit and the first one that did."""


def cloud(points: Array, voxel_m: float) -> Array:
    """The voxels that contain points, merged into boxes.

    Args:
        points: coordinates of the points, shape (n, 3), m.
        voxel_m: edge of a voxel; the grid begins at the origin.

    Returns:
        Middle and edges of each box, shape (k, 6), m.

    Raises:
        InputError: there are no points, or a point is not finite.
        LimitError: there are more boxes than `MAX_SOLIDS`; the message gives a voxel size that fits.
    """
    points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    if not len(points) or not np.isfinite(points).all():
        raise InputError(
            f"points: at least one point is needed, and all must be finite; got {len(points)} points"
        )

    def cells(edge_m: float) -> Array:
        return np.asarray(np.unique(np.floor(points / edge_m), axis=0))

    def fits(tried_m: float) -> bool:
        return len(joined(cells(tried_m), HOPELESS)) <= MAX_SOLIDS

    voxels = cells(voxel_m)
    boxes = joined(voxels)
    if len(boxes) > MAX_SOLIDS:
        raise LimitError(
            f"points: {len(points)} points fill {len(voxels)} voxels of {voxel_m:g} m, which make "
            f"{len(boxes)} boxes, allowed: {MAX_SOLIDS}; a voxel of {coarser(fits, voxel_m)}"
        )
    low, high = voxel_m * boxes[:, :3], voxel_m * boxes[:, 3:]
    return np.hstack([0.5 * (low + high), high - low])


def coarser(fits: Callable[[float], bool], edge_m: float) -> str:
    """A sentence that states the smallest suitable edge length. The length is doubled until the solids fit,
    then refined by bisection.
    """
    low_m = high_m = edge_m
    while not fits(high_m := _rounded_up(2.0 * high_m)):
        low_m = high_m
        if high_m > MAX_M:
            return f"{high_m:g} m would not fit either"
    for _ in range(TRIES):
        middle_m = _rounded_up(math.sqrt(low_m * high_m))
        if fits(middle_m):
            high_m = middle_m
        else:
            low_m = middle_m
    return f"{high_m:g} m would fit"


def _rounded_up(value: float) -> float:
    """Round up to three digits."""
    digits = 10.0 ** (math.floor(math.log10(value)) - 2.0)
    return float(f"{math.ceil(value / digits - 1e-9) * digits:.3g}")


def joined(cells: Array, hopeless: int | None = None) -> Array:
    """Merge distinct cells of a grid, shape (n, 3), into boxes. Returns the low and the high corner of each
    box, shape (k, 6); the unit is one cell.

    The best of the six orders of the axes is used; it does not necessarily give the smallest number of boxes.
    If the first order gives more than `hopeless` boxes, the others are not tried.
    """
    single = np.hstack([cells, cells + 1])
    best = single
    for order in permutations(range(3)):
        boxes = single
        for axis in order:
            boxes = _along(boxes, axis)
        if len(boxes) < len(best):
            best = boxes
        if hopeless is not None and len(best) > hopeless:
            break
    return best


def _along(boxes: Array, axis: int) -> Array:
    """Merge boxes that continue each other along an axis."""
    others = [column for column in range(6) if column % 3 != axis]
    boxes = boxes[np.lexsort([boxes[:, axis], *(boxes[:, column] for column in others)])]
    same = (boxes[1:, others] == boxes[:-1, others]).all(axis=1)
    first = np.concatenate([[True], ~(same & (boxes[1:, axis] == boxes[:-1, 3 + axis]))])
    starts = np.flatnonzero(first)
    ends = np.concatenate([starts[1:] - 1, [len(boxes) - 1]])
    out = boxes[starts].copy()
    out[:, 3 + axis] = boxes[ends, 3 + axis]
    return out


def columns(heights: Array, resolution_m: float, floor_m: float, step_m: float) -> Array:
    """Convert a grid of heights to columns. Neighbours of the same height are joined.

    Args:
        heights: heights, shape (rows, columns), m. Rows are along y, columns along x. NaN means that there is
            no column.
        resolution_m: edge of a cell; the corner of the first cell is the origin.
        floor_m: bottom of all columns; columns that are not higher are ignored.
        step_m: heights are rounded up to multiples of this above the floor; 0 means that they are not
            rounded.

    Returns:
        Centre and edges of each box, shape (k, 6), m.

    Raises:
        InputError: nothing is above the floor.
        LimitError: there are more boxes than `MAX_SOLIDS`; the message gives a step that fits, if there is
            one.
    """
    above = np.where(np.isnan(heights), 0.0, heights - floor_m)
    if not (above > MIN_M).any():
        raise InputError(f"heights: none of the {heights.size} values is above the floor of {floor_m:g} m")
    boxes = _steps(above, step_m)

    def fits(tried_m: float) -> bool:
        return len(_steps(above, tried_m)) <= MAX_SOLIDS

    if len(boxes) > MAX_SOLIDS:
        raise LimitError(
            f"heights: {heights.shape[0]} x {heights.shape[1]} cells make {len(boxes)} boxes, allowed: "
            f"{MAX_SOLIDS}; a step of {coarser(fits, max(step_m, 1e-3 * float(above.max())))}"
        )
    scale = np.array([resolution_m, resolution_m, 1.0])
    low, high = boxes[:, :3] * scale, boxes[:, 3:] * scale
    out = np.hstack([0.5 * (low + high), high - low])
    out[:, 2] += floor_m
    return out


def _steps(above: Array, step_m: float) -> Array:
    """The low and the high corner of each column: x and y in cells, z in m above the floor."""
    tops = np.ceil(above / step_m - 1e-9) * step_m if step_m > 0.0 else above
    row, column = np.nonzero(above > MIN_M)
    top = tops[row, column]
    zeros = np.zeros(len(row))
    single = np.stack([column, row, zeros, column + 1, row + 1, top], axis=1)
    ways = [_along(_along(single, first), 1 - first) for first in (0, 1)]
    return min(ways, key=len)
