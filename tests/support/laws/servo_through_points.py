"""What `rtloop.sources.servo_through_points` computes, in numpy.

The profile of the rate is that of `rtloop.generators.otg`, which has Ruckig for its oracle, or another that
is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from laws.servo_modes import MAX_POINTS, PointReader, Queue
from laws.smooth_interpolation import EXPONENTS, FACTORS, HERMITE

from cobot.ipc.layout import Intervention
from cobot.types import Array, JointLimits
from rtloop.generators import otg

PIECES = 512
CURVE_SHARE, RATE_SHARE, VELOCITY_SHARE = 0.5, 0.5, 0.98
USUAL_RAD_S, MIN_RATE, REST = 0.2, 1e-4, 1e-9
PATIENCE, GRACE_S = 2.0, 0.01
PLACES = np.linspace(0.0, 1.0, 7)
DERIVATIVES = np.stack(
    [
        FACTORS[1] * PLACES[:, None] ** EXPONENTS[1],
        FACTORS[2] * PLACES[:, None] ** EXPONENTS[2],
        np.array([0, 0, 0, 6, 24, 60]) * PLACES[:, None] ** np.array([0, 0, 0, 0, 1, 2]),
    ]
)
"""Of a quintic's powers by s in [0, 1], first to third, at places in it: shape (3, places, 6)."""
Step = Callable[[list[float], float], tuple[float, float, float] | None]
"""Of a problem as `rtloop.generators.otg` has it, the state a period later; None if it has no profile that
lasts so long."""


def otg_step(row: list[float], period_s: float) -> tuple[float, float, float] | None:
    failed, profile = otg.position(row)
    return None if failed or profile.duration < period_s else profile.at(period_s)


@dataclass
class Piece:
    """Of the curve.

    Attributes:
        end, span: σ at its end, and its length.
        rate: the highest on it.
        speeds: the joints' highest, by the limits of acceleration and of jerk.
        coefficients: of the quintic, shape (6, dof).
    """

    end: float
    span: float
    rate: float
    speeds: Array
    coefficients: Array


