"""Describes the findings of the first contact with a device, in sentences that a user can check against the
arm.
"""

from __future__ import annotations

import numpy as np

from cobot.foreign import fixed
from cobot.robot.model import RobotModel
from cobot.types import Array
from rtloop.device import FIRST_SHARE

SLIDE_UNIT, TURN_UNIT = "mm", "degrees"


def first_contact(model: RobotModel, position: Array) -> str:
    """Describe the reported joints, the resulting TCP position, and what the user must do.

    Args:
        model: the model, including the current tool.
        position: measured position, shape (dof,), rad or m.
    """
    reported = (
        f"First contact: the device reports {_joints(model, position)}; so the TCP should be, seen from the "
        f"base, {place(model.forward(position).position)}."
    )
    to_do = (
        f"Tool and load: {_load(model)}. Compare this with the arm. Motions are limited to {FIRST_SHARE:.0%} "
        "of their speed, and streaming is off, until POST /robot/acknowledge or `cobot acknowledge`; preview "
        "the first motion with POST /robot/plan/... before it moves."
    )
    return " ".join([reported, *_beyond(model, position), to_do])


def place(position: Array) -> str:
    """Describe a position in the base frame, in metres, for a person next to the arm."""
    names = (("in front", "behind"), ("left", "right"), ("above", "below"))
    words = [
        f"{fixed(abs(value), 2)} m {pair[int(value < 0.0)]}"
        for value, pair in zip(position, names, strict=True)
    ]
    return ", ".join(words)


def _joints(model: RobotModel, position: Array) -> str:
    return ", ".join(
        f"{name} {_said(model, index, position[index])}" for index, name in enumerate(_names(model))
    )


def _beyond(model: RobotModel, position: Array) -> list[str]:
    limits = model.limits
    return [
        f"{name} is outside the model's range of {_said(model, index, limits.min_position[index])} to "
        f"{_said(model, index, limits.max_position[index])}; check that the model and the zero position "
        "belong to this arm"
        for index, name in enumerate(_names(model))
        if not limits.min_position[index] <= position[index] <= limits.max_position[index]
    ]


def _said(model: RobotModel, joint: int, value: float) -> str:
    if model.limits.unit(joint) == "m":
        return f"{fixed(1e3 * value, 1)} {SLIDE_UNIT}"
    return f"{fixed(float(np.degrees(value)), 1)} {TURN_UNIT}"


def _names(model: RobotModel) -> tuple[str, ...]:
    return model.limits.names


def _load(model: RobotModel) -> str:
    tool = model.tool
    if not tool.version:
        return "never set, so 0 kg on top of the model"
    return f"{tool.name or 'no name'}, {tool.mass:g} kg"
