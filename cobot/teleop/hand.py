"""What a hand asks for at this moment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from cobot.errors import InputError

MAX_LINEAR, MAX_ANGULAR, MAX_JOINT = 0.25, 0.5, 0.5
"""At full deflection, m/s, rad/s, rad/s; the service makes less of it where less is permitted."""
JOINTS = 16


@dataclass(frozen=True, slots=True)
class JogVelocity:
    """A velocity, until it is replaced.

    Attributes:
        twist: of the TCP as shares of the largest, −1 to 1: along x, y, z, about x, y, z.
        joint: to be moved instead, from 0 on; None: the TCP.
        share: of the joint's largest velocity, −1 to 1.
        frame: of the twist, base or tool.
    """

    twist: tuple[float, ...] = (0.0,) * 6
    joint: int | None = None
    share: float = 0.0
    frame: str = "base"

    def frame_of(self, dof: int, speed: float) -> dict[str, object]:
        """As a `jog` frame (docs/stream-protocol.md).

        Raises:
            InputError: there is no such joint.
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
    """Something that a hand holds."""

    def read_velocity(self, now_s: float) -> JogVelocity | None:
        """What it asks for; None: nothing is held. It never waits.

        Raises:
            UnavailableError: it is gone: nothing is held any more.
        """
        ...

    @property
    def ended(self) -> bool:
        """Whether the hand has asked to end."""
        ...

    def close(self) -> None: ...
