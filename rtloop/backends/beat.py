"""Maps packets to cycles. Each cycle uses the newest packet. A lost packet still takes one period."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, TypeVar

import numpy as np

from cobot.types import Array

MAX_CATCH_UP_S = 0.1
"""Maximum gap between packets after which the missed cycles are made up at once, s. After a longer gap, the
path continues from where it was.
"""
OVERTAKEN = 20
"""A packet that is at most this many packets behind the newest one is out of order. One that is further
behind shows that the controller has restarted its count.
"""
VELOCITY_S = 0.005
"""Time constant of the filter that derives velocities from measured positions, s, for devices that do not
report velocities.
"""
_COUNTER = 1 << 32
PacketT = TypeVar("PacketT")


def ahead(counter: int, of: int) -> int:
    """Return the difference between two 32-bit sequence counters, -2**31 to 2**31 - 1. It is positive if the
    first one is ahead.
    """
    return (counter - of + _COUNTER // 2) % _COUNTER - _COUNTER // 2


class Beat(Generic[PacketT]):
    """The values that the controller sends, period by period.

    If packets are lost, or accumulate while this computer is busy, the missed cycles use positions
    interpolated linearly between the known ones, so that the path follows the device's clock.

    Attributes:
        newest: the newest packet; None before the first one.
        position, velocity: values of this cycle, shape (dof,), rad and rad/s.
        lost: number of packets that were lost or arrived too late.
        due: number of cycles still to run, including that of the newest packet.
    """

    def __init__(self, dof: int, period_s: float) -> None:
        self._period_s = period_s
        self._most = round(MAX_CATCH_UP_S / period_s)
        self.newest: PacketT | None = None
        self._sequence = 0
        self.lost = self.due = 0
        self.position, self.velocity = np.zeros(dof), np.zeros(dof)
        self._target = np.zeros(dof)

    def take(self, packet: PacketT, sequence: int, position: Sequence[float] | Array) -> bool:
        """Add a packet. Return False if it is older than the newest one."""
        periods = 1
        if self.newest is not None:
            periods = ahead(sequence, self._sequence)
            if -OVERTAKEN < periods <= 0:
                return False
            self.lost += max(periods - 1, 0)
        known = self.newest is not None and bool(np.isfinite(self.position).all())
        self.newest, self._sequence = packet, sequence
        self._target = np.array(position)
        self.due += periods
        if not (known and periods > 0 and self.due <= self._most):
            self.position, self.velocity = self._target, np.zeros(len(self._target))
            self.due = 1
        return True

    def advance(self) -> None:
        """Begin the next cycle that is due."""
        step = (self._target - self.position) / self.due
        self.due -= 1
        self.position = self.position + step
        share = 1.0 - np.exp(-self._period_s / VELOCITY_S)
        self.velocity = self.velocity + share * (step / self._period_s - self.velocity)


def smooth(share: float) -> float:
    """Return a smooth step that rises from 0 to 1 as `share` rises from 0 to 1. Its first two derivatives are
    zero at both ends.
    """
    share = min(max(share, 0.0), 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


class CommandTransition:
    """A smooth transition from the position of the controller's interpolator to the commands.

    Attributes:
        sent: the last command that was sent; None before the first one.
    """

    FADE_S = 1.0

    def __init__(self, dof: int, period_s: float) -> None:
        self._period_s = period_s
        self.sent: Array | None = None
        self._offset = np.zeros(dof)
        self._passed_s = self.FADE_S

    def forget(self) -> None:
        """Forget the commands, because the controller has ended its motion."""
        self.sent = None

    def begin(self, interpolator: Array, command: Array) -> None:
        """Start the transition. It starts at the last position that was sent or, if none was sent, at the
        interpolator's position. The offset from the commands then decreases to 0.
        """
        self._offset = (self.sent if self.sent is not None else interpolator) - command
        self._passed_s = 0.0

    def follow(self, command: Array) -> Array:
        """Return the position to send in this cycle, shape (dof,), rad."""
        self.sent = command + self._offset * (1.0 - smooth(self._passed_s / self.FADE_S))
        return self.sent

    def pass_period(self) -> None:
        self._passed_s += self._period_s
