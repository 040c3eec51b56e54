"""Pallets: a grid of places, and motions that are relative to one of these places.

A place is a frame. The client converts poses relative to a place into the frame of the pallet's origin, which
the service knows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product as combinations
from typing import Any, Self

from cobot.errors import InputError
from cobot.orientations import Quaternion, Vector, kuka_angles, kuka_quaternion, product, rotated

MAX_PLACES = 10_000
MAX_DIRECTIONS = 3
TOOL_FRAME = "tool"
POSITION, ANGLES = "xyz", "abc"


@dataclass(frozen=True, slots=True)
class PalletPlace:
    """A place of a pallet.

    Attributes:
        position: position of the place, m.
        quaternion: orientation of the place, (w, x, y, z).
        frame_id: frame in which position and orientation are given, as in POST /robot/move/pose.
        number: number of the place in its pallet, from 1.
    """

    position: Vector
    quaternion: Quaternion
    frame_id: str = ""
    number: int = 1

    @classmethod
    def of(cls, pose: Mapping[str, Any], number: int = 1) -> Self:
        """The place at a pose: x, y, z (m), a, b, c (KUKA angles, rad) and `frame_id`."""
        x, y, z = (float(pose.get(axis) or 0.0) for axis in POSITION)
        a, b, c = (float(pose.get(axis) or 0.0) for axis in ANGLES)
        return cls((x, y, z), kuka_quaternion(a, b, c), str(pose.get("frame_id") or ""), number)

    def at(self, **pose: Any) -> dict[str, Any]:
        """Create a body for POST /robot/move/pose from a pose relative to this place. Other fields are not
        changed.
        """
        return self.resolve({**dict.fromkeys(POSITION, 0.0), **pose})

    def resolve(self, body: Mapping[str, Any]) -> dict[str, Any]:
        """Convert a body for POST /robot/move/pose or move/arc. Poses, points and the axis that are relative
        to this place become relative to `frame_id`.
        """
        resolved = {**body, "frame_id": self.frame_id}
        if "x" in body:
            resolved |= self._pose(body)
        for name in ("via", "centre"):
            if body.get(name) is not None:
                resolved[name] = self._named(self._point(body[name]))
        if body.get("axis") is not None:
            resolved["axis"] = self.turn(body["axis"])
        if body.get("through"):
            resolved["through"] = [self._pose(each) for each in body["through"]]
        return resolved

    def turn(self, vector: Mapping[str, Any]) -> dict[str, float]:
        """Convert a direction from the axes of this place to the axes of `frame_id`."""
        return self._named(rotated(self.quaternion, _vector(vector)))

    def _pose(self, pose: Mapping[str, Any]) -> dict[str, float]:
        turn = kuka_quaternion(*(float(pose.get(axis, 0.0)) for axis in ANGLES))
        angles = kuka_angles(product(self.quaternion, turn))
        return self._named(self._point(pose)) | dict(zip(ANGLES, angles, strict=True))

    def _point(self, point: Mapping[str, Any]) -> Vector:
        x, y, z = rotated(self.quaternion, _vector(point))
        return self.position[0] + x, self.position[1] + y, self.position[2] + z

    @staticmethod
    def _named(vector: Vector) -> dict[str, float]:
        return dict(zip(POSITION, vector, strict=True))


def _vector(values: Mapping[str, Any]) -> Vector:
    return float(values.get("x", 0.0)), float(values.get("y", 0.0)), float(values.get("z", 0.0))


def _shown(count: object) -> str:
    """A count as text for a message. Very large integers are shortened, because Python may reject converting
    them.
    """
    return "too large" if isinstance(count, int) and abs(count) > 10**12 else repr(count)[:40]


def require_grid(counts: Sequence[int], offsets: Sequence[Mapping[str, Any]]) -> int:
    """Check a grid. Returns the number of places in it.

    Raises:
        InputError: there are too few or too many places, or the lengths of counts and offsets differ.
    """
    if not 1 <= len(counts) <= MAX_DIRECTIONS:
        raise InputError(f"counts has {len(counts)} directions, allowed: 1 to {MAX_DIRECTIONS}")
    if len(counts) != len(offsets):
        raise InputError(
            f"counts has {len(counts)} directions and offsets has {len(offsets)}; give one offset per count"
        )
    for index, count in enumerate(counts):
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MAX_PLACES:
            raise InputError(f"counts[{index}] is {_shown(count)}, allowed: 1 to {MAX_PLACES}")
    if math.prod(counts) > MAX_PLACES:
        shown = " x ".join(map(str, counts))
        raise InputError(f"counts: {shown} are {math.prod(counts)} places, allowed: 1 to {MAX_PLACES}")
    return math.prod(counts)


def places(
    origin: Mapping[str, Any], counts: Sequence[int], offsets: Sequence[Mapping[str, Any]]
) -> Iterator[PalletPlace]:
    """The places of a pallet, in an order in which the first direction changes fastest.

    Args:
        origin: pose of the first place: x, y, z, a, b, c and `frame_id`.
        counts: number of places in each direction, one to three.
        offsets: for each direction, the offset from one place to the next: x, y, z in the `frame_id` of the
            origin, m.

    Raises:
        InputError: see `require_grid`. Also if the origin is in the tool frame, because this frame moves.
    """
    require_grid(counts, offsets)
    if origin.get("frame_id") == TOOL_FRAME:
        raise InputError("origin.frame_id is 'tool', which moves with the arm; a pallet needs a fixed frame")
    first = PalletPlace.of(origin)
    ways = [_vector(offset) for offset in offsets]
    for number, steps in enumerate(combinations(*(range(count) for count in reversed(counts))), start=1):
        pairs = list(zip(reversed(steps), ways, strict=True))
        x, y, z = (first.position[axis] + sum(n * way[axis] for n, way in pairs) for axis in range(3))
        yield PalletPlace((x, y, z), first.quaternion, first.frame_id, number)
