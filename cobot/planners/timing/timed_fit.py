"""Timed motions of others, which know no jerk or are rounded, as the nearest ones that an arm can follow.

Whoever plans with velocities and accelerations alone jumps in acceleration, and whoever writes a spreadsheet
rounds. Both is a matter of milliradians, but the jerk of it is without bounds: to slow the whole motion down
until that holds costs many times its duration. Instead the motion may be beside the curve within a corridor,
and slower only where it has to be. First moving averages are tried, which cost nothing and keep every bound
that the points keep; then `jerk_fit`, in rounds: after each the curve's time runs slower where a bound is
still exceeded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cobot.planners.corridor import PARTS, asked_curve, deviation
from cobot.planners.jerk_fit import fit
from cobot.planners.timing.uniform_spline import AT_REST, averaged, spline_motion, stretch_needed
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

STEPS_TO_FULL_ACCELERATION = 10
MIN_STEPS, MAX_STEPS = 40, 60_000
MUCH_SLOWER = 1.5
"""What has to be slower by this factor on the whole gets steps of the time that it will take."""
AVERAGES = [(3, 1), (5, 1), (7, 3), (10, 1), (10, 5), (14, 1), (14, 7), (20, 1)]
"""Over so many steps: once over the first number, twice over the second."""
TOO_FAR = 1.5
"""Longer averages than one that leaves the corridor by this factor are not tried."""
ROUNDS, TURNS, WORK = 16, 200, 2_500_000
"""At the most so many rounds of so many turns, and so many turns times control points in all."""
USUAL_ROUNDS, MIN_TURNS = 8, 30
"""What is long has less turns a round, so that it has rounds at all."""
PER_DEVIATION = 0.08
"""Where the motion leaves the corridor, time is stretched by this power of how far it does: carefully, as the
turns that are still to come bring most of it back.
"""
INNER, MIN_INNER = 0.85, 0.2
"""The share of the corridor that the fit's control points may use, less what the noise takes of it."""
AS_ASKED = 1.002
"""What lasts no longer than so many times the asked duration is not improved."""
NEAR, SMOOTH = 7, 3.0
"""Where a bound is exceeded, time is stretched over so many control points, smoothly over so many more."""
ROUNDING_RAD = 1e-9
HASTE = 0.97
"""Where nothing is exceeded, time may be won back by this factor a round, up to what was asked."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """A motion within all bounds.

    Attributes:
        off_rad: the most that any joint is beside the curve.
        times_s: of the curve, at each of the motion's breakpoints.
    """

    motion: Trajectory
    off_rad: float
    times_s: Array


def fitted(asked: Trajectory, limits: JointLimits, corridor: Array, longest_s: float) -> Fitted | None:
    """The shortest motion found that is within the limits and within the corridor around the asked one.

    It is never shorter than what was asked for.

    Args:
        asked: from rest to rest.
        corridor: how far each joint may be beside it, shape (dof,), rad.
        longest_s: what lasts longer is of no use.

    Returns:
        None if there is none within the corridor, or none as short as `longest_s`, as is clear beforehand.
    """
    search = _Fitting(asked, limits, corridor)
    if search.least_s > longest_s:
        return None
    for _ in search.steps():
        if search.best is not None and search.best.motion.duration_s <= AS_ASKED * asked.duration_s:
            break
    return search.best


class _Fitting:
    """Better and better motions along one curve.

    Attributes:
        best: the shortest one so far that is within the corridor.
        least_s: no motion within the velocities is shorter than this.
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
        """Each time one more has been tried."""
        start = self._sampled()
        for counts in AVERAGES:
            control, times_s = (self._averages(each, counts) for each in start)
            used = self._judge(control, times_s)[1]
            yield
            if used > TOO_FAR:
                break
        yield from self._rounds()

    def _sampled(self) -> tuple[Array, Array]:
        """The curve's means over each step, and its times, with rest at both ends."""
        curve = self._curve
        rows_s = np.linspace(0.0, curve.duration_s, len(curve.positions))
        means, times_s = (averaged(each, PARTS)[PARTS // 2 :: PARTS] for each in (curve.positions, rows_s))
        means[0], means[-1] = curve.positions[0], curve.positions[-1]
        pad = (AT_REST - 1, AT_REST - 1)
        return np.pad(means, (pad, (0, 0)), "edge"), np.pad(times_s, pad, "edge")

    @staticmethod
    def _averages(values: Array, counts: tuple[int, int]) -> Array:
        wide, narrow = counts
        return averaged(averaged(averaged(values, wide), narrow), narrow)

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
                return  # else who asks for a lot too much takes all memory
            times_s, step_s = self._clock(grid_s, slowness)
            turns = int(np.clip(WORK / (USUAL_ROUNDS * len(times_s)), MIN_TURNS, TURNS))
            work += turns * len(times_s)
            if work > WORK:
                return
            control = curve.at(times_s) if control is None else _resampled(control, belongs_s, times_s)
            control[:AT_REST], control[-AT_REST:] = curve.positions[0], curve.positions[-1]
            corridor = share * self._corridor
            control, belongs_s = fit(curve, control, times_s, step_s, self._limits, corridor, turns)
            needed, used = self._judge(control, belongs_s, step_s)
            yield
            share /= math.sqrt(max(used, 1.0))
            slowness = self._slower(slowness, grid_s, belongs_s, needed)

    def _clock(self, grid_s: Array, slowness: Array) -> tuple[Array, float]:
        """Which times of the curve the control points belong to, shape (n,), and their step.

        Args:
            slowness: how much longer than the curve the motion takes at each of its times `grid_s`.
        """
        clock_s = grid_s[1] * np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))])
        steps = round(clock_s[-1] / self._step_s)
        step_s = float(clock_s[-1]) / steps
        return np.interp(step_s * np.arange(-1.0, steps + AT_REST - 1), clock_s, grid_s), step_s

    def _first_slowness(self, grid_s: Array) -> Array:
        """What the velocities and the accelerations need, as far as they are no noise."""
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
        """Whether the control points, and so all of the motion, are within the joints' ranges."""
        low, high = self._limits.min_position - ROUNDING_RAD, self._limits.max_position + ROUNDING_RAD
        return bool(((low <= control) & (control <= high)).all())

    def _judge(self, control: Array, times_s: Array, step_s: float | None = None) -> tuple[Array, float]:
        """Keep the motion if it is better; it is stretched by what is missing to its bounds.

        Returns:
            By which factor the time around each control point has to be stretched, shape (n,), so that bounds
            and corridor hold, and which share of the corridor is used.
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


def _resampled(control: Array, belongs_s: Array, times_s: Array) -> Array:
    return np.stack([np.interp(times_s, belongs_s, column) for column in control.T], axis=1)
