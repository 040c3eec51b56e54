"""Timed motions of others, which know no jerk or are rounded, as the nearest ones that an arm can follow.

Whoever plans with velocities and accelerations alone jumps in acceleration, and whoever writes a spreadsheet
rounds. Both is a matter of milliradians, but the jerk of it is without bounds: to slow the whole motion down
until that holds costs many times its duration. Instead the motion may be beside the curve within a corridor,
and slower only where it has to be. First moving averages are tried, which cost nothing and keep every bound
that the points keep; then `jerk_fit`, in rounds: after each the curve's time runs slower where a bound is
still exceeded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from cobot.planners.corridor import PARTS, asked_curve, deviation
from cobot.planners.jerk_fit import fit
from cobot.planners.uniform_spline import AT_REST, averaged, spline_motion, stretch_needed
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

STEPS_TO_FULL_ACCELERATION = 10
LEAST_STEPS, MOST_STEPS = 40, 60_000
AVERAGES = [(3, 1), (5, 1), (7, 3), (10, 1), (10, 5), (14, 1), (14, 7), (20, 1)]
"""Over so many steps: once over the first number, twice over the second."""
ROUNDS, TURNS, WORK = 8, 150, 3_000_000
"""At the most so many rounds of so many turns, and so many turns times control points in all."""
INNER = 0.75
"""The share of the corridor that the fit's control points may use."""
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
    search = _Search(asked, limits, corridor)
    if search.least_s > longest_s:
        return None
    for _ in search.steps():
        if search.best is not None and search.best.motion.duration_s <= AS_ASKED * asked.duration_s:
            break
    return search.best


class _Search:
    """Better and better motions along one curve.

    Attributes:
        best: the shortest one so far that is within the corridor.
        least_s: no motion within the velocities is shorter than this.
    """

    def __init__(self, asked: Trajectory, limits: JointLimits, corridor: Array) -> None:
        step_s = float((limits.max_acceleration / limits.max_jerk).min()) / STEPS_TO_FULL_ACCELERATION
        step_s = np.clip(step_s, asked.duration_s / MOST_STEPS, asked.duration_s / LEAST_STEPS)
        self._limits = limits
        self._corridor = corridor
        self._curve = asked_curve(asked, float(step_s))
        self.least_s = self._curve.interval_s * float(
            (np.abs(self._curve.directions) / limits.max_velocity).max(axis=1).sum()
        )
        self.best: Fitted | None = None

    def steps(self) -> Iterator[None]:
        """Each time one more has been tried."""
        start = self._sampled()
        for counts in AVERAGES:
            control, times_s = (self._averages(each, counts) for each in start)
            self._judge(control, times_s)
            yield
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
        control: Array | None = None
        belongs_s, share, work = grid_s, INNER, 0
        for _ in range(ROUNDS):
            clock_s = np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))])
            clock_s *= grid_s[1]
            count = round(clock_s[-1] / curve.step_s) + AT_REST
            times_s = np.interp(np.arange(count) - 1.0, clock_s / clock_s[-1] * (count - AT_REST), grid_s)
            work += TURNS * count
            if work > WORK and control is not None:
                return
            control = curve.at(times_s) if control is None else _resampled(control, belongs_s, times_s)
            for end, rows in ((0, slice(0, AT_REST)), (-1, slice(count - AT_REST, count))):
                control[rows] = curve.positions[end]
            control, belongs_s = fit(
                curve,
                control,
                times_s,
                clock_s[-1] / (count - AT_REST),
                self._limits,
                share * self._corridor,
                max(min(TURNS, WORK // count), 20),
            )
            needed, off = self._judge(control, belongs_s, clock_s[-1] / (count - AT_REST))
            share *= min(1.0, 0.95 / off)
            yield
            slowness = self._slower(slowness, grid_s, belongs_s, needed)

    def _first_slowness(self, grid_s: Array) -> Array:
        """What the velocities alone need."""
        needed = (np.abs(self._curve.towards(grid_s)) / self._limits.max_velocity).max(axis=1)
        return np.asarray(gaussian_filter1d(np.maximum(maximum_filter1d(needed, NEAR), 1.0), SMOOTH))

    @staticmethod
    def _slower(slowness: Array, grid_s: Array, belongs_s: Array, needed: Array) -> Array:
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
            See `stretch_needed`, and the share of the corridor that is used.
        """
        step_s = self._curve.step_s if step_s is None else step_s
        needed = stretch_needed(control, step_s, self._limits)
        step_s *= max(float(needed.max()), self._curve.duration_s / (step_s * (len(control) - AT_REST)))
        duration_s = step_s * (len(control) - AT_REST)
        motion = spline_motion(control, step_s)
        off, matched_s = deviation(self._curve, control, times_s, motion)
        share = float((off / self._corridor).max())
        better = self.best is None or duration_s < self.best.motion.duration_s
        if share <= 1.0 and better and self._in_range(control):
            self.best = Fitted(motion, float(off.max()), matched_s)
        return needed, share


def _resampled(control: Array, belongs_s: Array, times_s: Array) -> Array:
    return np.stack([np.interp(times_s, belongs_s, column) for column in control.T], axis=1)
