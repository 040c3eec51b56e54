"""The hand that the arm's model brings along: two fingers of it that slide, as `cobot new-robot` keeps them.

`robot.gripper: {type: simulated, hand: {...}}` describes it. It takes the place of the cell file's hand.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, ValidationError, field_validator

from cobot.cell.cell import Cell, Entry, Hand, load_cell
from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.strict import sentence

SIMULATED = "simulated"
"""The type of `robot.gripper` whose options have a hand."""
Component = Annotated[float, Field(ge=-1.0, le=1.0)]


class SlidingFinger(Entry):
    """A finger.

    Attributes:
        body: its name in the model, which has the finger open.
        axis: direction in which it opens, in the frame of that body.
        travel_m: how far it slides from closed to open.
    """

    body: Annotated[str, Field(min_length=1, max_length=200)]
    axis: Annotated[tuple[Component, Component, Component], Field(strict=False)]
    travel_m: Annotated[float, Field(ge=0.001, le=0.5)]

    @field_validator("axis")
    @classmethod
    def _is_a_direction(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        if abs((length := math.hypot(*axis)) - 1.0) > 1e-3:
            raise ValueError(f"its length is {length:g}, it must be 1")
        return axis


class OwnHand(Entry):
    """A hand of two fingers that move together.

    Attributes:
        max_force_n: largest force of each finger.
        max_speed_m_s: largest speed of the width.
    """

    fingers: Annotated[tuple[SlidingFinger, SlidingFinger], Field(strict=False)]
    max_force_n: Annotated[float, Field(ge=1.0, le=2000.0)] = 100.0
    max_speed_m_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.2

    @property
    def stroke_m(self) -> float:
        """Largest width between the fingers."""
        return sum(finger.travel_m for finger in self.fingers)


AnyHand = Hand | OwnHand
NO_CELL = Cell.model_validate({"floor_m": None})


def own_hand(settings: Settings) -> OwnHand | None:
    """The hand that the robot's model brings along; None without one.

    Raises:
        ConfigError: its description is invalid.
    """
    section = settings.robot.gripper
    if section is None or section.type != SIMULATED or section.options.get("hand") is None:
        return None
    try:
        return OwnHand.model_validate(section.options["hand"])
    except ValidationError as exc:
        said = "; ".join(sentence(each) for each in exc.errors())
        raise ConfigError(f"robot.gripper.hand: {said}") from exc


def hand_of(settings: Settings) -> AnyHand | None:
    """The hand of the simulation: the model's own one, else that of the cell file.

    Raises:
        ConfigError: the cell file, or the description of the hand, is invalid.
    """
    own = own_hand(settings)
    if own is not None or settings.robot.cell is None:
        return own
    return load_cell(settings.robot.cell).hand


def cell_of(settings: Settings) -> Cell | None:
    """The simulated cell; an empty one for a hand without a cell file, None for the bare arm.

    Its `hand` and `cup` are those of the cell file, and None if the model has a hand of its own.

    Raises:
        ConfigError: as for `hand_of`.
    """
    own = own_hand(settings)
    if settings.robot.cell is None:
        return None if own is None else NO_CELL
    cell = load_cell(settings.robot.cell)
    return cell if own is None else cell.model_copy(update={"hand": None, "cup": None})
