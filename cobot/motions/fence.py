"""Limits for the motions of unattended programs: a space for the TCP, and a maximum speed.

The service checks the whole motion before it begins. In each cycle, rtloop checks the current and the next
TCP position.
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
"""Time between the samples of a motion that the service checks. rtloop checks the TCP in each cycle."""


@dataclass(frozen=True, slots=True)
class Fence:
    """A box in the base frame and a maximum speed.

    Attributes:
        low, high: corners of the box, shape (3,), m.
        speed_m_s: maximum TCP speed.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    speed_m_s: float

    def values(self) -> list[float]:
        """The values as they are written to shared memory: low, high, speed."""
        return [*self.low, *self.high, self.speed_m_s]

    def breach(self, trajectory: Trajectory, chain: Chain) -> str:
        """A sentence that names the point where a motion first leaves the fence; "" if the motion stays
        inside.

        Args:
            chain: the arm's kinematics up to the TCP.
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
        """A sentence that reports that a TCP position (m, shape (3,)) or a speed violates the fence; "" if
        nothing violates it.
        """
        for axis, value, low, high in zip("xyz", place, self.low, self.high, strict=True):
            if not low <= value <= high:
                return (
                    f"the TCP would be at {axis} = {value:.4f} m, but the fence is from {low:g} to {high:g} m"
                )
        if not speed_m_s <= self.speed_m_s:
            return f"the TCP would move at {speed_m_s:.4f} m/s, but the fence permits {self.speed_m_s:g} m/s"
        return ""
