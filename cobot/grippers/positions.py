"""Base of grippers that outputs of the robot open and close. They have no positions between open and
closed.
"""

from __future__ import annotations

import math
from enum import Enum, auto
from typing import Annotated

from pydantic import Field

from cobot.clock import SYSTEM
from cobot.grippers.modbus_points import ModbusPoints
from cobot.grippers.protocol import Grasp, GripperError, IoPort, Now, Range

Name = Annotated[str, Field(min_length=1, max_length=200)]
Seconds = Annotated[float, Field(gt=0.0, le=30.0)]


class FingerGoal(Enum):
    """The commanded finger position. NEITHER means that cobot has not commanded one yet."""

    NEITHER = auto()
    OPEN = auto()
    CLOSED = auto()


class TwoPositions:
    """Base class for a gripper with two positions. It chooses the position that is nearer to the requested
    width, and measures how long the fingers take.

    Args:
        width_m: width of the closed and of the open gripper; None for a gripper without a width.

    Attributes:
        goal: goal of the last command.
    """

    LATE = 3.0
    """A command that has no effect after this multiple of its usual duration is a fault."""

    def __init__(self, port: IoPort, width_m: Range | None, clock: Now = SYSTEM) -> None:
        self._port = port
        self._width_m = width_m
        self._clock = clock
        self._begun_s = clock.now_s()
        self.goal = FingerGoal.NEITHER

    def open(self) -> None:
        self._command(FingerGoal.OPEN)

    def close(self) -> None:
        self._command(FingerGoal.CLOSED)

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        if self._width_m is None:
            raise GripperError("this gripper has no width; use grasp and release")
        closed_m, open_m = self._width_m
        self._command(FingerGoal.CLOSED if width - closed_m < open_m - width else FingerGoal.OPEN)

    def grasp(self, grasp: Grasp) -> None:
        self.close()

    def release(self, width: float | None) -> None:
        self.open()

    def home(self) -> None:
        self.open()

    def disconnect(self) -> None:
        """Disconnect. Outputs do not change."""
        if isinstance(self._port, ModbusPoints):
            self._port.close()

    def _command(self, goal: FingerGoal) -> None:
        self.goal, self._begun_s = goal, self._clock.now_s()
        self._drive(goal)

    def _adopt(self, goal: FingerGoal, since_s: float = math.inf) -> None:
        """Continue as if this goal had been commanded `since_s` ago."""
        self.goal, self._begun_s = goal, self._clock.now_s() - since_s

    def _drive(self, goal: FingerGoal) -> None:
        raise NotImplementedError

    @property
    def _since_s(self) -> float:
        """Time since the last command, s."""
        return self._clock.now_s() - self._begun_s

    def _require_points(self, *names: str | None) -> None:
        """Connect to the device that provides the given inputs and outputs, and check that they exist."""
        if isinstance(self._port, ModbusPoints):
            self._port.open()
        for name in names:
            if name is not None:
                self._port.read(name)

    def _input(self, name: str | None, inverted: bool) -> bool | None:
        """The value of a boolean input; None if the gripper has no such input."""
        return None if name is None else bool(self._port.read(name)) is not inverted
