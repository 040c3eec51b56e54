"""The velocity that a device requests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from cobot.errors import InputError

MAX_LINEAR, MAX_ANGULAR, MAX_JOINT = 0.25, 0.5, 0.5
"""Velocities at full deflection, m/s, rad/s and rad/s. The service reduces them to the permitted
velocities.
"""
JOINTS = 16


@dataclass(frozen=True, slots=True)
class JogVelocity:
    """A requested velocity, valid until it is replaced.

    Attributes:
        twist: TCP velocity along x, y, z and about x, y, z, as shares of the maximum, −1 to 1.
        joint: number of the joint that moves, starting at 0; None if the TCP moves instead.
        share: velocity of the joint as a share of its maximum, −1 to 1.
        frame: frame of the twist, base or tool.
    """

    twist: tuple[float, ...] = (0.0,) * 6
    joint: int | None = None
    share: float = 0.0
    frame: str = "base"

    def frame_of(self, dof: int, speed: float) -> dict[str, object]:
        """The velocity as a `jog` frame (docs/stream-protocol.md).

        Raises:
            InputError: the joint does not exist.
        """
        if self.joint is not None:
            if self.joint >= dof:
                raise InputError(f"there is no joint {self.joint + 1}: this robot has {dof}")
            joints = [0.0] * dof
            joints[self.joint] = speed * MAX_JOINT * self.share
            return {"type": "jog", "joints": joints}
        scales = [MAX_LINEAR] * 3 + [MAX_ANGULAR] * 3
        twist = [speed * scale * share for scale, share in zip(scales, self.twist, strict=True)]
        return {"type": "jog", "twist": twist, "frame": self.frame}


class HandDevice(Protocol):
    """Interface of an input device."""

    def read_velocity(self, now_s: float) -> JogVelocity | None:
        """The requested velocity; None if nothing is held. The call never waits.

        Raises:
            UnavailableError: the device is gone, so nothing is held.
        """
        ...

    @property
    def ended(self) -> bool:
        """Whether the user has requested the end."""
        ...

    def close(self) -> None: ...
