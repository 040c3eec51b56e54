"""What a whole motion keeps to beside the limits: a direction of the tool, a box, joint ranges."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Cone:
    """An axis of the tool stays near a direction.

    Attributes:
        axis: shape (3,), unit length, in the TCP's frame.
        within_rad: so near.
        direction: shape (3,), unit length, in the base frame; None: where the axis points at the start.
    """

    axis: Array
    within_rad: float
    direction: Array | None = None


@dataclass(frozen=True, slots=True)
class Box:
    """The TCP stays in a box along the axes of the base frame: its corners, shape (3,), m."""

    low: Array
    high: Array


@dataclass(frozen=True, slots=True)
class Constraints:
    """All that are given have to be kept.

    Attributes:
        joints: by their indices, the ranges that they stay in, rad (m for a slide).
    """

    cone: Cone | None = None
    box: Box | None = None
    joints: tuple[tuple[int, float, float], ...] = ()
