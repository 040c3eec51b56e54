"""The registers of Robotiq's grippers, and the models.

Source: instruction manuals of 2F-85/2F-140 and Hand-E, chapters "Control" and "Modbus RTU". Each register
consists of two bytes. In the first register of each block, the first byte contains single bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

REQUEST, STATUS, COUNT = 0x03E8, 0x07D0, 3
"""The first registers of the two blocks, and the number of registers in each block."""
ACTIVATE, GO, AUTO_RELEASE = 0x01, 0x08, 0x10
"""Bits of a request: rACT, rGTO, rATR."""
FULL = 255
CURRENT_A = 0.01
FAULTS = {
    0x05: "the action is delayed: the gripper must be activated again",
    0x07: "the gripper is not activated: POST /robot/gripper/home",
    0x08: "the gripper is too hot: wait until it has cooled down",
    0x09: "the gripper has received no communication for a second",
    0x0A: "the supply voltage is too low: check the 24 V supply of the gripper",
    0x0B: "an automatic release is in progress",
    0x0C: "internal fault: restart the gripper",
    0x0D: "the activation has failed: check that nothing blocks the fingers",
    0x0E: "overcurrent: check the object on which the fingers press",
    0x0F: "an automatic release is completed: the gripper must be activated again",
}
"""Texts for the faults, by the value of gFLT."""
NOT_ACTIVE = 0x07
PASSING = frozenset({0x05, 0x09})
"""Faults that do not affect a running command."""


class Activation(IntEnum):
    """Values of gSTA, the state of the activation."""

    RESET = 0
    IN_PROGRESS = 1
    UNUSED = 2
    COMPLETE = 3


class Detection(IntEnum):
    """Values of gOBJ, which shows whether the fingers move or have stopped at an object."""

    MOVING = 0
    STOPPED_OPENING = 1
    STOPPED_CLOSING = 2
    AT_POSITION = 3


@dataclass(frozen=True, slots=True)
class Model:
    """The data of a gripper model, in m, m/s and N."""

    stroke_m: float
    speed_m_s: tuple[float, float]
    force_n: tuple[float, float]


MODELS = {
    "2f85": Model(0.085, (0.02, 0.15), (20.0, 235.0)),
    "2f140": Model(0.14, (0.03, 0.25), (10.0, 125.0)),
    "hande": Model(0.05, (0.02, 0.15), (20.0, 185.0)),
}


@dataclass(frozen=True, slots=True)
class Request:
    """A request to the gripper: position 0 (open) to 255 (closed), speed and force 0 to 255."""

    activate: bool
    go: bool
    position: int = 0
    speed: int = 0
    force: int = 0

    @property
    def words(self) -> list[int]:
        bits = ACTIVATE * self.activate | GO * self.go
        return [bits << 8, self.position, self.speed << 8 | self.force]

    @classmethod
    def of(cls, words: Sequence[int]) -> Request:
        bits = words[0] >> 8
        return cls(bool(bits & ACTIVATE), bool(bits & GO), words[1] & FULL, words[2] >> 8, words[2] & FULL)


@dataclass(frozen=True, slots=True)
class RobotiqStatus:
    """The status that the gripper reports.

    Attributes:
        echo: the requested position, as the gripper returns it.
        current_a: current of the motor, A.
    """

    active: bool
    go: bool
    activation: Activation
    detection: Detection
    fault: int
    echo: int
    position: int
    current_a: float

    @property
    def words(self) -> list[int]:
        bits = self.active | self.go << 3 | self.activation << 4 | self.detection << 6
        return [
            bits << 8,
            self.fault << 8 | self.echo,
            self.position << 8 | round(self.current_a / CURRENT_A),
        ]

    @classmethod
    def of(cls, words: Sequence[int]) -> RobotiqStatus:
        bits = words[0] >> 8
        return cls(
            bool(bits & 1),
            bool(bits & GO),
            Activation(bits >> 4 & 3),
            Detection(bits >> 6),
            words[1] >> 8 & 0x0F,
            words[1] & FULL,
            words[2] >> 8,
            (words[2] & FULL) * CURRENT_A,
        )


def share(value: float, bounds: tuple[float, float]) -> int:
    """Convert a value within its bounds to a number from 0 to 255."""
    return max(0, min(FULL, round(FULL * (value - bounds[0]) / (bounds[1] - bounds[0]))))
