"""Poses of vendor services: [x, y, z, rx, ry, rz], m and rad.

rx, ry, rz are rotations about the fixed axes x, y and z in this order: R = Rz(rz) Ry(ry) Rx(rx). They equal
KUKA's angles (C, B, A).
"""

from __future__ import annotations

from cobot.errors import InputError
from cobot.types import Array, Pose
from cobot.units import require_angle, require_way

FARTHEST_M = 1e6
"""Maximum coordinate, m. No arm reaches this far, and calculations with this value do not overflow."""


def pose_of(values: list[float], name: str = "pose") -> Pose:
    """Return a pose from its six numbers.

    Raises:
        InputError: there are not six numbers, or a coordinate is above `FARTHEST_M`.
    """
    if len(values) != 6:
        raise InputError(f"{name} must be [x, y, z, rx, ry, rz], got {len(values)} numbers")
    x, y, z, rx, ry, rz = values
    for axis, value in zip("xyz", (x, y, z), strict=True):
        if abs(value) > FARTHEST_M:
            raise InputError(f"{name}: {axis} may be up to {FARTHEST_M:g} m, got {value:g} m")
    return Pose.from_abc(x, y, z, rz, ry, rx)


def place_of(values: list[float], name: str = "pose", most_m: float = FARTHEST_M) -> Pose:
    """Convert six numbers to the pose of a real object. The bounds are tighter than those of `pose_of`.

    Raises:
        InputError: see `pose_of`; or a coordinate is above `most_m`, or an angle above one and a half turns.
    """
    pose = pose_of(values, name)
    for index, (axis, value) in enumerate(zip(("x", "y", "z", "rx", "ry", "rz"), values, strict=True)):
        try:
            _ = require_way(value, most_m) if index < 3 else require_angle(value)
        except ValueError as exc:
            raise InputError(f"{name}: {axis} {exc}") from exc
    return pose


def numbers_of(pose: Pose) -> list[float]:
    """Return the six numbers of a pose, with ry in [−π/2, π/2]."""
    rz, ry, rx = pose.abc
    return [*pose.position.tolist(), rx, ry, rz]


def as_list(values: Array) -> list[float]:
    """Return the values as plain Python numbers."""
    return [float(value) for value in values]
