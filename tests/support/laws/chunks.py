"""What `rtloop.generators.chunks` computes, in numpy."""

from __future__ import annotations

import numpy as np
from laws.smooth_interpolation import EXPONENTS, FACTORS, HERMITE, Brake, Quintics

from cobot.types import Array
from rtloop.results import ACCEPTED, Accepted, Rejected

MAX_CHUNK = 64
"""Waypoints; as many of older chunks may still be ahead."""
SUPPORT = 3
"""Waypoints already passed that the spline still runs through: a new chunk hardly moves its beginning."""
TIE = 1e-9
SAMPLES = np.linspace(0.0, 1.0, 11)
"""Places in a blend where velocity, acceleration and jerk are looked at."""
BASES = FACTORS * SAMPLES[:, None, None] ** EXPONENTS
JERK_BASES = np.array([0, 0, 0, 6, 24, 60]) * SAMPLES[:, None] ** np.array([0, 0, 0, 0, 1, 2])
SAMPLED = np.stack([BASES[:, 1], BASES[:, 2], JERK_BASES]) @ HERMITE
"""The three rates at the samples, shape (3, samples, 6), from both ends of a quintic."""


class ChunkInterpolator:
    """Follows chunks of waypoints. `advance` is real-time safe; `take` allocates, once per chunk.

    Attributes:
        reference: where to be in this cycle, shape (3, n): position, velocity, acceleration.
        late: waypoints that were dropped because their time had passed, refused chunks included.
        starved: how often the waypoints ran out, and it had to brake.
    """

    def __init__(
        self, n: int, period_s: float, max_velocity: Array, max_acceleration: Array, max_jerk: Array
    ) -> None:
        self.reference = np.zeros((3, n))
        self.late = self.starved = 0
        self._rates = np.stack([max_velocity, max_acceleration, max_jerk])
        self._brake = Brake(period_s, max_acceleration, max_jerk)
        self._quintics = Quintics()
        self._period_s = period_s
        self._times_s = np.zeros(0)  # of the waypoints, some of them passed
        self._positions = np.zeros((0, n))
        self._knots_s = np.zeros(0)  # the first is where the newest chunk took over
        self._coefficients = np.zeros((0, 6, n))
        self._segment = 0
        self._braking = True

    def begin(self, state: Array) -> None:
        """Start here, shape (3, n), forget all waypoints, and hold (what moves is brought to rest)."""
        self.reference[:] = state
        self._forget()
        self._start_brake()

    def take(self, times_s: Array, positions: Array, now_s: float) -> Accepted | Rejected:
        """Replace what lies ahead from the first of these waypoints on that is not past.

        Args:
            times_s: when the waypoints are meant, on the robot's clock, increasing, shape (k,).
            positions: where, shape (k, n).
            now_s: the time of the reference as it is.

        Returns:
            `Rejected` if the chunk is not taken; then nothing has changed but `late`.
        """
        refusal = self._refusal(times_s, positions)
        if refusal:
            return Rejected(refusal)
        # What is due within this period is past: nothing can lead there any more.
        soon_s = now_s + self._period_s
        first = int(np.searchsorted(times_s, soon_s))
        self.late += first
        if first == len(times_s):
            return Rejected(
                f"all {first} waypoints are in the past, the last one by {now_s - times_s[-1]:.3f} s"
            )
        times_s, positions = times_s[first:], positions[first:]
        # Old waypoints remain up to half a step before the first new one: two plans need not agree.
        step_s = times_s[1] - times_s[0] if len(times_s) > 1 else 2.0 * self._period_s
        end = int(np.searchsorted(self._times_s, times_s[0] - 0.5 * step_s))
        ahead = min(int(np.searchsorted(self._times_s, soon_s)), end)
        begin = max(ahead - SUPPORT, 0)
        if end - ahead > MAX_CHUNK:
            return Rejected(f"{end - ahead} waypoints are still ahead, up to {MAX_CHUNK} are kept")
        self._times_s = np.concatenate([self._times_s[begin:end], times_s])
        self._positions = np.concatenate([self._positions[begin:end], positions])
        ends = np.stack([self._positions, *spline(self._times_s, self._positions)], axis=1)
        self._connect(now_s, self._times_s[ahead - begin :], ends[ahead - begin :])
        return ACCEPTED

    def advance(self, now_s: float) -> None:
        """The reference for this time; it must not go back, nor pass the last waypoint unnoticed."""
        times = self._knots_s
        if not self._braking:
            while self._segment < len(self._coefficients) and now_s > times[self._segment + 1] + 1e-9:
                self._segment += 1
            if self._segment < len(self._coefficients):
                begin_s, end_s = times[self._segment], times[self._segment + 1]
                coefficients = self._coefficients[self._segment]
                self._quintics.evaluate(coefficients, now_s - begin_s, end_s - begin_s, self.reference)
                return
            self.starved += 1
            self._start_brake()
        if self._brake.advance(self.reference) and len(self._times_s):
            self._forget()

    def _forget(self) -> None:
        """No waypoint says any longer how the arm came here."""
        self._times_s, self._positions = self._times_s[:0], self._positions[:0]

    def _refusal(self, times_s: Array, positions: Array) -> str:
        k, n = len(times_s), self.reference.shape[1]
        if times_s.ndim != 1 or not 1 <= k <= MAX_CHUNK or positions.shape != (k, n):
            return f"times and positions must be shape (k,) and (k, {n}), k from 1 to {MAX_CHUNK}"
        if not (np.isfinite(times_s).all() and np.isfinite(positions).all()):
            return "times and positions must be finite"
        if k > 1 and np.diff(times_s).min() < 0.5 * self._period_s:
            return "times must increase by at least half a cycle"
        return ""

    def _connect(self, now_s: float, times_s: Array, ends: Array) -> None:
        """Quintics from the reference to the first knot in reach, and from there from knot to knot.

        Of the knots (k,) are given position, velocity and acceleration, shape (k, 3, n).
        """
        blends = joined(np.broadcast_to(self.reference, ends.shape), ends, times_s - now_s)
        rates = np.abs(SAMPLED[:, None] @ blends).max(axis=2)  # (3, k, n)
        rates /= (times_s - now_s)[:, None] ** np.array([1, 2, 3])[:, None, None]
        excess = (rates / self._rates[:, None]).max(axis=(0, 2))
        reached = excess <= 1.0
        reached = reached if reached.any() else excess * (1.0 - TIE) <= excess.min()
        knot = int(reached.argmax())
        rest = joined(ends[knot:-1], ends[knot + 1 :], np.diff(times_s[knot:]))
        self._coefficients = HERMITE @ np.concatenate([blends[knot : knot + 1], rest])
        self._knots_s = np.concatenate([[now_s], times_s[knot:]])
        self._segment, self._braking = 0, False

    def _start_brake(self) -> None:
        self._brake.begin(self.reference)
        self._braking = True


