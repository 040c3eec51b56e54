"""Patterns along which a tool in contact searches for a hole or an edge.

A pattern is a function of the distance along it. It returns the tool's offset from the point of contact (m)
and a rotation vector (rad), both across the push direction, or None beyond the end of the pattern. The TCP
slows down in corners and narrow curves, because a jump of its velocity would disturb the force.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SearchOffset:
    """A displacement (m) along the two axes that are perpendicular to the push direction, and a rotation
    vector (rad) about these axes.
    """

    x: float = 0.0
    y: float = 0.0
    rx: float = 0.0
    ry: float = 0.0


@dataclass(frozen=True, slots=True)
class Search:
    """A search pattern.

    Attributes:
        offset: function that returns the offset at a distance along the pattern, m; None beyond its end.
        room_m: function that returns the length that limits the speed at this distance, m: the distance to
            the nearest corner or to the start, or half the radius of the curve.
    """

    offset: Callable[[float], SearchOffset | None]
    room_m: Callable[[float], float]


LEVER_M = 0.05
"""Lever that converts the angle of a tilt to a distance, m, so that one speed fits all patterns."""
LEANINGS = 12
"""Number of directions in which a tilt leans in turn."""


def spiral(radius_m: float, pitch_m: float) -> Search:
    """An Archimedean spiral outwards: r = a φ, with a = pitch / 2π.

    At the distance s the angle is φ = √(1 + 2 s / a) - 1. The speed along the spiral is then √(1 + φ²) / (1 +
    φ) times the speed of s, which is from 71 % to 100 %.
    """
    last = 2.0 * math.pi * radius_m / pitch_m

    def offset(way_m: float) -> SearchOffset | None:
        angle = math.sqrt(1.0 + 4.0 * math.pi * max(way_m, 0.0) / pitch_m) - 1.0
        if angle > last:
            return None
        r = pitch_m * angle / (2.0 * math.pi)
        return SearchOffset(r * math.cos(angle), r * math.sin(angle))

    def room_m(way_m: float) -> float:
        return 0.25 * pitch_m / math.pi * (math.sqrt(1.0 + 4.0 * math.pi * way_m / pitch_m) - 1.0)

    return Search(offset, room_m)


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

    def room_m(way_m: float) -> float:
        if way_m < to_corner:
            return min(way_m, to_corner - way_m)
        along = (way_m - to_corner) % (side + pitch_m)
        return min(along, abs(along - side), side + pitch_m - along)

    return Search(offset, room_m)


def tilt(angle_rad: float) -> Search:
    """Tilt in each of `LEANINGS` directions and back again. Each direction is followed by its opposite."""
    once = 2.0 * angle_rad * LEVER_M

    def offset(way_m: float) -> SearchOffset | None:
        leaning, along = divmod(way_m, once)
        if leaning >= LEANINGS:
            return None
        half, other = divmod(int(leaning), 2)
        heading = math.pi * (2.0 * half / LEANINGS + other)
        lean = angle_rad * (1.0 - abs(2.0 * along / once - 1.0))
        return SearchOffset(rx=lean * math.cos(heading), ry=lean * math.sin(heading))

    def room_m(way_m: float) -> float:
        along = way_m % (0.5 * once)
        return min(along, 0.5 * once - along)

    return Search(offset, room_m)
