"""The controller's own limits: a table for each axis, by payload and by the TCP speed.

The controller stops with an alarm if a command exceeds the column of the current speed. A planner does not
know that speed in advance, so the smallest value of all columns is used.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cobot.types import Array, JointLimits
from rtloop.backends.fanuc.joints import J2, J3, JointUnits
from rtloop.backends.fanuc.messages import THRESHOLDS, LimitRate, LimitsPacket
from rtloop.results import ACCEPTED, Accepted, Rejected

NAMES = {
    LimitRate.VELOCITY: "max_velocity",
    LimitRate.ACCELERATION: "max_acceleration",
    LimitRate.JERK: "max_jerk",
}
SLACK = 1e-6


class LimitsTable:
    """The limits reported by the controller.

    Attributes:
        unloaded, loaded: limits without load and at full payload, shape (3, dof, THRESHOLDS), in the units of
            the packets. Axis 0 is velocity, acceleration, jerk.
        max_speed: maximum TCP speed, mm/s.
    """

    def __init__(self, dof: int) -> None:
        self.unloaded = np.full((len(LimitRate), dof, THRESHOLDS), np.nan)
        self.loaded = self.unloaded.copy()
        self.max_speed = 0

    def take(self, packet: LimitsPacket) -> None:
        """Add a packet. Packets about axes that the model does not have are ignored."""
        if packet.axis <= self.unloaded.shape[1]:
            self.unloaded[packet.rate, packet.axis - 1] = packet.unloaded
            self.loaded[packet.rate, packet.axis - 1] = packet.loaded
            self.max_speed = packet.max_speed

    def missing(self) -> Iterable[tuple[int, LimitRate]]:
        """Yield each axis and rate for which no packet of limits has arrived. Axes are counted from 1."""
        for rate in LimitRate:
            for axis in range(self.unloaded.shape[1]):
                if np.isnan(self.loaded[rate, axis]).all():
                    yield axis + 1, rate

    def least(self, load: float | None) -> Array:
        """Return the limits that are safe at any TCP speed, shape (3, dof).

        load: share of the full payload, 0 to 1; None for the tighter of the limits without load and at full
        payload.
        """
        ends = self.unloaded.min(axis=2), self.loaded.min(axis=2)
        if load is None:
            return np.asarray(np.minimum(*ends))
        share = min(max(load, 0.0), 1.0)
        mixed: Array = ((1.0 - share) * self.unloaded + share * self.loaded).min(axis=2)
        return mixed

    def check(self, limits: JointLimits, units: JointUnits, load: float | None) -> Accepted | Rejected:
        """Check that the model's limits are within the controller's. If axis 3 is measured from the horizon,
        its speed can be the sum of the speeds of joints 2 and 3.

        load: see `least`.
        """
        least = self.least(load)
        if not (np.isfinite(least).all() and (least > 0.0).all()):
            return Rejected("the controller's limits table has values that are not above 0")
        excess = []
        for rate in LimitRate:
            used = np.array(getattr(limits, NAMES[rate]))
            if units.horizon:
                used[J3] += used[J2]
            over = used > least[rate] / units.per_unit * (1.0 + SLACK)
            for joint in np.flatnonzero(over).tolist():
                with_2 = f" together with {limits.names[J2]}" if units.horizon and joint == J3 else ""
                allowed = _floored(least[rate] / units.per_unit)[joint]
                excess.append(
                    f"{NAMES[rate]} of {limits.names[joint]}{with_2} is {used[joint]:.6g}, but the "
                    f"table allows {allowed:.5g} {limits.unit(joint, rate + 1)}"
                )
        if not excess:
            return ACCEPTED
        what = "any payload" if load is None else f"{load:.0%} of the full payload"
        return Rejected(
            f"the model's joint limits exceed the controller's limits table for {what}: {'; '.join(excess)}. "
            "Set joint_limits.yaml to at most these values"
        )


def _floored(values: Array) -> Array:
    """Round down to five digits, so that a value that a user copies from the message is accepted."""
    digits = 10.0 ** (4 - np.floor(np.log10(values)))
    return np.asarray(np.floor(values * digits) / digits)
