"""Conversion between the model's joints and FANUC's axes.

In packets, axes are in degrees, linear ones in mm. FANUC's teach pendant and its Remote Motion Interface
measure joint 3 from the horizon: its value stays the same while joint 2 turns. Models measure it from joint
2, as do Stream Motion since version 3 and FANUC's own ROS driver ("J2/J3 interaction"):

    relative = horizon + joint 2

Source: FANUC's documentation of its ROS 2 driver, "J3 value differs from the value on the Teach Pendant".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot.types import Array, JointLimits

J2, J3 = 1, 2
MM_PER_M = 1000.0


class JointUnits:
    """The conversion between joints and axes.

    Attributes:
        per_unit: degrees per rad, or mm per m for a linear axis, shape (dof,).
        horizon: whether joint 3 in Stream Motion is measured from the horizon.
    """

    def __init__(self, limits: JointLimits, horizon: bool = False) -> None:
        slides = np.array(limits.slides or (False,) * limits.dof)
        self.per_unit = np.where(slides, MM_PER_M, np.degrees(1.0))
        self.horizon = horizon and limits.dof > J3

    def to_model(self, axes: Sequence[float]) -> Array:
        """Convert the axes of a packet to joint positions, shape (dof,), rad and m."""
        joints: Array = np.array(axes[: len(self.per_unit)], dtype=float)
        if self.horizon:
            joints[J3] += joints[J2]
        return joints / self.per_unit

    def to_device(self, joints: Array) -> tuple[float, ...]:
        """Convert joint positions to the axes of a packet, shape (dof,), degrees and mm."""
        axes = joints * self.per_unit
        if self.horizon:
            axes[J3] -= axes[J2]
        return tuple(axes.tolist())


def from_horizon(axes: Sequence[float]) -> tuple[float, ...]:
    """Convert axes of the Remote Motion Interface to those of Stream Motion."""
    return (*axes[:J3], axes[J3] + axes[J2], *axes[J3 + 1 :])


def to_horizon(axes: Sequence[float]) -> tuple[float, ...]:
    """The reverse of `from_horizon`."""
    return (*axes[:J3], axes[J3] - axes[J2], *axes[J3 + 1 :])
