"""Mode 5: through all points in their order, as fast as they say, or as fast as the limits permit.

The points are joined by a curve q(σ) that is continuous to the second derivative; σ is the time that the
points state, made longer where a joint could not be so fast. σ moves on at a rate r from 0 to 1 that is
continuous to its derivative, as on a planned path (`rtloop.planned.path_clock`): so is the whole, and what
changes the rate leaves neither the curve nor any point out. The curve's own share of acceleration and
jerk, q'' r² and q''' r³, bounds r on each piece, and the share that its changes may take, q' r' and
q' r'', bounds these.

The curve is known up to the last point but one, for the next one decides about the direction at the last.
What lies ahead of that is braked for at all times: a stream that ends ends at rest in its last point.
"""

from __future__ import annotations

from math import cbrt, sqrt

import numpy as np
import ruckig

from cobot import polynomials
from cobot.ipc.layout import Intervention
from cobot.types import Array, JointLimits
from rtloop.backends import Measured
from rtloop.inboxes.point_queue import PointQueue
from rtloop.sources.servo_base import MAX_POINTS, PointReader

PIECES = 512
"""Of the curve ahead; with points at 1 kHz, half a second."""
CURVE_SHARE, RATE_SHARE = 0.5, 0.5
"""Of acceleration and jerk, for what the curve does, and for what the changes of its rate do."""
VELOCITY_SHARE = 0.98
USUAL_RAD_S = 0.2
"""A joint's velocity that the rate's changes are always slow enough for: a faster point may come."""
MIN_RATE = 1e-4
REST = 1e-9
PATIENCE = 2.0
GRACE_S = 0.01
"""Times the last point's time, and on top: so long the next one is waited for before it is the last."""
PLACES = 7
"""On a piece, where its derivatives are looked at."""


