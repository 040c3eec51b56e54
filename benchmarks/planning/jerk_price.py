"""The shortest duration along a path within velocity, acceleration and jerk limits, found by an independent
optimiser.

It shares nothing with the time law but the path. The unknowns are the third derivative of the path's
parameter, constant in each of some even steps of time, and the duration T. With times as shares of T the
limits are

    |q' s'| ≤ V T,    |q'' s'² + q' s''| ≤ A T²,    |q''' s'³ + 3 q'' s' s'' + q' s'''| ≤ J T³,

looked at between the steps. Linear programs (HiGHS) make it better within a trust region until there is
nothing to gain, from a slow motion, and from a given one. What that finds are local optima, as the problem is
not convex; limits hold at fewer places than in the time law, so that they may be a little too fast.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from cobot.planners.timing.path import JointCurve
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

ROUNDS, MIN_TRUST, MIN_GAIN = 60, 1e-5, 1e-5
"""Programs at the most; and where they end: at such a trust region or gain, as shares of the duration."""
SLOWER = 3.0
"""The slow motion takes so many times as long as the given one."""
EXCESS = 50.0
"""What a limit's excess costs, in durations."""
BEND = 1e-5
"""The path's fourth derivative is a difference over so much of its length."""


@dataclass(frozen=True, slots=True)
class _Limited:
    """One time derivative at each place, shape (n, dof), its limit, shape (dof,), and their slopes.

    Attributes:
        slopes: of the value by s, s' and s'' at the same places, then by s''' in the step, 0 where not.
        limit_slope: of the limit by the duration.
        places: of the steps' ends, those at which it is looked at.
    """

    values: Array
    slopes: tuple[Array, Array, Array, Array]
    limit: Array
    limit_slope: Array
    places: slice


