"""What all servo modes share: how a point is read and checked, and what is counted."""

from __future__ import annotations

from math import isfinite
from typing import Protocol

import numpy as np

from cobot.ipc.layout import Intervention
from cobot.types import Array, JointLimits
from rtloop.inboxes.point_queue import PointQueue
from rtloop.sources.joint import Source
from rtloop.sources.target_checks import is_finite, joint_jump

MAX_POINTS = 8
"""That one cycle reads."""
LONGEST_TIME_S = 10.0
LEAD_RAD = 0.2
"""So far the reference may be ahead of the arm: then it waits."""


class ServoSource(Source, Protocol):
    """A source that fetches its points itself. Real-time safe.

    Attributes:
        taken: points that the reference has gone for.
        dropped: points that were jumps.
        underruns: how often it had to wait for a point.
        buffered: points that it has read and not gone for yet.
    """

    @property
    def taken(self) -> int: ...

    @property
    def dropped(self) -> int: ...

    @property
    def underruns(self) -> int: ...

    @property
    def buffered(self) -> int: ...

    def fetch(self, queue: PointQueue) -> Intervention | None:
        """Read what this cycle needs; NOT_FINITE if it makes no sense."""
        ...


class PointReader:
    """What all joint sources of points share: their checks and their counts."""

    def __init__(self, limits: JointLimits, safe_velocity: Array, period_s: float) -> None:
        self._limits = limits
        self._safe_velocity = safe_velocity
        self._period_s = period_s
        self._last = np.zeros(limits.dof)
        self._target = np.zeros(limits.dof)
        self._time_s = period_s
        self._behind = np.zeros(limits.dof)
        self._waits = False
        self.reference = np.zeros((3, limits.dof))
        self.heading = np.zeros(limits.dof)
        self.refusal = ""
        self.taken = self.dropped = self.underruns = 0

    @property
    def buffered(self) -> int:
        return 0

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        """Servo sessions have no setpoints."""
        return None

    def follow(self, command: Array) -> None:
        np.subtract(self.reference[0], command[0], out=self._behind)
        self._waits = float(np.abs(self._behind).max()) > LEAD_RAD

    def _read(self, point: np.ndarray) -> bool:
        """Take over `_target` and `_time_s`; whether they make sense."""
        time_s, joints = float(point["time_s"]), point["joints"]
        law = isfinite(point["lookahead_s"]) and isfinite(point["gain"])
        sane = isfinite(time_s) and law and is_finite(joints)
        if not sane:
            self.refusal = "a servo point is not finite"
            return False
        # Who writes to shared memory may write anything; the service refuses what is beyond these.
        np.clip(joints, self._limits.min_position, self._limits.max_position, out=self._target)
        self._time_s = min(max(time_s, self._period_s), LONGEST_TIME_S)
        return True

    def _jumps(self, interval_s: float) -> bool:
        """Whether the target is further from the last one than an arm can get; if not, it is the last one."""
        self.refusal = joint_jump(
            self._target, self._last, interval_s, self._safe_velocity, self._limits.names
        )
        if self.refusal:
            self.dropped += 1
            return True
        np.copyto(self._last, self._target)
        return False
