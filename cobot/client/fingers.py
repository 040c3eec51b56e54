"""The gripper of a policy. The last number of the policy's action is a width, which is commanded when it
changes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from cobot.client.connection import Json
from cobot.client.gripper import GripperCommands
from cobot.errors import NotSupportedError

UNKNOWN_FORCE_N = 500.0
CHANGE_M = 0.0005
"""Minimum change of the width that causes a new command, m."""


class WidthFollower(Protocol):
    """Interface of fingers that move to a width.

    Attributes:
        width_m: the smallest and the largest width, m.
    """

    width_m: tuple[float, float]

    def aim(self, width: float) -> None:
        """Move to the possible width nearest to `width`, m, without waiting.

        Raises:
            CobotError: the gripper rejects the command; the message gives the reason.
        """
        ...


class FollowedWidth:
    """Commands widths, and stores the last one.

    Args:
        width_m: see `WidthFollower`.
        continuous: whether every width in this range is possible, or only the two ends of the range.
    """

    def __init__(self, width_m: tuple[float, float], *, continuous: bool = True) -> None:
        self._width_m, self._continuous = width_m, continuous
        self._commanded: float | None = None

    def follow(self, width: float, command: Callable[[float], object]) -> None:
        """If the nearest possible width has changed, command it. A command that has failed is repeated."""
        low, high = self._width_m
        width = min(max(width, low), high)
        if not self._continuous:
            width = low if width - low < high - width else high
        if self._commanded is None or abs(width - self._commanded) >= CHANGE_M:
            command(width)
            self._commanded = width


class ServedFingers:
    """The fingers of a gripper that the service controls.

    Args:
        able: the capabilities in the answer to GET /robot/gripper.

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
        """The fingers of a robot. None if the robot has no gripper, or a gripper without a width, such as a
        suction cup.

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
