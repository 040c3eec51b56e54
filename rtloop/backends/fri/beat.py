"""Which cycle belongs to which packet: the newest counts, and a packet that was lost still takes its time."""

from __future__ import annotations

import numpy as np

from cobot.types import Array
from rtloop.backends.fri.messages import Monitoring, ahead

MAX_CATCH_UP_S = 0.1
"""That is made up for at once; after a longer gap the path goes on where it was."""
OVERTAKEN = 20
"""So many packets behind the newest one has been overtaken; further back the controller counts anew."""
VELOCITY_S = 0.005
"""Time constant with which the velocity, which FRI does not tell, follows the measured positions."""


class Beat:
    """What the controller says, one period after the other.

    Where packets were lost, or have piled up while this computer was busy, the cycles between are run with
    positions on a straight line between what came before and after: so the path's time is the device's.

    Attributes:
        newest: the newest packet, None before the first.
        position, velocity: of this cycle, shape (dof,), rad and rad/s.
        lost: packets that never came, or came too late.
        due: cycles that are to be run, the one of the newest packet among them.
    """

    def __init__(self, dof: int, period_s: float) -> None:
        self._period_s = period_s
        self._most = round(MAX_CATCH_UP_S / period_s)
        self.newest: Monitoring | None = None
        self.lost = self.due = 0
        self.position, self.velocity = np.zeros(dof), np.zeros(dof)
        self._target = np.zeros(dof)

    def take(self, message: Monitoring) -> bool:
        """A packet has come; False for one that is older than the newest."""
        periods = 1
        if self.newest is not None:
            periods = ahead(message.header.sequence, self.newest.header.sequence)
            if -OVERTAKEN < periods <= 0:
                return False
            self.lost += max(periods - 1, 0)
        known = self.newest is not None and bool(np.isfinite(self.position).all())
        self.newest = message
        self._target = np.array(message.measured_position)
        self.due += periods
        if not (known and periods > 0 and self.due <= self._most):
            self.position, self.velocity = self._target, np.zeros(len(self._target))
            self.due = 1
        return True

    def go_on(self) -> None:
        """The next cycle that is due."""
        step = (self._target - self.position) / self.due
        self.due -= 1
        self.position = self.position + step
        share = 1.0 - np.exp(-self._period_s / VELOCITY_S)
        self.velocity = self.velocity + share * (step / self._period_s - self.velocity)


def smooth(share: float) -> float:
    """From 0 at 0 to 1 at 1, with no velocity and acceleration at either."""
    share = min(max(share, 0.0), 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


class Entry:
    """Commands begin where the controller's interpolator is, and go over to what they say: no jump.

    Attributes:
        sent: what was commanded last, None before the first.
    """

    FADE_S = 1.0

    def __init__(self, dof: int, period_s: float) -> None:
        self._period_s = period_s
        self.sent: Array | None = None
        self._offset = np.zeros(dof)
        self._passed_s = self.FADE_S

    def forget(self) -> None:
        """What was commanded does not count any more: the controller has ended its motion."""
        self.sent = None

    def begin(self, interpolator: Array, command: Array) -> None:
        """From here the command goes on, whatever it says."""
        self._offset = (self.sent if self.sent is not None else interpolator) - command
        self._passed_s = 0.0

    def follow(self, command: Array) -> Array:
        """What to send in this cycle, shape (dof,), rad."""
        self.sent = command + self._offset * (1.0 - smooth(self._passed_s / self.FADE_S))
        return self.sent

    def pass_period(self) -> None:
        self._passed_s += self._period_s