class ThroughPoints(PointReader):
    """The curve ahead, and how far the arm is along it. Real-time safe."""

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        super().__init__(limits, limits.max_velocity, period_s)
        dof = limits.dof
        self._bounds = np.stack([limits.max_velocity, limits.max_acceleration, limits.max_jerk])
        self._usual = USUAL_RAD_S / np.array([limits.max_acceleration.min(), limits.max_jerk.min()])
        self._clock = ruckig.Ruckig(1, period_s)
        self._problem = ruckig.InputParameter(1)
        self._output = ruckig.OutputParameter(1)
        self._problem.target_velocity = self._problem.target_acceleration = [0.0]
        # The pieces from `_first` to before `_count` are ahead or under the arm.
        self._ends = np.zeros(PIECES)  # σ at the end of each
        self._spans = np.zeros(PIECES)
        self._rates = np.zeros(PIECES)  # the highest on each
        self._speeds = np.zeros((PIECES, 2))  # the highest on each, by the limits of acceleration and jerk
        self._coefficients = np.zeros((PIECES, 6, dof))
        self._first = self._count = 0
        self._knot = np.zeros((3, dof))  # the curve's end: position, and derivatives by σ
        self._pending = np.zeros(dof)  # the point after it, with its span and time; there is one if span > 0
        self._pending_span = self._pending_time_s = self._pending_age_s = 0.0
        self._hungry = False  # points have come since the last underrun
        self._distance = self._rate = self._slope = 0.0
        self._values = np.zeros((3, dof))

    @property
    def buffered(self) -> int:
        return self._count - self._first + (self._pending_span > 0.0)

    def begin(self, command: Array) -> None:
        """The arm may be moving: then the safety layer brings it to rest here."""
        self.reference[:] = 0.0
        self.reference[0] = command[0]
        self._first = self._count = 0
        self._knot[:] = 0.0
        self._knot[0] = command[0]
        self._pending_span = 0.0
        self._hungry = False
        self._distance = self._rate = self._slope = 0.0
        np.copyto(self._last, command[0])

    def fetch(self, queue: PointQueue) -> Intervention | None:
        self._pending_age_s += self._period_s
        for _ in range(MAX_POINTS):
            if self._count - self._first >= PIECES - 1:
                return None
            point = queue.next()
            if point is None:
                break
            if not self._read(point):
                return Intervention.NOT_FINITE
            self.taken += 1
            self._extend()
        late_s = PATIENCE * self._pending_time_s + GRACE_S
        if self._pending_span > 0.0 and self._pending_age_s > late_s:
            self._close(None, 0.0)
        return None

    def advance(self, measured: Measured) -> None:
        if self._first == self._count:
            self._rest()
            return
        self._move_on(float(self._ends[self._count - 1]))
        while self._first < self._count - 1 and self._distance > self._ends[self._first]:
            self._first += 1
        piece, span = self._first, float(self._spans[self._first])
        ahead = min(max(span - float(self._ends[piece]) + self._distance, 0.0), span)
        values = self._values
        polynomials.evaluate(self._coefficients[piece], ahead, span, values)
        position, velocity, acceleration = self.reference
        np.copyto(position, values[0])
        np.multiply(values[1], self._rate, out=velocity)
        np.multiply(values[2], self._rate * self._rate, out=acceleration)
        values[1] *= self._slope
        acceleration += values[1]
        if self._rate == 0.0 and self._distance == self._ends[self._count - 1]:
            self._first = self._count

    def _rest(self) -> None:
        """At the end of the curve."""
        self.reference[1:] = 0.0
        if self._hungry and self._pending_span == 0.0:
            self._hungry = False
            self.underruns += 1

    def _move_on(self, end: float) -> None:
        """One period on along the curve, so that it can come to rest at its end."""
        problem, output = self._problem, self._output
        first, count = self._first, self._count
        speeds = np.maximum(self._speeds[first:count].max(axis=0), self._usual)
        slope, bend = (RATE_SHARE / speeds).tolist()
        rate = self._rate + 0.5 * self._slope * abs(self._slope) / bend
        way = rate * (self._period_s + rate / slope + slope / bend)
        reach = first + 1 + int(np.searchsorted(self._ends[first:count], self._distance + way))
        most = MIN_RATE if self._waits else float(self._rates[first : min(reach, count)].min())
        problem.current_position, problem.current_velocity = [self._distance], [self._rate]
        problem.current_acceleration = [self._slope]
        problem.max_acceleration, problem.max_jerk = [max(slope, abs(self._slope))], [bend]
        problem.target_position, problem.max_velocity = [end], [max(most, MIN_RATE)]
        try:
            result = self._clock.update(problem, output)
        except (ruckig.RuckigError, ValueError):  # all but there
            result = ruckig.Result.Finished
        if result is ruckig.Result.Working:
            self._distance, self._rate = output.new_position[0], max(output.new_velocity[0], 0.0)
            self._slope = output.new_acceleration[0]
        if result is not ruckig.Result.Working or (end - self._distance < REST and self._rate < REST):
            self._distance, self._rate, self._slope = end, 0.0, 0.0

    def _extend(self) -> None:
        """One more point, `_target`: the curve is known up to the one before."""
        np.copyto(self._last, self._target)
        self._hungry = True
        here = self._pending if self._pending_span > 0.0 else self._knot[0]
        way = np.abs(self._target - here)
        span = max(self._time_s, float((way / (VELOCITY_SHARE * self._limits.max_velocity)).max()))
        if self._pending_span > 0.0:
            self._close(self._target, span)
        np.copyto(self._pending, self._target)
        self._pending_span, self._pending_time_s, self._pending_age_s = span, self._time_s, 0.0

    def _close(self, following: Array | None, following_span: float) -> None:
        """The curve goes on to the pending point, in a direction that the following one decides about."""
        if self._first == self._count:  # nothing moves: any direction will do
            self._first = self._count = 0
            self._distance = 0.0
            self._knot[1:] = 0.0
            self._knot[1] = (self._pending - self._knot[0]) / self._pending_span
        elif self._count == PIECES:
            self._make_room()
        span, start = self._pending_span, self._knot.copy()
        before = (self._pending - self._knot[0]) / span
        self._knot[0] = self._pending
        if following is None:
            self._knot[1], self._knot[2] = before, 0.0
        else:
            after = (following - self._pending) / following_span
            both = span + following_span
            self._knot[1] = (before * following_span + after * span) / both
            self._knot[2] = 2.0 * (after - before) / both
        number = self._count
        self._coefficients[number] = polynomials.between(start, self._knot, span)
        self._measure(number, span)
        self._spans[number] = span
        begin = float(self._ends[number - 1]) if number else 0.0
        self._ends[number] = begin + span
        self._count = number + 1
        self._pending_span = 0.0

    def _measure(self, number: int, span: float) -> None:
        """How fast the arm may go along a piece, and what the changes of that have to reckon with."""
        derivatives = polynomials.peaks(self._coefficients[number], span, PLACES)
        first, second, third = (derivatives / self._bounds).max(axis=1).tolist()
        self._rates[number] = min(
            1.0,
            VELOCITY_SHARE / max(first, 1e-9),
            sqrt(CURVE_SHARE / max(second, 1e-9)),
            cbrt(CURVE_SHARE / max(third, 1e-9)),
        )
        self._speeds[number] = (derivatives[0] / self._bounds[1:]).max(axis=1)

    def _make_room(self) -> None:
        """Forget the pieces that lie behind; σ begins anew where the arm is."""
        first, count = self._first, self._count
        origin = float(self._ends[first] - self._spans[first])
        for array in (self._ends, self._spans, self._rates, self._speeds, self._coefficients):
            array[: count - first] = array[first:count].copy()
        self._ends[: count - first] -= origin
        self._distance -= origin
        self._first, self._count = 0, count - first
