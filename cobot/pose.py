"""Checked vectors and rigid transforms. The compiled cycle uses its own arithmetic, in
`cobot.robot.chain`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from cobot.errors import InputError
from cobot.orientations import inverse, kuka_angles, kuka_quaternion, matrix, product, rotated

Array = npt.NDArray[np.float64]
Numbers3 = tuple[float, float, float]
Numbers6 = tuple[float, float, float, float, float, float]
Numbers7 = tuple[float, float, float, float, float, float, float]
"""Numbers of a pose: x, y, z (m) and w, x, y, z."""


def vector(values: object, size: int | None = None, *, name: str = "vector") -> Array:
    """A read-only float64 copy of `values`, shape (size,).

    Raises:
        InputError: the values are not numeric, their number is wrong, or a value is not finite.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as exc:
        raise InputError(f"{name} must be a list of numbers") from exc
    if array.ndim != 1 or (size is not None and array.shape[0] != size):
        raise InputError(f"{name} must have {size} numbers, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite, got {array.tolist()}")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, slots=True)
class Pose:
    """The pose of one frame in a second frame, which is also the rigid transform from the first to the
    second.

    With the pose a_in_b of frame A in frame B, `a_in_b @ c_in_a` is the pose of C in B, `a_in_b.inverse()` is
    the pose of B in A, and `a_in_b.apply(point_in_a)` is the point in B.

    Attributes:
        position: position of the origin of the first frame, shape (3,), m.
        quaternion: orientation as (w, x, y, z), shape (4,), normalised at construction.

    Raises:
        InputError: a value is not finite, or the quaternion is zero.
    """

    position: Array
    quaternion: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", vector(self.position, 3, name="position"))
        quaternion = vector(self.quaternion, 4, name="quaternion")
        norm = float(np.linalg.norm(quaternion))
        if norm < 1e-9:
            raise InputError("quaternion must not be zero")
        quaternion = quaternion / norm
        quaternion.flags.writeable = False
        object.__setattr__(self, "quaternion", quaternion)

    @classmethod
    def from_numbers(cls, numbers: Sequence[float] | Array) -> Self:
        """Create a pose from x, y, z (m) and w, x, y, z."""
        return cls(np.array(numbers[:3]), np.array(numbers[3:]))

    @classmethod
    def from_abc(cls, x: float, y: float, z: float, a: float, b: float, c: float) -> Self:
        """Create a pose from a position (m) and KUKA angles (rad); see `kuka_quaternion`."""
        angles = vector([a, b, c], name="angles")
        return cls(np.array([x, y, z]), np.array(kuka_quaternion(*angles.tolist())))

    @property
    def abc(self) -> Numbers3:
        """The orientation as KUKA angles (rad); see `kuka_angles`."""
        return kuka_angles(self.quaternion.tolist())

    @property
    def numbers(self) -> Numbers7:
        """The position (m) as x, y, z, and the quaternion as w, x, y, z."""
        x, y, z = self.position.tolist()
        return (x, y, z, *self.quaternion.tolist())

    @property
    def rotation(self) -> Array:
        """Rotation matrix, shape (3, 3). Its columns are the axes of the frame."""
        return np.array(matrix(self.quaternion.tolist()))

    def __matmul__(self, other: Pose) -> Pose:
        turn = self.quaternion.tolist()
        moved = rotated(turn, other.position.tolist())
        return Pose(self.position + moved, np.array(product(turn, other.quaternion.tolist())))

    def inverse(self) -> Pose:
        """Return the inverse transform, which is the pose of the outer frame in this frame."""
        back = inverse(self.quaternion.tolist())
        return Pose(-np.array(rotated(back, self.position.tolist())), np.array(back))

    def apply(self, points: Array) -> Array:
        """Transform one or more points from this frame to the outer one. Shape: (3,) or (n, 3)."""
        moved: Array = points @ self.rotation.T + self.position
        return moved
