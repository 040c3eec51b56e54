"""The gripper of a policy: the last number of its action is a width, which is commanded when it changes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from cobot.client.connection import Json
from cobot.client.gripper import GripperCommands
from cobot.errors import NotSupportedError

UNKNOWN_FORCE_N = 500.0
CHANGE_M = 0.0005
"""Minimum change of the width for a new command, m."""


class WidthFollower(Protocol):
    """Interface of fingers that follow a width.

    Attributes:
        width_m: the smallest and the largest width, m.
    """

    width_m: tuple[float, float]

    def aim(self, width: float) -> None:
        """Go to the nearest possible width, m, without waiting.

        Raises:
            CobotError: the gripper rejects the command, with the reason.
        """
        ...


class FollowedWidth:
    """Commands widths, and remembers the last one.

    Args:
        width_m: see `WidthFollower`.
        continuous: whether every width in this range is possible, or only its two ends.
    """

    def __init__(self, width_m: tuple[float, float], *, continuous: bool = True) -> None:
        self._width_m, self._continuous = width_m, continuous
        self._commanded: float | None = None

    def follow(self, width: float, command: Callable[[float], object]) -> None:
        """Command the nearest possible width if it has changed. A failed command is repeated."""
        low, high = self._width_m
        width = min(max(width, low), high)
        if not self._continuous:
            width = low if width - low < high - width else high
        if self._commanded is None or abs(width - self._commanded) >= CHANGE_M:
            command(width)
            self._commanded = width


class ServedFingers:
    """The fingers of a service's gripper.

    Args:
        able: the capabilities in the answer of GET /robot/gripper.

    Attributes:
        max_force_n: the largest force at the fingers, N; `UNKNOWN_FORCE_N` if the gripper does not know it.
    """

    def __init__(self, gripper: GripperCommands, able: Json) -> None:
        low, high = able["width_m"]
        self.width_m = (float(low), float(high))
        self.max_force_n = UNKNOWN_FORCE_N if able["force_n"] is None else float(able["force_n"][1])
        self._gripper = gripper
        self._followed = FollowedWidth(self.width_m, continuous=bool(able["continuous"]))

    @classmethod
    def of(cls, gripper: GripperCommands) -> ServedFingers | None:
        """The fingers of a robot; None if it has no gripper, or one without a width, such as a suction cup.

        Raises:
            UnavailableError: the service does not answer.
        """
        try:
            able = gripper.state()["capabilities"]
        except NotSupportedError:
            return None
        return None if able["width_m"] is None else cls(gripper, able)

    def aim(self, width: float) -> None:
        """See `WidthFollower`."""
        self._followed.follow(width, partial(self._gripper.move, wait=False))
