"""What `rtloop.sources.servo_base` and `.servo_modes` compute, in numpy.

The online trajectory of mode 1 is given: it has an oracle of its own.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from laws.servo_law import ServoLaw
from laws.target_checks import clamped_interval, joint_jumps

from cobot.ipc.layout import Intervention
from cobot.types import Array, JointLimits

MAX_POINTS = 8
MAX_TIME_S, LEAD_RAD = 10.0, 0.2
JITTER_S, BEFORE_TIMEOUT = 0.01, 2.0


@dataclass(frozen=True)
class Point:
    """A servo point."""

    time_s: float
    lookahead_s: float
    gain: float
    joints: Array


@dataclass
class Queue:
    """Points that wait, and how many are announced that cannot be read yet."""

    points: deque[Point] = field(default_factory=deque)
    announced: int = 0

    @property
    def waiting(self) -> int:
        return len(self.points) + self.announced

    def next(self) -> Point | None:
        return self.points.popleft() if self.points else None


class PointReader:
    """What all joint sources of points share."""

    def __init__(self, limits: JointLimits, safe_velocity: Array, period_s: float) -> None:
        self._limits, self._safe_velocity, self._period_s = limits, safe_velocity, period_s
        self._last, self._target = np.zeros((2, limits.dof))
        self._time_s = period_s
        self._waits = False
        self.reference = np.zeros((3, limits.dof))
        self.taken = self.dropped = self.underruns = self.buffered = 0

    def follow(self, command: Array) -> None:
        self._waits = bool(np.abs(self.reference[0] - command[0]).max() > LEAD_RAD)

    def _read(self, point: Point) -> bool:
        limits = self._limits
        if not np.isfinite([point.time_s, point.lookahead_s, point.gain, *point.joints]).all():
            return False
        self._target = np.clip(point.joints, limits.min_position, limits.max_position)
        self._time_s = min(max(point.time_s, self._period_s), MAX_TIME_S)
        return True

    def _jumps(self, interval_s: float) -> bool:
        """Whether the target is further from the last one than an arm can get; if not, it is the last one."""
        if joint_jumps(self._target, self._last, interval_s, self._safe_velocity):
            self.dropped += 1
            return True
        self._last = self._target
        return False


class Newest(PointReader):
    """Modes 1 (with a planner) and 2: what came before the newest point does not count any more."""

    def __init__(
        self, limits: JointLimits, safe_velocity: Array, period_s: float, planner: Any | None
    ) -> None:
        super().__init__(limits, safe_velocity, period_s)
        self._planner = planner
        self._law = ServoLaw(limits.dof, period_s)
        self._since_s = self._every_s = 0.0

    def begin(self, command: Array) -> None:
        self.reference[:] = command
        self._last = command[0].copy()
        self._aim = np.array([command[0], 0.0 * command[0], 0.0 * command[0]])
        self._law.begin(command)
        self._since_s = 0.0
        if self._planner is not None:
            self._planner.begin(command)

    def fetch(self, queue: Queue) -> Intervention | None:
        self._since_s += self._period_s
        aimed = False
        for _ in range(MAX_POINTS):
            point = queue.next()
            if point is None:
                break
            if not self._read(point):
                return Intervention.NOT_FINITE
            interval_s = float(clamped_interval(self._since_s))
            if self._planner is not None:
                self._accept_far(interval_s)
            elif self._jumps(interval_s):
                continue
            self._law.tune(point.lookahead_s, point.gain)
            if not aimed:
                self._every_s = self._since_s
            self._since_s = 0.0
            self.taken += 1
            aimed = True
        if aimed and self._planner is not None:
            self._planner.aim(self._last, None, self._time_s)
        elif aimed:
            velocity = (self._last - self._aim[0]) / self._every_s
            self._aim = np.array([self._last, velocity, (velocity - self._aim[1]) / self._every_s])
        elif self._since_s > 1.5 * self._every_s:
            self._aim[1:] = 0.0
        return None

    def _accept_far(self, interval_s: float) -> None:
        """A target that no stream could have is one to go to, not one of a motion."""
        most = self._safe_velocity * (2.0 * max(interval_s, self._time_s))
        if (np.abs(self._target - self._last) > most).any():
            assert self._planner is not None
            self._planner.forget()
        self._last = self._target

    def advance(self, external_effort: Array, wrench: Array) -> None:
        if self._planner is not None:
            self._planner.advance()
            self.reference[:] = self._planner.reference
        else:
            self._law.follow(self._aim)
            self.reference[:] = self._law.reference


class Buffered(PointReader):
    """Modes 3 and 4 (with a fixed time): one point after the other, each in its time, on straight lines."""

    def __init__(
        self, limits: JointLimits, safe_velocity: Array, period_s: float, fixed_s: float | None
    ) -> None:
        super().__init__(limits, safe_velocity, period_s)
        self._fixed_s = fixed_s
        self._law = ServoLaw(limits.dof, period_s)

    def begin(self, command: Array) -> None:
        self.reference[:] = command
        self._last, self._start = command[0].copy(), command[0].copy()
        self._way, self._velocity, self._acceleration = np.zeros((3, self._limits.dof))
        self._law.begin(command)
        self._time_s = self._fixed_s or self._period_s
        self._elapsed_s = self._waited_s = self._since_s = 0.0
        self._playing = False

    def fetch(self, queue: Queue) -> Intervention | None:
        self._since_s += self._period_s
        if self._waits or not (self._playing or self._may_begin(queue)):
            return None
        self._elapsed_s += self._period_s
        for _ in range(MAX_POINTS):
            if self._elapsed_s <= self._time_s * (1.0 + 1e-9):
                return None
            point = queue.next()
            if point is None:
                if queue.waiting == 0:
                    self.underruns += 1
                    self._playing, self._waited_s, self._elapsed_s = False, 0.0, self._time_s
                return None
            self._elapsed_s -= self._time_s
            if not self._read(point):
                return Intervention.NOT_FINITE
            self._turn_to(point)
        return None

    def _turn_to(self, point: Point) -> None:
        stated_s = self._time_s
        self._time_s = self._fixed_s or stated_s
        self._start = self._last
        if self._jumps(max(stated_s, self._since_s)):  # its time passes without it
            self._way, self._velocity, self._acceleration = np.zeros((3, self._limits.dof))
            return
        self._since_s = 0.0
        self._way = self._last - self._start
        velocity = self._way / self._time_s
        self._velocity, self._acceleration = velocity, (velocity - self._velocity) / self._time_s
        self._law.tune(point.lookahead_s, point.gain)
        self.taken += 1

    def _may_begin(self, queue: Queue) -> bool:
        """Whether so many points wait that the sender's jitter will not show, or none come any more."""
        if not queue.waiting:
            self._waited_s = 0.0
            return False
        self._waited_s += self._period_s
        time_s = self._fixed_s or self._time_s
        enough = max(2, round(JITTER_S / time_s))
        self._playing = queue.waiting >= enough or self._waited_s >= BEFORE_TIMEOUT * max(time_s, JITTER_S)
        if self._playing:
            self._elapsed_s = self._time_s  # the way to the last point is over
        return self._playing

    def advance(self, external_effort: Array, wrench: Array) -> None:
        if not self._playing or self._waits:
            self._velocity, self._acceleration = np.zeros((2, self._limits.dof))
        share = min(self._elapsed_s / self._time_s, 1.0)
        self._law.follow(np.array([self._way * share + self._start, self._velocity, self._acceleration]))
        self.reference[:] = self._law.reference
