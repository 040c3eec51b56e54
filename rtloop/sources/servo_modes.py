"""The servo modes: what the points of a servo session become, a joint reference for every cycle."""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import Intervention, ServoMode
from cobot.types import Array, JointLimits
from rtloop.backends import Measured
from rtloop.generators.online_trajectory import OnlineTrajectory
from rtloop.inboxes.point_queue import PointQueue
from rtloop.sources.servo_base import MAX_POINTS, PointReader
from rtloop.sources.servo_law import ServoLaw
from rtloop.sources.servo_through_points import ThroughPoints
from rtloop.sources.target_checks import clamped_interval

JITTER_S = 0.01
"""Of points that a buffered mode waits for before it begins, two at the least: a sender is not punctual."""
BEFORE_TIMEOUT = 2.0
"""Times that: so long it waits for them."""


class Newest(PointReader):
    """Modes 1 and 2: what has come before the newest point does not count any more."""

    def __init__(self, limits: JointLimits, safe_velocity: Array, period_s: float, *, planned: bool) -> None:
        super().__init__(limits, safe_velocity, period_s)
        rates = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        self._planner = OnlineTrajectory(limits.dof, period_s, *rates) if planned else None
        self._law = ServoLaw(limits.dof, period_s)
        self._aim = np.zeros((3, limits.dof))
        self._since_s = self._every_s = 0.0

    def begin(self, command: Array) -> None:
        np.copyto(self.reference, command)
        np.copyto(self._last, command[0])
        self._aim[:] = 0.0
        self._aim[0] = command[0]
        self._law.begin(command)
        self._since_s = 0.0
        if self._planner is not None:
            self._planner.begin(command)

    def fetch(self, queue: PointQueue) -> Intervention | None:
        self._since_s += self._period_s
        aimed = False
        for _ in range(MAX_POINTS):
            point = queue.next()
            if point is None:
                break
            if not self._read(point):
                return Intervention.NOT_FINITE
            interval_s = clamped_interval(self._since_s)
            if self._planner is not None:  # which takes any target, at its own pace
                self._far(interval_s)
            elif self._jumps(interval_s):
                continue
            self._law.tune(float(point["lookahead_s"]), float(point["gain"]))
            if not aimed:
                self._every_s = self._since_s
            self._since_s = 0.0
            self.taken += 1
            aimed = True
        if aimed and self._planner is not None:
            self._planner.aim(self._last, None, self._time_s)
        elif aimed:
            self._step_to(self._last, self._every_s)
        elif self._since_s > 1.5 * self._every_s:
            self._aim[1:] = 0.0
        return None

    def _step_to(self, target: Array, time_s: float) -> None:
        """Aim at a target, as long after the last one; a stream has the rates of its differences."""
        position, velocity, acceleration = self._aim
        np.negative(velocity, out=acceleration)
        np.subtract(target, position, out=velocity)
        velocity /= time_s
        acceleration += velocity
        acceleration /= time_s
        np.copyto(position, target)

    def _far(self, interval_s: float) -> None:
        """A target that no stream could have is one to go to, not one of a motion."""
        planner = self._planner
        assert planner is not None
        most = self._safe_velocity * (2.0 * max(interval_s, self._time_s))
        if (np.abs(self._target - self._last) > most).any():
            planner.forget()
        np.copyto(self._last, self._target)

    def advance(self, measured: Measured) -> None:
        if self._planner is not None:
            self._planner.advance()
            np.copyto(self.reference, self._planner.reference)
        else:
            self._law.follow(self._aim)
            np.copyto(self.reference, self._law.reference)


class Buffered(PointReader):
    """Modes 3 and 4: one point after the other, each in its time, on straight lines.

    Each cycle takes what is due, so the time between two points need not be one of whole cycles. The points
    wait in the queue.
    """

    def __init__(
        self, limits: JointLimits, safe_velocity: Array, period_s: float, time_s: float | None
    ) -> None:
        """`time_s`: of every point, whatever it says itself."""
        super().__init__(limits, safe_velocity, period_s)
        self._fixed_s = time_s
        self._law = ServoLaw(limits.dof, period_s)
        self._line = np.zeros((3, limits.dof))
        self._start, self._way = np.zeros((2, limits.dof))
        self._elapsed_s = self._waited_s = 0.0
        self._since_s = 0.0  # since the last point that was no jump
        self._playing = False

    def begin(self, command: Array) -> None:
        np.copyto(self.reference, command)
        np.copyto(self._last, command[0])
        self._line[:] = 0.0
        self._line[0] = command[0]
        np.copyto(self._start, command[0])
        self._way[:] = 0.0
        self._law.begin(command)
        self._time_s = self._fixed_s or self._period_s
        self._elapsed_s = self._waited_s = self._since_s = 0.0
        self._playing = False

    def fetch(self, queue: PointQueue) -> Intervention | None:
        """The point whose time this cycle is in."""
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
                    self._playing, self._waited_s = False, 0.0
                    self._elapsed_s = self._time_s
                return None
            self._elapsed_s -= self._time_s
            if not self._read(point):
                return Intervention.NOT_FINITE
            stated_s = self._time_s
            if self._fixed_s is not None:
                self._time_s = self._fixed_s
            np.copyto(self._start, self._last)
            if self._jumps(max(stated_s, self._since_s)):  # its time passes without it
                self._way[:] = 0.0
                self._line[1:] = 0.0
                continue
            self._since_s = 0.0
            np.subtract(self._last, self._start, out=self._way)
            np.divide(self._way, self._time_s, out=self._line[2])
            self._line[2] -= self._line[1]
            self._line[2] /= self._time_s
            np.divide(self._way, self._time_s, out=self._line[1])
            self._law.tune(float(point["lookahead_s"]), float(point["gain"]))
            self.taken += 1
        return None

    def _may_begin(self, queue: PointQueue) -> bool:
        """Whether so many points wait that the sender's jitter will not show, or none come any more."""
        if not queue.waiting:
            self._waited_s = 0.0
            return False
        self._waited_s += self._period_s
        time_s = self._fixed_s or self._time_s
        enough = max(2, round(JITTER_S / time_s))
        late_s = BEFORE_TIMEOUT * max(time_s, JITTER_S)
        self._playing = queue.waiting >= enough or self._waited_s >= late_s
        if self._playing:
            self._elapsed_s = self._time_s  # the way to the last point is over
        return self._playing

    def advance(self, measured: Measured) -> None:
        line = self._line
        share = min(self._elapsed_s / self._time_s, 1.0)
        np.multiply(self._way, share, out=line[0])
        line[0] += self._start
        if not self._playing or self._waits:
            line[1:] = 0.0
        self._law.follow(line)
        np.copyto(self.reference, self._law.reference)


def make_servo(
    mode: ServoMode, limits: JointLimits, safe_velocity: Array, period_s: float
) -> Newest | Buffered | ThroughPoints | None:
    """The joint source of a mode; the modes with force control have the same as those without."""
    match mode:
        case ServoMode.NONE:
            return None
        case ServoMode.REPLANNED | ServoMode.REPLANNED_FORCE:
            return Newest(limits, safe_velocity, period_s, planned=True)
        case ServoMode.DIRECT:
            return Newest(limits, safe_velocity, period_s, planned=False)
        case ServoMode.BUFFERED:
            return Buffered(limits, safe_velocity, period_s, None)
        case ServoMode.BUFFERED_1MS:
            return Buffered(limits, safe_velocity, period_s, 1e-3)
        case _:
            return ThroughPoints(limits, period_s)