class ThroughPoints(PointReader):
    """Mode 5: the curve ahead, and how far the arm is along it."""

    def __init__(self, limits: JointLimits, period_s: float, step: Step = otg_step) -> None:
        super().__init__(limits, limits.max_velocity, period_s)
        self._profile_step = step
        self._bounds = np.stack([limits.max_velocity, limits.max_acceleration, limits.max_jerk])
        self._usual = USUAL_RAD_S / np.array([limits.max_acceleration.min(), limits.max_jerk.min()])
        self.begin(np.zeros((3, limits.dof)))
        self._pending_age_s = self._pending_time_s = 0.0

    def begin(self, command: Array) -> None:
        self.reference[:] = command[0], 0.0 * command[0], 0.0 * command[0]
        self._knot = self.reference.copy()
        self._last = command[0].copy()
        self._pieces: list[Piece] = []  # from where the arm is on
        self._pending, self._pending_span = command[0].copy(), 0.0
        self._hungry = False
        self._distance = self._rate = self._slope = 0.0
        self._count()

    def fetch(self, queue: Queue) -> Intervention | None:
        self._pending_age_s += self._period_s
        for _ in range(MAX_POINTS):
            if len(self._pieces) >= PIECES - 1:
                return None
            point = queue.next()
            if point is None:
                break
            if not self._read(point):
                return Intervention.NOT_FINITE
            self.taken += 1
            self._extend()
        if self._pending_span > 0.0 and self._pending_age_s > PATIENCE * self._pending_time_s + GRACE_S:
            self._close(None, 0.0)
        self._count()
        return None

    def advance(self, external_effort: Array, wrench: Array) -> None:
        if not self._pieces:
            self.reference[1:] = 0.0
            if self._hungry and self._pending_span == 0.0:
                self._hungry = False
                self.underruns += 1
            return
        self._move_on(self._pieces[-1].end)
        while len(self._pieces) > 1 and self._distance > self._pieces[0].end:
            self._pieces.pop(0)
        piece = self._pieces[0]
        ahead = min(max(piece.span - piece.end + self._distance, 0.0), piece.span)
        basis = FACTORS * (ahead / piece.span) ** EXPONENTS / piece.span ** np.arange(3)[:, None]
        position, first, second = basis @ piece.coefficients
        self.reference[:] = position, first * self._rate, second * self._rate**2 + first * self._slope
        if self._rate == 0.0 and self._distance == self._pieces[-1].end:
            self._pieces = []
        self._count()

    def _count(self) -> None:
        self.buffered = len(self._pieces) + (self._pending_span > 0.0)

    def _move_on(self, end: float) -> None:
        """One period on along the curve, so that it can come to rest at its end."""
        speeds = np.max([self._usual, *(piece.speeds for piece in self._pieces)], axis=0)
        slope, bend = (RATE_SHARE / speeds).tolist()
        rate = self._rate + 0.5 * self._slope * abs(self._slope) / bend
        way = rate * (self._period_s + rate / slope + slope / bend)
        reach = 1 + sum(piece.end < self._distance + way for piece in self._pieces)
        most = MIN_RATE if self._waits else min(piece.rate for piece in self._pieces[:reach])
        steepest, fastest = max(slope, abs(self._slope)), max(most, MIN_RATE)
        state = [self._distance, self._rate, self._slope, end, 0.0]
        ahead = self._profile_step([*state, -fastest, fastest, -steepest, steepest, bend], self._period_s)
        if ahead is not None:
            self._distance, self._rate, self._slope = ahead[0], max(ahead[1], 0.0), ahead[2]
        if ahead is None or (end - self._distance < REST and self._rate < REST):
            self._distance, self._rate, self._slope = end, 0.0, 0.0

    def _extend(self) -> None:
        """One more point: the curve is known up to the one before."""
        self._last = self._target
        self._hungry = True
        here = self._pending if self._pending_span > 0.0 else self._knot[0]
        times_s = np.abs(self._target - here) / (VELOCITY_SHARE * self._limits.max_velocity)
        span = max(self._time_s, float(times_s.max()))
        if self._pending_span > 0.0:
            self._close(self._target, span)
        self._pending = self._target
        self._pending_span, self._pending_time_s, self._pending_age_s = span, self._time_s, 0.0

    def _close(self, following: Array | None, following_span: float) -> None:
        """The curve goes on to the pending point, in a direction that the following one decides about."""
        span, start = self._pending_span, self._knot
        before = (self._pending - start[0]) / span
        if not self._pieces:  # nothing moves: any direction will do
            self._distance = 0.0
            start = np.array([start[0], before, 0.0 * before])
        if following is None:
            self._knot = np.array([self._pending, before, 0.0 * before])
        else:
            after, both = (following - self._pending) / following_span, span + following_span
            velocity = (before * following_span + after * span) / both
            self._knot = np.array([self._pending, velocity, 2.0 * (after - before) / both])
        # From the start on, so that a joint that does not move does not move by a rounding either.
        ends = np.vstack([start, self._knot]) * (span ** np.array([0, 1, 2, 0, 1, 2]))[:, None]
        ends[0], ends[3] = 0.0, self._knot[0] - start[0]
        coefficients = HERMITE @ ends
        derivatives = np.abs(DERIVATIVES @ coefficients).max(axis=1) / span ** np.arange(1, 4)[:, None]
        coefficients[0] = start[0]
        first, second, third = np.maximum((derivatives / self._bounds).max(axis=1), 1e-9)
        rate = min(1.0, VELOCITY_SHARE / first, (CURVE_SHARE / second) ** 0.5, np.cbrt(CURVE_SHARE / third))
        speeds = (derivatives[0] / self._bounds[1:]).max(axis=1)
        begin = self._pieces[-1].end if self._pieces else 0.0
        self._pieces.append(Piece(begin + span, span, float(rate), speeds, coefficients))
        self._pending_span = 0.0
