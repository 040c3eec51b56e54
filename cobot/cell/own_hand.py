"""The hand that is part of the arm's model. It consists of links that slide or turn, as `cobot new-robot`
writes it.

`robot.gripper: {type: simulated, hand: {...}}` describes it. It replaces the hand of the cell file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any

from pydantic import Field, ValidationError, field_validator

from cobot.cell.cell import Cell, CellEntry, Coordinate, Hand, load_cell
from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.strict import sentence

SIMULATED = "simulated"
"""The type of `robot.gripper` whose options contain a hand."""
MAX_WIDTHS, MIN_STEP_M = 64, 1e-6
Component = Annotated[float, Field(ge=-1.0, le=1.0)]


class SlidingFinger(CellEntry):
    """A finger.

    Attributes:
        body: name of the finger's body in the model. In the model the finger is open.
        axis: direction in which it opens, in the frame of that body.
        travel_m: distance that it slides from closed to open.
    """

    body: Annotated[str, Field(min_length=1, max_length=200)]
    axis: Annotated[tuple[Component, Component, Component], Field(strict=False)]
    travel_m: Annotated[float, Field(ge=0.001, le=0.5)]

    @field_validator("axis")
    @classmethod
    def _is_a_direction(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        return _direction(axis)


def _direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if abs((length := math.hypot(*axis)) - 1.0) > 1e-3:
        raise ValueError(f"the length of the vector is {length:g}; it must be 1")
    return axis


class OwnHand(CellEntry):
    """A hand of two fingers that move together.

    Attributes:
        max_force_n: each finger's largest force.
        max_speed_m_s: largest speed of the width.
    """

    fingers: Annotated[tuple[SlidingFinger, SlidingFinger], Field(strict=False)]
    max_force_n: Annotated[float, Field(ge=1.0, le=2000.0)] = 100.0
    max_speed_m_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.2

    @property
    def stroke_m(self) -> float:
        """Largest width between the fingers."""
        return sum(finger.travel_m for finger in self.fingers)

    @property
    def closed_m(self) -> float:
        """Smallest width between the fingers."""
        return 0.0


class TurningJoint(CellEntry):
    """A joint of fingers that turn.

    Attributes:
        body: the link that it turns. The model has this link in its open position.
        axis: axis about which it opens if the ratio is positive, in the frame of that body.
        anchor_m: a point on the axis, in the frame of that body.
        ratio: its angle per radian of the first joint.
    """

    body: Annotated[str, Field(min_length=1, max_length=200)]
    axis: Annotated[tuple[Component, Component, Component], Field(strict=False)]
    anchor_m: Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)] = (0.0, 0.0, 0.0)
    ratio: Annotated[float, Field(ge=-10.0, le=10.0)] = 1.0

    @field_validator("axis")
    @classmethod
    def _is_a_direction(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        return _direction(axis)


class TurningHand(CellEntry):
    """A hand whose fingers turn together, or that has one turning jaw.

    Attributes:
        joints: the first one is driven, all others follow it.
        travel_rad: angle of the first joint from closed to open.
        widths_m: widths at equal steps of the first joint's angle from closed to open.
        max_force_n: largest force between the fingers at every width.
        max_speed_m_s: largest speed of the width.
    """

    joints: Annotated[tuple[TurningJoint, ...], Field(strict=False, min_length=1, max_length=12)]
    travel_rad: Annotated[float, Field(ge=0.02, le=6.3)]
    widths_m: Annotated[
        tuple[Annotated[float, Field(ge=0.0, le=0.5)], ...],
        Field(strict=False, min_length=2, max_length=MAX_WIDTHS),
    ]
    max_force_n: Annotated[float, Field(ge=1.0, le=2000.0)] = 100.0
    max_speed_m_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.2

    @field_validator("joints")
    @classmethod
    def _has_a_driven_joint(cls, joints: tuple[TurningJoint, ...]) -> tuple[TurningJoint, ...]:
        if joints[0].ratio != 1.0:
            raise ValueError(
                f"[0].ratio is {joints[0].ratio:g}, but the first joint is the driven one, whose ratio must "
                f"be 1"
            )
        return joints

    @field_validator("widths_m")
    @classmethod
    def _grows(cls, widths: tuple[float, ...]) -> tuple[float, ...]:
        for index, (before, after) in enumerate(pairwise(widths), start=1):
            if after - before < MIN_STEP_M:
                raise ValueError(
                    f"[{index}] is {after:g} after {before:g}; each must be at least {MIN_STEP_M:g} m larger "
                    "than the previous one"
                )
        return widths

    @property
    def stroke_m(self) -> float:
        """Largest width between the fingers."""
        return self.widths_m[-1]

    @property
    def closed_m(self) -> float:
        """Smallest width between the fingers."""
        return self.widths_m[0]


AnyOwnHand = OwnHand | TurningHand
AnyHand = Hand | AnyOwnHand


def kind_of_hand(content: Any) -> str:
    """The kind of a hand: "turning" or "sliding"."""
    turns = isinstance(content, TurningHand) or (isinstance(content, Mapping) and "joints" in content)
    return "turning" if turns else "sliding"


_CLASSES: dict[str, type[AnyOwnHand]] = {"sliding": OwnHand, "turning": TurningHand}
NO_CELL = Cell.model_validate({"floor_m": None})


def own_hand(settings: Settings) -> AnyOwnHand | None:
    """The hand that is part of the robot's model; None if the model contains no hand.

    Raises:
        ConfigError: its description is invalid.
    """
    section = settings.robot.gripper
    if section is None or section.type != SIMULATED or section.options.get("hand") is None:
        return None
    try:
        return _CLASSES[kind_of_hand(section.options["hand"])].model_validate(section.options["hand"])
    except ValidationError as exc:
        said = "; ".join(sentence(each) for each in exc.errors())
        raise ConfigError(f"robot.gripper.hand: {said}") from exc


def hand_of(settings: Settings) -> AnyHand | None:
    """The hand of the simulation: the hand in the arm's model if it has one, otherwise the hand in the cell
    file.

    Raises:
        ConfigError: the cell file, or the description of the hand, is invalid.
    """
    own = own_hand(settings)
    if own is not None or settings.robot.cell is None:
        return own
    return load_cell(settings.robot.cell).hand


def cell_of(settings: Settings) -> Cell | None:
    """The simulated cell. If there is a hand but no cell file, the cell is empty. None if there is only the
    arm.

    Its `hand` and `cup` are defined in the cell file. Both are None if the arm's model contains a hand.

    Raises:
        ConfigError: see `hand_of`.
    """
    own = own_hand(settings)
    if settings.robot.cell is None:
        return None if own is None else NO_CELL
    cell = load_cell(settings.robot.cell)
    return cell if own is None else cell.model_copy(update={"hand": None, "cup": None})