def joined(start: Array, end: Array, spans_s: Array) -> Array:
    """Both ends of quintics as `HERMITE` takes them, (k, 6, n), of ends (k, 3, n) and durations (k,)."""
    scale: Array = spans_s[:, None] ** np.array([0, 1, 2, 0, 1, 2])
    return np.concatenate([start, end], axis=1) * scale[..., None]


def spline(times_s: Array, points: Array) -> tuple[Array, Array]:
    """Velocity and acceleration, each shape (k, n), at the knots of the cubic spline through points (k, n)
    whose first and last pieces are parabolas; a single point is one to rest at.

    The velocities solve a tridiagonal system (C. de Boor, "A Practical Guide to Splines", chapter IV).
    """
    k = len(times_s)
    velocities, accelerations = np.zeros((2, *points.shape))
    if k == 1:
        return velocities, accelerations
    h = np.diff(times_s)
    slope = np.diff(points, axis=0) / h[:, None]
    system, right = np.zeros((k, k)), np.empty_like(points)
    inner = np.arange(1, k - 1)
    system[inner, inner - 1], system[inner, inner + 1] = h[1:], h[:-1]
    system[inner, inner] = 2.0 * (h[1:] + h[:-1])
    right[1:-1] = 3.0 * (h[1:, None] * slope[:-1] + h[:-1, None] * slope[1:])
    system[0, :2], right[0] = 1.0, 2.0 * slope[0]
    # Two points make one piece, and it is straight.
    system[-1, -2:], right[-1] = (1.0, 1.0 if k > 2 else 2.0), (2.0 if k > 2 else 3.0) * slope[-1]
    velocities[:] = np.linalg.solve(system, right)
    accelerations[:-1] = (6.0 * slope - 4.0 * velocities[:-1] - 2.0 * velocities[1:]) / h[:, None]
    accelerations[-1] = (2.0 * velocities[-2] + 4.0 * velocities[-1] - 6.0 * slope[-1]) / h[-1]
    return velocities, accelerations