class Optimiser:
    """The optimiser for one path, from rest to rest."""

    def __init__(self, path: JointCurve, limits: JointLimits, steps: int) -> None:
        self._path, self._limits, self._steps = path, limits, steps
        self._sums = _integrals(steps)

    def shortest_s(self, motion: Trajectory) -> float:
        """The duration of the best motion. If the motion exceeds a limit, it is first slowed down until it
        does not. `motion` is a motion of the path's parameter.
        """
        middles, given_s = (np.arange(self._steps) + 0.5) / self._steps, motion.duration_s
        # Of the quintic from rest to rest.
        slow = self._path.length * (60.0 - 360.0 * middles + 360.0 * middles**2)
        given = motion.sample(middles * given_s, 3)[:, 0] * given_s**3
        return min(self._improved(slow, SLOWER * given_s), self._improved(given, given_s))

    def _improved(self, jerk: Array, duration_s: float) -> float:
        ends, trust = np.array([total[-1] for total in self._sums]), 0.2
        missing = np.array([self._path.length, 0.0, 0.0]) - ends @ jerk
        jerk = jerk + ends.T @ np.linalg.solve(ends @ ends.T, missing)
        merit = duration_s * self._excess(jerk, duration_s)
        for _ in range(ROUNDS):
            step = self._step(jerk, duration_s, trust)
            if step is None:
                trust *= 0.5
                continue
            there, then_s = jerk + step[:-1], duration_s + float(step[-1])
            found = then_s * self._excess(there, then_s)
            gain = merit - found
            if gain <= 0.0:
                trust *= 0.4
            else:
                jerk, duration_s, merit, trust = there, then_s, found, min(1.5 * trust, 0.5)
            if trust < MIN_TRUST or 0.0 < gain < MIN_GAIN * duration_s:
                break
        worst = max(float((np.abs(row.values) / row.limit).max()) for row in self._limited(jerk, duration_s))
        return duration_s * max(worst, 1.0)

    def _excess(self, jerk: Array, duration_s: float) -> float:
        """The factor by which the motion must be slowed down; 1 if it is within all limits."""
        rows = self._limited(jerk, duration_s)
        return 1.0 + 3.0 * max(0.0, *(float((np.abs(row.values) / row.limit).max()) - 1.0 for row in rows))

    def _limited(self, jerk: Array, duration_s: float) -> list[_Limited]:
        place, speed, change = (total @ jerk for total in self._sums)
        u, v = speed[:, None], change[:, None]
        length, limits, none = self._path.length, self._limits, np.zeros(1)
        _, first, second, third = self._path.derivatives(place)
        ahead, behind = (self._path.derivatives(place + side * BEND * length)[3] for side in (1.0, -1.0))
        fourth = (ahead - behind) / (2.0 * BEND * length)
        t, whole = duration_s, slice(None)
        speeds, pulls, jolts = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        rows = [
            _Limited(first * u, (second * u, first, none, none), speeds * t, speeds, whole),
            _Limited(
                second * u**2 + first * v,
                (third * u**2 + second * v, 2.0 * second * u, first, none),
                pulls * t**2,
                2.0 * pulls * t,
                whole,
            ),
        ]
        for places in (slice(0, -1), slice(1, None)):  # each step's begin, and its end
            one, two, three, four = (each[places] for each in (first, second, third, fourth))
            a, b, c = u[places], v[places], jerk[:, None]
            rows.append(
                _Limited(
                    three * a**3 + 3.0 * two * a * b + one * c,
                    (
                        four * a**3 + 3.0 * three * a * b + two * c,
                        3.0 * three * a**2 + 3.0 * two * b,
                        3.0 * two * a,
                        one,
                    ),
                    jolts * t**3,
                    3.0 * jolts * t**2,
                    places,
                )
            )
        return rows

    def _step(self, jerk: Array, duration_s: float, trust: float) -> Array | None:
        """The best change of all unknowns within the linearised limits, shape (steps + 1,)."""
        above, room = [], []
        for row in self._limited(jerk, duration_s):
            sums = [total[row.places] for total in self._sums]
            for joint in range(self._path.dof):
                by = [slope[:, joint] if slope.ndim > 1 else np.zeros(len(sums[0])) for slope in row.slopes]
                turned = sum(part[:, None] * total for part, total in zip(by, sums, strict=False))
                turned = np.asarray(turned)
                if len(turned) == self._steps:
                    turned = turned + np.diag(by[3])
                limit, slope = row.limit[joint], np.full((len(turned), 1), -row.limit_slope[joint])
                for side in (1.0, -1.0):
                    above.append(np.hstack([side * turned, slope, np.full_like(slope, -limit)]) / limit)
                    room.append(1.0 - side * row.values[:, joint] / limit)
        speed = self._sums[1]
        above.append(np.hstack([-speed, np.zeros((len(speed), 2))]))  # never backwards
        room.append(speed @ jerk)
        ends = np.array([total[-1] for total in self._sums])
        most = trust * float(np.abs(jerk).max())
        found = linprog(
            np.concatenate([np.zeros(self._steps), [1.0, EXCESS * duration_s]]),
            A_ub=csr_matrix(np.vstack(above)),
            b_ub=np.concatenate(room),
            A_eq=np.hstack([ends, np.zeros((3, 2))]),
            b_eq=np.array([self._path.length, 0.0, 0.0]) - ends @ jerk,
            bounds=[(-most, most)] * self._steps + [(-trust * duration_s, trust * duration_s), (0.0, None)],
            method="highs",
        )
        return np.asarray(found.x[:-1]) if found.status == 0 else None


def _integrals(steps: int) -> tuple[Array, Array, Array]:
    """For each step's jerk: the distance, speed and acceleration at the steps' ends, shape (steps + 1, steps)
    each.
    """
    width = 1.0 / steps
    since = width * (np.arange(steps + 1)[:, None] - np.arange(1, steps + 1))
    begun, since = since >= 0.0, np.maximum(since, 0.0)
    way = width**3 / 6.0 + 0.5 * width**2 * since + 0.5 * width * since**2
    return begun * way, begun * (0.5 * width**2 + width * since), begun * width
