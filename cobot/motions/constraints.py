"""Path constraints, which apply to a whole motion in addition to the limits."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Cone:
    """Keeps an axis of the tool near a direction.

    Attributes:
        axis: direction of the axis in the TCP's frame, unit length, shape (3,).
        within_rad: the largest angle between axis and direction.
        direction: direction in the base frame, unit length, shape (3,); None means the direction that the
            axis has at the start.
    """

    axis: Array
    within_rad: float
    direction: Array | None = None


@dataclass(frozen=True, slots=True)
class Box:
    """Keeps the TCP in a box that is aligned with the base frame. The box is given by its lowest and its
    highest corner (m), each of shape (3,).
    """

    low: Array
    high: Array


@dataclass(frozen=True, slots=True)
class Constraints:
    """The constraints of a motion. The motion must satisfy each constraint that is given.

    Attributes:
        joints: for each constrained joint its index, its lowest and its highest position, rad (m for a linear
            joint).
    """

    cone: Cone | None = None
    box: Box | None = None
    joints: tuple[tuple[int, float, float], ...] = ()
