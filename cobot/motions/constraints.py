"""Path constraints, which a whole motion keeps in addition to the limits."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Cone:
    """Keeps an axis of the tool near a direction.

    Attributes:
        axis: shape (3,), unit length, in the TCP's frame.
        within_rad: the largest angle between axis and direction.
        direction: shape (3,), unit length, in the base frame; None: the axis's direction at the start.
    """

    axis: Array
    within_rad: float
    direction: Array | None = None


@dataclass(frozen=True, slots=True)
class Box:
    """Keeps the TCP in a box aligned with the base frame: its lowest and highest corner, shape (3,), m."""

    low: Array
    high: Array


@dataclass(frozen=True, slots=True)
class Constraints:
    """A motion keeps all constraints that are given.

    Attributes:
        joints: joint index, lowest and highest position, rad (m for a slide).
    """

    cone: Cone | None = None
    box: Box | None = None
    joints: tuple[tuple[int, float, float], ...] = ()
