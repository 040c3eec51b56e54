"""Patterns along which a tool in contact searches for a hole or an edge, as offsets from the place of
contact.

A pattern is a function of the distance along it. It returns the offset across the direction of the push (m)
and the rotation vector of the tool across it (rad), or None at the end of the pattern.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SearchOffset:
    """An offset along the two axes across the direction of the push, m, and a rotation vector about them,
    rad.
    """

    x: float = 0.0
    y: float = 0.0
    rx: float = 0.0
    ry: float = 0.0


Search = Callable[[float], SearchOffset | None]
LEVER_M = 0.05
"""Lever of a tilt, m: tilting by an angle counts as this lever's distance, so that one speed fits all
patterns.
"""
LEANINGS = 12
"""Number of directions into which a tilt leans, one after the other."""


def spiral(radius_m: float, pitch_m: float) -> Search:
    """An Archimedean spiral outwards: r = a φ, with a = pitch / 2π.

    The distance s reaches φ = √(1 + 2 s / a) - 1. The speed along the spiral is then √(1 + φ²) / (1 + φ)
    times that of s, which is from 71 % to 100 %.
    """
    last = 2.0 * math.pi * radius_m / pitch_m

    def offset(way_m: float) -> SearchOffset | None:
        angle = math.sqrt(1.0 + 4.0 * math.pi * max(way_m, 0.0) / pitch_m) - 1.0
        if angle > last:
            return None
        r = pitch_m * angle / (2.0 * math.pi)
        return SearchOffset(r * math.cos(angle), r * math.sin(angle))

    return offset


def raster(radius_m: float, pitch_m: float) -> Search:
    """Lines along x across a square of side 2 · radius, from its corner. The pattern begins with a line to
    that corner.
    """
    side = 2.0 * radius_m
    lines = math.floor(side / pitch_m) + 1
    to_corner = math.hypot(radius_m, radius_m)

    def offset(way_m: float) -> SearchOffset | None:
        if way_m < to_corner:
            share = way_m / to_corner
            return SearchOffset(-radius_m * share, -radius_m * share)
        line, along = divmod(way_m - to_corner, side + pitch_m)
        if line >= lines:
            return None
        x = min(along, side)
        y = line * pitch_m + max(along - side, 0.0)
        return SearchOffset((x if line % 2 == 0 else side - x) - radius_m, min(y, side) - radius_m)

    return offset


def tilt(angle_rad: float) -> Search:
    """Lean over and back in each of `LEANINGS` directions. Opposite directions follow each other."""
    once = 2.0 * angle_rad * LEVER_M

    def offset(way_m: float) -> SearchOffset | None:
        leaning, along = divmod(way_m, once)
        if leaning >= LEANINGS:
            return None
        half, other = divmod(int(leaning), 2)
        heading = math.pi * (2.0 * half / LEANINGS + other)
        lean = angle_rad * (1.0 - abs(2.0 * along / once - 1.0))
        return SearchOffset(rx=lean * math.cos(heading), ry=lean * math.sin(heading))

    return offset
