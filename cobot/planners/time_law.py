"""How fast to run along a path: one jerk-limited S-curve from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ruckig
from scipy.interpolate import BSpline

from cobot.planners.profile import fastest_profile
from cobot.robot.feasibility import stretch_to_limits
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits

SAMPLES = 400


@dataclass(frozen=True, slots=True)
class PathRates:
    """The largest first, second and third derivative of the path parameter u, 1/s, 1/s², 1/s³."""

    velocity: float
    acceleration: float
    jerk: float

    def capped(self, other: PathRates) -> PathRates:
        return PathRates(
            min(self.velocity, other.velocity),
            min(self.acceleration, other.acceleration),
            min(self.jerk, other.jerk),
        )


def joint_rates(path: BSpline, limits: JointLimits, cap: PathRates) -> PathRates:
    """The rates at which a joint path q(u), u in [0, 1], keeps the joint limits everywhere.

    With q' etc. for derivatives by u:  |q'| v ≤ V,  |q''| v² + |q'| a ≤ A,
    |q'''| v³ + 3 |q''| v a + |q'| j ≤ J. The path's own curvature is granted half of A and the two
    first terms a third of J each, so that there is always something left to accelerate with.
    """
    u = np.linspace(0.0, 1.0, SAMPLES)
    first, second, third = (np.abs(path.derivative(k)(u)) + 1e-12 for k in (1, 2, 3))
    V, A, J = limits.max_velocity, limits.max_acceleration, limits.max_jerk
    v = float(
        min((V / first).min(), np.sqrt(0.5 * A / second).min(), np.cbrt(J / (3 * third)).min(), cap.velocity)
    )
    a = float(min(((A - second * v**2) / first).min(), (J / (9 * second * v)).min(), cap.acceleration))
    j = float(min(((J - third * v**3 - 3 * second * v * a) / first).min(), cap.jerk))
    return PathRates(v, a, j)


class TimeLaw:
    """u(t): from 0 to 1 within the given rates."""

    def __init__(self, rates: PathRates) -> None:
        problem = ruckig.InputParameter(1)
        problem.target_position = [1.0]
        problem.max_velocity = [rates.velocity]
        problem.max_acceleration = [rates.acceleration]
        problem.max_jerk = [rates.jerk]
        self._curve = fastest_profile(problem)
        self.duration_s = float(self._curve.duration)
        self._phases = np.cumsum(self._curve.profiles[0][0].t)

    def at(self, times_s: Array) -> tuple[Array, Array, Array]:
        """u, u', u'' at the given times, each shape (n,)."""
        rows = np.array([[values[0] for values in self._curve.at_time(float(t))] for t in times_s])
        return rows[:, 0], rows[:, 1], rows[:, 2]

    def knots(self, pieces: int) -> Array:
        """Times from 0 to the end: about `pieces` even steps, and every change of the jerk."""
        even = np.linspace(0.0, self.duration_s, pieces + 1)
        inner = self._phases[(self._phases > 0.0) & (self._phases < self.duration_s)]
        distance = np.abs(even[:, None] - inner[None, :]).min(axis=1, initial=np.inf)
        crowded = distance < 0.1 * self.duration_s / pieces
        crowded[[0, -1]] = False
        times = np.unique(np.concatenate([even[~crowded], inner]))
        keep = np.concatenate([[True], np.diff(times) > 1e-6 * self.duration_s])
        times = times[keep]
        times[-1] = self.duration_s
        return np.asarray(times)


def traverse(path: BSpline, law: TimeLaw, pieces: int, limits: JointLimits) -> Trajectory:
    """The joint path under a time law, as quintics that meet it in value and two derivatives at the knots."""
    times = law.knots(pieces)
    u, du, ddu = law.at(times)
    u = np.clip(u, 0.0, 1.0)
    first, second = path.derivative(1)(u), path.derivative(2)(u)
    velocity = first * du[:, None]
    acceleration = second * du[:, None] ** 2 + first * ddu[:, None]
    velocity[[0, -1]] = 0.0
    acceleration[[0, -1]] = 0.0
    return stretch_to_limits(from_hermite(times, path(u), velocity, acceleration), limits)


def timed(path: BSpline, limits: JointLimits, pieces: int) -> Trajectory:
    """A joint path from rest to rest within the joint limits."""
    unlimited = PathRates(np.inf, np.inf, np.inf)
    return traverse(path, TimeLaw(joint_rates(path, limits, unlimited)), pieces, limits)
