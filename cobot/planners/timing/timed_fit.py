"""Fitting of timed motions from clients that ignore jerk or are rounded: the result is a motion that an arm
can follow.

The motions of planners that limit only velocity and acceleration have jumps in acceleration; files contain
rounded numbers. Both cause deviations of only milliradians, but unbounded jerk. Slowing the whole motion down
until the jerk limit holds would multiply its duration. Instead the motion may deviate from the curve within a
corridor and is slower only where necessary. First moving averages are tried: they are cheap and keep every
bound that the points keep. Then `jerk_fit` runs in rounds; after each, the curve's time is slowed down where
a bound is still exceeded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cobot.planners.corridor import PARTS, asked_curve, deviation
from cobot.planners.jerk_fit import fit
from cobot.planners.timing.uniform_spline import AT_REST, moving_average, spline_motion, stretch_needed
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

STEPS_TO_FULL_ACCELERATION = 10
MIN_STEPS, MAX_STEPS = 40, 60_000
MUCH_SLOWER = 1.5
"""If the whole motion must be slower by at least this factor, the steps are chosen for its
expected duration.
"""
AVERAGES = [(3, 1), (5, 1), (7, 3), (10, 1), (10, 5), (14, 1), (14, 7), (20, 1)]
"""Widths of the moving averages, in steps. The first average of each pair is applied once, the
second twice.
"""
TOO_FAR = 1.5
"""Factor by which a moving average may exceed the corridor. Beyond this factor, longer averages are not
tried.
"""
ROUNDS, TURNS, WORK = 16, 200, 2_500_000
"""Maximum number of rounds; maximum number of turns per round; and maximum of the turns multiplied by the
control points, in total.
"""
USUAL_ROUNDS, MIN_TURNS = 8, 30
"""Usual number of rounds, and minimum number of turns per round. A long motion gets fewer turns per round, so
that several rounds remain possible.
"""
PER_DEVIATION = 0.08
"""Exponent that turns the excess over the corridor into the factor by which time is stretched there. It is
small because the remaining turns reduce most of the excess.
"""
INNER, MIN_INNER = 0.85, 0.2
"""Share of the corridor that the control points of the fit may use, reduced by the part that noise takes, and
the minimum of this share.
"""
AS_ASKED = 1.002
"""A motion that takes no longer than this multiple of the requested duration is not improved."""
NEAR, SMOOTH = 7, 3.0
"""Where a bound is exceeded, time is stretched over `NEAR` control points, with a smooth transition over
`SMOOTH` further ones.
"""
ROUNDING_RAD = 1e-9
HASTE = 0.97
"""Factor per round by which the motion becomes faster again where no bound is exceeded, down to the requested
duration.
"""


@dataclass(frozen=True, slots=True)
class Fitted:
    """A motion within all bounds.

    Attributes:
        off_rad: the largest deviation of any joint from the curve.
        times_s: the time on the curve that corresponds to each breakpoint of the motion.
    """

    motion: Trajectory
    off_rad: float
    times_s: Array


def fitted(asked: Trajectory, limits: JointLimits, corridor: Array, longest_s: float) -> Fitted | None:
    """Find a short motion that stays within the limits and stays in the corridor around the requested motion.

    It is never shorter than the requested motion.

    Args:
        asked: the requested motion, from rest to rest.
        corridor: largest deviation of each joint, shape (dof,), rad.
        longest_s: longest useful duration.

    Returns:
        None if no motion stays in the corridor, or if none can be as short as `longest_s`.
    """
    search = _Fitting(asked, limits, corridor)
    if search.least_s > longest_s:
        return None
    for _ in search.steps():
        if search.best is not None and search.best.motion.duration_s <= AS_ASKED * asked.duration_s:
            break
    return search.best


class _Fitting:
    """A series of motions along one curve, each better than the previous one.

    Attributes:
        best: the shortest motion in the corridor so far.
        least_s: lower bound of the duration, computed from the velocity limits.
    """

    def __init__(self, asked: Trajectory, limits: JointLimits, corridor: Array) -> None:
        self._usual_s = float((limits.max_acceleration / limits.max_jerk).min()) / STEPS_TO_FULL_ACCELERATION
        coarsest_s, finest_s = asked.duration_s / MIN_STEPS, asked.duration_s / MAX_STEPS
        self._step_s = float(np.clip(self._usual_s, finest_s, coarsest_s))
        self._limits = limits
        self._corridor = corridor
        self._curve = asked_curve(asked, self._step_s)
        self.least_s = self._curve.interval_s * float(
            (np.abs(self._curve.directions) / limits.max_velocity).max(axis=1).sum()
        )
        self.best: Fitted | None = None

    def steps(self) -> Iterator[None]:
        """Try one candidate after the other, and yield after each."""
        start = self._sample()
        for counts in AVERAGES:
            control, times_s = (self._averages(each, counts) for each in start)
            used = self._stretch_to_bounds(control, times_s)[1]
            yield
            if used > TOO_FAR:
                break
        yield from self._rounds()

    def _sample(self) -> tuple[Array, Array]:
        """The averages of the curve over each step, and the times of the steps. Beyond both ends, the curve
        continues at rest.
        """
        curve = self._curve
        rows_s = np.linspace(0.0, curve.duration_s, len(curve.positions))
        means, times_s = (
            moving_average(each, PARTS)[PARTS // 2 :: PARTS] for each in (curve.positions, rows_s)
        )
        means[0], means[-1] = curve.positions[0], curve.positions[-1]
        pad = (AT_REST - 1, AT_REST - 1)
        return np.pad(means, (pad, (0, 0)), "edge"), np.pad(times_s, pad, "edge")

    @staticmethod
    def _averages(values: Array, counts: tuple[int, int]) -> Array:
        wide, narrow = counts
        return moving_average(moving_average(moving_average(values, wide), narrow), narrow)

    def _rounds(self) -> Iterator[None]:
        curve = self._curve
        grid_s = np.linspace(0.0, curve.duration_s, round(curve.duration_s / curve.step_s) + 1)
        slowness = self._first_slowness(grid_s)
        expected_s = float(slowness.mean()) * curve.duration_s
        if expected_s > MUCH_SLOWER * curve.duration_s:
            self._step_s = min(self._usual_s, expected_s / MIN_STEPS)
        control: Array | None = None
        most = max(INNER - float((curve.noise / self._corridor).max()), MIN_INNER)
        belongs_s, share, work = grid_s, most, 0
        for _ in range(ROUNDS):
            if MIN_TURNS * float(slowness.mean()) * curve.duration_s > WORK * self._step_s:
                return  # an excessive request would take all the memory
            times_s, step_s = self._clock(grid_s, slowness)
            turns = int(np.clip(WORK / (USUAL_ROUNDS * len(times_s)), MIN_TURNS, TURNS))
            work += turns * len(times_s)
            if work > WORK:
                return
            control = curve.at(times_s) if control is None else _resample(control, belongs_s, times_s)
            control[:AT_REST], control[-AT_REST:] = curve.positions[0], curve.positions[-1]
            corridor = share * self._corridor
            control, belongs_s = fit(curve, control, times_s, step_s, self._limits, corridor, turns)
            needed, used = self._stretch_to_bounds(control, belongs_s, step_s)
            yield
            share /= math.sqrt(max(used, 1.0))
            slowness = self._slower(slowness, grid_s, belongs_s, needed)

    def _clock(self, grid_s: Array, slowness: Array) -> tuple[Array, float]:
        """The time on the curve that corresponds to each control point, shape (n,), and the time step between
        them.

        Args:
            slowness: factor by which the motion is slower than the curve at each of its times `grid_s`.
        """
        clock_s = grid_s[1] * np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))])
        steps = round(clock_s[-1] / self._step_s)
        step_s = float(clock_s[-1]) / steps
        return np.interp(step_s * np.arange(-1.0, steps + AT_REST - 1), clock_s, grid_s), step_s

    def _first_slowness(self, grid_s: Array) -> Array:
        """The slowness that the velocity and acceleration limits require, computed without noise."""
        from scipy.ndimage import gaussian_filter1d, maximum_filter1d

        velocity = self._curve.towards(grid_s)
        acceleration = np.gradient(velocity, grid_s[1], axis=0)
        needed = np.maximum(
            (np.abs(velocity) / self._limits.max_velocity).max(axis=1),
            np.sqrt((np.abs(acceleration) / self._limits.max_acceleration).max(axis=1)),
        )
        return np.asarray(gaussian_filter1d(np.maximum(maximum_filter1d(needed, NEAR), 1.0), SMOOTH))

    @staticmethod
    def _slower(slowness: Array, grid_s: Array, belongs_s: Array, needed: Array) -> Array:
        from scipy.ndimage import gaussian_filter1d, maximum_filter1d

        factor = np.maximum(maximum_filter1d(needed, NEAR), HASTE)
        smooth = gaussian_filter1d(factor, SMOOTH, mode="nearest")
        return np.maximum(slowness * np.interp(grid_s, belongs_s, smooth), 1.0)

    def _in_range(self, control: Array) -> bool:
        """Whether the control points, and therefore the whole motion, are within the joint ranges."""
        low, high = self._limits.min_position - ROUNDING_RAD, self._limits.max_position + ROUNDING_RAD
        return bool(((low <= control) & (control <= high)).all())

    def _stretch_to_bounds(
        self, control: Array, times_s: Array, step_s: float | None = None
    ) -> tuple[Array, float]:
        """Stretch the motion until it keeps its bounds. If it is the best motion so far, store it.

        Returns:
            The factor by which the time around each control point must be stretched, shape (n,), so that
            bounds and corridor hold, and the used share of the corridor.
        """
        step_s = self._curve.step_s if step_s is None else step_s
        needed = stretch_needed(control, step_s, self._limits)
        step_s *= max(float(needed.max()), self._curve.duration_s / (step_s * (len(control) - AT_REST)))
        duration_s = step_s * (len(control) - AT_REST)
        off = deviation(self._curve, control, times_s, step_s)
        share = float((off.largest / self._corridor).max())
        better = self.best is None or duration_s < self.best.motion.duration_s
        if share <= 1.0 and better and self._in_range(control):
            motion = spline_motion(control, step_s)
            self.best = Fitted(motion, float(off.largest.max()), off.times_s)
        beside = (off.at_knots / self._corridor).max(axis=1) ** PER_DEVIATION
        needed[1:-1] = np.maximum(needed[1:-1], beside)
        return needed, share


def _resample(control: Array, belongs_s: Array, times_s: Array) -> Array:
    return np.stack([np.interp(times_s, belongs_s, column) for column in control.T], axis=1)
