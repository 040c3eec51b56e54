"""Finds commands that make a controller stop: those beyond the limits table, or too far from the previous
command.
"""

from __future__ import annotations

import numpy as np

from cobot.types import Array, JointLimits
from rtloop.backends.fanuc.joints import JointUnits
from rtloop.backends.fanuc.limits_table import LimitsTable
from rtloop.backends.fanuc.messages import THRESHOLDS, LimitRate, LimitsPacket
from rtloop.results import ACCEPTED, Accepted, Rejected

ENTRY_RAD = 0.05
"""Maximum distance of the first command from the arm's position, rad."""
LIMIT_RAD = 0.01
"""Maximum distance of a command beyond a joint's limits, rad."""
SLACK = 1.01
TIGHTEST_LOAD, TIGHTEST_SPEED = 1.0 / 1.5, 0.5
"""Factors by which acceleration and jerk limits are reduced at full payload and at full speed."""
INTERVAL_MS = 8
WORDS = {LimitRate.VELOCITY: "velocity", LimitRate.ACCELERATION: "acceleration", LimitRate.JERK: "jerk"}


def table_of(limits: JointLimits, per_unit: Array, share: float, max_speed: int) -> LimitsTable:
    """Create a limits table. At full payload and maximum speed, its limits are `share` times the arm's
    limits.
    """
    table = LimitsTable(limits.dof)
    speeds = np.linspace(1.0 / TIGHTEST_SPEED, 1.0, THRESHOLDS)
    bounds = limits.max_velocity, limits.max_acceleration, limits.max_jerk
    for rate, bound in zip(LimitRate, bounds, strict=True):
        column = speeds if rate != LimitRate.VELOCITY else np.ones(THRESHOLDS)
        for joint in range(limits.dof):
            loaded = share * bound[joint] * per_unit[joint] * column
            unloaded = loaded / (TIGHTEST_LOAD if rate != LimitRate.VELOCITY else 1.0)
            row = tuple(unloaded.tolist()), tuple(loaded.tolist())
            table.take(LimitsPacket(0, joint + 1, rate, max_speed, INTERVAL_MS, *row))
    return table


class Reflexes:
    """Checks each command against the previous ones."""

    def __init__(self, limits: JointLimits, table: LimitsTable, units: JointUnits, load: float) -> None:
        self._limits, self._units, self._max_speed = limits, units, table.max_speed
        self._columns = ((1.0 - load) * table.unloaded + load * table.loaded) / units.per_unit[None, :, None]
        self._known: list[tuple[int, Array]] = []
        self.peaks = np.zeros((len(LimitRate), limits.dof))

    def forget(self) -> None:
        """Forget the commands, because a new motion begins."""
        self._known.clear()

    def check(
        self, sequence: int, position: Array, here: Array, tcp_m_s: float, period_s: float
    ) -> Accepted | Rejected:
        """Check a command. If it is rejected, the motion ends.

        Args:
            sequence: command number.
            here: the arm's commanded position so far.
            tcp_m_s: TCP speed, m/s.
        """
        limits = self._limits
        if not np.isfinite(position).all():
            return Rejected("a position that is not finite")
        outside = np.maximum(limits.min_position - position, position - limits.max_position)
        joint = int(outside.argmax())
        if outside[joint] > LIMIT_RAD:
            return Rejected(f"{limits.names[joint]} is commanded beyond its limit, to {position[joint]:.6g}")
        if not self._known:
            off = np.abs(position - here)
            joint = int(off.argmax())
            if off[joint] > ENTRY_RAD:
                return Rejected(f"the first command of {limits.names[joint]} is {off[joint]:.3f} away")
            self._known = [(sequence - back, here) for back in (3, 2, 1)]
        result = self._rates(sequence, position, tcp_m_s, period_s)
        self._known = [*self._known[-2:], (sequence, position)]
        return result

    def _rates(self, sequence: int, position: Array, tcp_m_s: float, period_s: float) -> Accepted | Rejected:
        """Check the velocity, acceleration and jerk. Acceleration and jerk are not checked if a command that
        is needed to calculate them was lost.
        """
        known = [*self._known, (sequence, position)]
        numbers = [number for number, _ in known]
        passed = numbers[-1] - numbers[-2]
        if passed <= 0:
            return Rejected(f"the number of a command is {sequence}; the previous number was {numbers[-2]}")
        whole = np.diff(numbers)[::-1] == 1
        column = self._column(tcp_m_s)
        places = np.array([self._units.to_device(place) for _, place in known]) / self._units.per_unit
        for rate in LimitRate:
            order = rate + 1
            if rate != LimitRate.VELOCITY and not whole[:order].all():
                break
            found = (
                np.abs(places[-1] - places[-2]) / (passed * period_s)
                if rate == LimitRate.VELOCITY
                else np.abs(np.diff(places[-order - 1 :], order, axis=0)[0]) / period_s**order
            )
            share = found / self._columns[rate, :, column]
            np.maximum(self.peaks[rate], share, out=self.peaks[rate])
            joint = int(share.argmax())
            if share[joint] > SLACK:
                return Rejected(
                    f"the {WORDS[rate]} of {self._limits.names[joint]} is {share[joint]:.2f} times its "
                    f"limit at {1e3 * tcp_m_s:.0f} mm/s"
                )
        return ACCEPTED

    def _column(self, tcp_m_s: float) -> int:
        share = 1e3 * tcp_m_s / self._max_speed
        return min(max(int(np.ceil(share * THRESHOLDS)) - 1, 0), THRESHOLDS - 1)
