"""A space that the TCP must not leave and a speed that it must not exceed, for the motions of programs that
nobody watches.

The service looks at the whole motion before it begins, rtloop at where the TCP is and is about to be in every
cycle of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cobot.trajectory import Trajectory
from cobot.types import Array

if TYPE_CHECKING:
    from cobot.robot.chain import Chain

STEP_S = 0.005
"""How far apart the service looks at a motion; rtloop does it in each cycle."""


@dataclass(frozen=True, slots=True)
class Fence:
    """A box in the base frame, and a speed.

    Attributes:
        low, high: corners of the box, shape (3,), m.
        speed_m_s: of the TCP, m/s.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    speed_m_s: float

    def values(self) -> list[float]:
        """As in shared memory: low, high, speed."""
        return [*self.low, *self.high, self.speed_m_s]

    def breach(self, trajectory: Trajectory, chain: Chain) -> str:
        """Where a motion leaves it first, in words; "" if it does not.

        Args:
            chain: of the arm, with the tool's TCP.
        """
        count = int(np.ceil(trajectory.duration_s / STEP_S)) + 1
        times_s = np.linspace(0.0, trajectory.duration_s, count)
        joints = trajectory.sample(times_s)
        places = chain.poses(joints)[:, :3]
        speeds = np.linalg.norm(chain.twists(joints, trajectory.sample(times_s, 1))[:, :3], axis=1)
        outside = (places < self.low) | (places > self.high) | (speeds > self.speed_m_s)[:, None]
        first = int(outside.any(axis=1).argmax())
        found = self.beyond(places[first], float(speeds[first]))
        return f"{times_s[first]:.2f} s into the motion {found}" if found else ""

    def beyond(self, place: Array, speed_m_s: float) -> str:
        """In words how a TCP there, shape (3,), m, with this speed is beyond it; "" if it is not."""
        for axis, value, low, high in zip("xyz", place, self.low, self.high, strict=True):
            if not low <= value <= high:
                return f"the TCP would be at {axis} = {value:.4f} m, the fence is from {low:g} to {high:g} m"
        if not speed_m_s <= self.speed_m_s:
            return f"the TCP would move at {speed_m_s:.4f} m/s, the fence permits {self.speed_m_s:g} m/s"
        return ""
