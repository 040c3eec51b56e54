"""Time parameterization: along a path as fast as velocity, acceleration, jerk and torque limits allow.

A first timing, see `reference_motion`, divides the motion into cells. The cells are longer where the motion
hardly uses its acceleration limits. Then the rate of the motion is optimised under all limits at once, see
`fastest_rate`, and the motion becomes one quintic per cell. Where its true extrema between the checked points
exceed a limit, this limit is tightened and the rate is optimised again. Stretching the whole motion removes
the small remainder.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from cobot.errors import InputError, PlanningError
from cobot.findings import Finding
from cobot.planners.derivatives import chained
from cobot.planners.effort_reserve import MAX_HOLDING_EFFORT, PLANNED_EFFORT, allowed_shares
from cobot.planners.interior_point import Stations, fastest_rate
from cobot.planners.reference import reference_motion
from cobot.planners.timing.cells import (
    acceleration_stations,
    cubics,
    duration_stations,
    jerk_stations,
    motion,
    states,
    times_of,
)
from cobot.planners.timing.coordinates import Coordinates, Zones
from cobot.planners.timing.path import JointCurve
from cobot.polynomials import greatest_rates, hermite
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import keeps_effort
from cobot.trajectory import ORDER, Integers, Trajectory
from cobot.types import PLANNED_ACCELERATION, Array, CartesianLimits, JointLimits

MIN_CELLS, MAX_CELLS = 64, 1000
CELLS_PER_BUILD_UP, FINER_CELLS = 8, 32
"""Number of cells for the time in which a full acceleration builds up. The second number is for a path that
changes within a few cells of the first size.
"""
PLACES = 100
"""Minimum number of points of a path that the first timing checks."""
ZONE_PLACES, MAX_ZONE_PLACES = 6, 2000
"""Minimum number of these points in the shortest zone, unless this needs more points than the second number
along the whole path. Otherwise cells would be longer than a zone that lies between two points.
"""
GAP = 5e-4
"""The optimisation ends if at most this share of the duration could still be gained."""
ITERATIONS = 60
MAX_DURATION_S = 1e9
"""Longest duration, about thirty years, because powers of longer times overflow."""
ROUNDS, MAX_ROUNDS = 3, 8
TIGHT = 1.003
"""A motion is optimised again if it must be stretched by more than `TIGHT` to stay within its limits. It is
optimised up to `ROUNDS` times, plus once for each zone after the first, at most `MAX_ROUNDS` times.
"""
COARSE = 1.02
"""A motion that must be stretched by more than this to stay within its limits is divided into more cells."""
UNBOUNDED = 1e9
ENDING_CELLS = 2
"""Number of cells at each end of the path where the jerk is also limited in the middle of the cell,
because it changes most when the motion starts from rest.
"""


@dataclass(frozen=True, slots=True)
class Timed:
    """A path with its time parameterization.

    Attributes:
        trajectory: the motion from rest to rest.
        make_progress: computes `progress`, which most callers do not need.
        stretched: factor by which the motion was made longer to stay within its limits at its true extrema.
    """

    trajectory: Trajectory
    make_progress: Callable[[], Trajectory]
    stretched: float = 1.0

    @property
    def progress(self) -> Trajectory:
        """The path parameter over time, as a trajectory with one dimension."""
        return self.make_progress()


def time_optimal(
    robot: RobotDescription,
    path: JointCurve,
    limits: JointLimits,
    tcp_limits: CartesianLimits | None = None,
    zones: Zones | None = None,
) -> Timed:
    """Time a path from rest to rest, close to the time optimum.

    The joint limits apply, the TCP limits if they are given, and the effort limits of the drives with the
    model's load. At most `PLANNED_ACCELERATION` of the robot's acceleration limits is used, even if `limits`
    are higher. The share of the effort limits is defined in `cobot.planners.effort_reserve`. Efforts are
    included in the optimisation only if the motion computed without them needs more than `PLANNED_EFFORT`.
    `zones` are parts of the path with lower limits.

    Raises:
        PlanningError: the efforts do not suffice to hold the arm somewhere on the path, or the limits are too
            small for any motion.
    """
    limits = with_room(robot, limits)
    coordinates = Coordinates(robot.model, path, limits, tcp_limits, zones=zones)
    most = MAX_CELLS * len(coordinates.zones.ends)
    reference = _reference(coordinates)
    bounds = ((MIN_CELLS, most, cells) for cells in (CELLS_PER_BUILD_UP, FINER_CELLS))
    laws = (reference_motion(*reference, path.length, each) for each in bounds)
    return _solve_laws(robot, coordinates, laws)


def with_room(robot: RobotDescription, limits: JointLimits) -> JointLimits:
    """The limits, with at most `PLANNED_ACCELERATION` of the robot's acceleration limits."""
    room = PLANNED_ACCELERATION * robot.limits.max_acceleration
    if (limits.max_acceleration <= room).all():
        return limits
    acceleration = np.minimum(limits.max_acceleration, room)
    return limits.with_rates(limits.max_velocity, acceleration, limits.max_jerk)


def _reference(coordinates: Coordinates) -> tuple[Array, Array, Array, Array]:
    """The first arguments of `reference_motion`. The last one is a speed that stays within the limits."""
    length, pieces = coordinates.path.length, len(coordinates.path.coefficients)
    shortest = float(np.diff(coordinates.zones.ends, prepend=0.0).min())
    of_zones = min(ZONE_PLACES * length / max(shortest, 1e-12), MAX_ZONE_PLACES)
    places = np.linspace(0.0, length, max(PLACES, 3 * pieces, math.ceil(of_zones)) + 1)
    _, (first, second, third), slowness = coordinates.at(places)
    _, acceleration, jerk = coordinates.shares(places)
    max_acceleration, max_jerk = coordinates.max_acceleration * acceleration, coordinates.max_jerk * jerk
    speed = 1.0 / np.maximum(slowness, 1e-12)
    for derivative, limit, order in ((second, max_acceleration, 2), (third, max_jerk, 3)):
        share = np.maximum((np.abs(derivative) / limit).max(axis=1), 1e-12)
        speed = np.minimum(speed, share ** (-1.0 / order))
    return first / max_acceleration, second / max_acceleration, first / max_jerk, speed


def _solve_laws(
    robot: RobotDescription, coordinates: Coordinates, laws: Iterator[tuple[Array, Array]]
) -> Timed:
    """The fastest motion. The optimisation begins with the first of the given timings. If the cells of this
    timing are too coarse, it continues with the next one, which has more cells.
    """
    limits = coordinates.limits
    with np.errstate(all="ignore"):
        try:
            for points, widths in laws:
                problem = _Problem(robot, coordinates, points, widths)
                first = problem.solve()
                if first.stretched <= COARSE:
                    break
            timed = problem.refine(first).timed()
            if not keeps_effort(robot.model, timed.trajectory, limits, PLANNED_EFFORT):
                problem.limit_efforts()
                timed = problem.refine(problem.solve()).timed()
            if not timed.trajectory.duration_s < MAX_DURATION_S:
                raise ValueError(f"it would take {timed.trajectory.duration_s:.3g} s")
        except (ValueError, InputError, OverflowError) as exc:
            raise PlanningError(
                f"no motion along the path from rest to rest: limits may be too small ({exc})",
                findings=[Finding("time", "duration, more than", MAX_DURATION_S, MAX_DURATION_S, "s")],
            ) from exc
    return timed


@dataclass(frozen=True, slots=True)
class _Law:
    """A time parameterization: the quintics of `Timed.trajectory`, and its other attributes."""

    times: Array
    coefficients: Array
    make_progress: Callable[[], Trajectory]
    stretched: float

    @property
    def duration_s(self) -> float:
        return float(self.times[-1])

    def timed(self) -> Timed:
        """The motion along the path."""
        return Timed(Trajectory(self.times, self.coefficients), self.make_progress, self.stretched)


class _Problem:
    """One optimisation: the first timing, and all limited quantities at the knots and in the middle of the
    cells.
    """

    def __init__(
        self, robot: RobotDescription, coordinates: Coordinates, points: Array, widths: Array
    ) -> None:
        """
        Args:
            points: the control points of s(τ).
            widths: the relative durations of the cells.
        """
        self._robot, self._coordinates = robot, coordinates
        self._path, self._limits = coordinates.path, coordinates.limits
        self._cells = len(points) - 3
        edges = np.concatenate([widths[:1], widths, widths[-1:]])
        self._begin = edges**-2.0  # at this rate the cells have these durations
        begins, middles, ends = cubics(points)
        law = np.concatenate([begins, middles, ends[:, -1:]], axis=1)
        joints, derivatives, slowness = coordinates.at(law[0])
        last = len(law[0]) - 1
        knots, places, ending = _checked_places(self._cells)
        self._joints, self._law = joints, law
        self._knots, self._at_knots = law[:, knots], joints[:, knots]
        # Rows for accelerations and squared velocities.
        first, second, _ = chained(derivatives, law, coordinates.max_acceleration)
        speed = (slowness * law[1])[:, None] ** 2
        self._accelerations = (
            np.concatenate([first, np.zeros_like(speed)], axis=1),
            np.concatenate([second, speed], axis=1),
        )
        self._efforts: tuple[Array, Array] | None = None
        self._bounded: list[Stations] = []
        # Rows for jerks, at both ends of each cell, and in the middle of the first and last cells.
        jerks = np.concatenate([begins, ends, middles[:, ending]], axis=1)
        self._jerks = chained(derivatives[:, places], jerks, coordinates.max_jerk)
        self._shares = coordinates.shares(law[0, : self._cells])
        if len(coordinates.zones.ends) > 1:
            others = coordinates.shares(law[0, self._cells : last]), coordinates.shares(self._knots[0, 1:])
            self._shares = np.minimum(np.minimum(self._shares, others[0]), others[1])
        self._tightened = self._shares[1:].copy()

    def refine(self, best: _Law) -> _Law:
        """Solve repeatedly, with tighter limits where extrema exceed the limits. Returns the fastest motion
        found.
        """
        for _ in range(min(ROUNDS + len(self._coordinates.zones.ends) - 1, MAX_ROUNDS)):
            if best.stretched <= TIGHT:
                break
            again = self.solve()
            if again.duration_s < best.duration_s:
                best = again
        return best

    def solve(self) -> _Law:
        """The fastest motion within the limits at the checked points, slowed down until it is within the
        limits everywhere.
        """
        if self._bounded:
            for stations, bounds in zip(self._bounded, self._bounds(), strict=True):
                stations.bound(*bounds)
        else:
            self._bounded = self._stations()
        rate, _, _ = fastest_rate(self._begin, _duration(self._cells), self._bounded, GAP, ITERATIONS)
        return self._make_motion(rate)

    def _stations(self) -> list[Stations]:
        """The points at which accelerations, velocities and efforts are limited, and the points at which
        jerks are limited.
        """
        first, second, third = self._jerks
        accelerations, jerks = self._bounds()
        places, jerk_places = acceleration_stations(self._cells), jerk_stations(self._cells, ENDING_CELLS)
        return [
            Stations(*places, *self._accelerations, None, *accelerations),
            Stations(*jerk_places, first, second, third, *jerks),
        ]

    def _bounds(self) -> list[tuple[Array, Array]]:
        """The lower and upper bounds at the given points."""
        high = self._tightened[0, acceleration_stations(self._cells)[0]]
        one = np.ones((len(high), 1))
        low = np.concatenate([-high, -UNBOUNDED * one], axis=1)
        high = np.concatenate([high, one], axis=1)
        if self._efforts is not None:
            low, high = (
                np.concatenate(both, axis=1) for both in zip((low, high), self._efforts, strict=True)
            )
        jerk = self._tightened[1, jerk_stations(self._cells, ENDING_CELLS)[0]]
        return [(low, high), (-jerk, jerk)]

    def limit_efforts(self) -> None:
        """Add the effort limits to the constraints.

        The effort of a joint has three parts: holding the arm, accelerating along the path, and following its
        curvature.

        Raises:
            PlanningError: at some point of the path the drives cannot hold the arm.
        """
        dynamics, limits = self._robot.model.dynamics, self._limits
        joints, still = self._joints, np.zeros_like(self._joints[0])
        held = dynamics.inverse(joints[0], still, still)
        _require_held(held, self._law[0] / self._path.length, limits)
        along = dynamics.inverse(joints[0], still, joints[1]) - held
        curved = dynamics.inverse(joints[0], joints[1], joints[2]) - held
        first, second, _ = chained(np.array([along, curved, still]), self._law, limits.max_effort)
        share = held / limits.max_effort
        allowed = allowed_shares(share)
        self._efforts = -allowed - share, allowed - share
        before = self._accelerations
        self._accelerations = (
            np.concatenate([before[0], first], axis=1),
            np.concatenate([before[1], second], axis=1),
        )
        self._bounded = []

    def _make_motion(self, rate: Array) -> _Law:
        """The motion as quintics. At the knots, they match the path and the rate in value and two
        derivatives.
        """
        times, squares, slopes = times_of(rate)
        first, second, _ = chained(self._at_knots[1:], self._knots)
        first[[0, -1]] = second[[0, -1]] = 0.0  # exactly at rest, despite rounding
        coefficients = hermite(times, *states(self._at_knots[0], first, second, squares, slopes))
        limits = (self._limits.max_velocity, self._limits.max_acceleration, self._limits.max_jerk)
        bounds = np.array(limits)[:, None] * self._shares[:, :, : self._path.dof]
        # Used share of each limit in each cell: exact above 1, otherwise an upper bound.
        used = np.asarray(greatest_rates(coefficients, np.diff(times), bounds) / bounds)
        stretched = max(float((used.max(axis=(1, 2)) ** (1.0 / np.arange(1, 4))).max()), 1.0)
        if stretched > TIGHT:  # tighten the limits of cells whose true extrema exceed them
            self._tightened[:, :, : self._path.dof] /= np.maximum(used[1:], 1.0)
        # The motion is slowed down evenly, just enough to keep the rate limits of each cell.
        place, *rates = self._knots[:3, :, None]
        squares, slopes = squares / stretched**2, slopes / stretched**2
        progress = partial(motion, times * stretched, place, rates[0], rates[1], squares, slopes)
        return _Law(times * stretched, coefficients / stretched ** np.arange(ORDER), progress, stretched)


@lru_cache(maxsize=32)
def _checked_places(cells: int) -> tuple[Integers, Integers, Integers]:
    """The points at which a time law is checked: the beginnings and the middles of all cells, and the end.

    Returns:
        The indices of the knots among these points; the indices at which the jerk is limited; and the cells
        with an additional limit of the jerk in the middle.
    """
    knots = np.append(np.arange(cells), 2 * cells)
    ending = np.append(np.arange(ENDING_CELLS), np.arange(cells - ENDING_CELLS, cells))
    return knots, np.concatenate([knots[:-1], knots[1:], cells + ending]), ending


@lru_cache(maxsize=32)
def _duration(cells: int) -> Stations:
    """Simpson's rule for the motion's duration."""
    index, base, weights = duration_stations(cells)
    none = np.zeros_like(weights)
    return Stations(index, base, none, none, None, none, weights)


def _require_held(held: Array, places: Array, limits: JointLimits) -> None:
    """Check that the efforts suffice to hold the arm at `places`, given as shares of the path. Shape:
    (n,).
    """
    share = np.abs(held) / limits.max_effort
    place, joint = np.unravel_index(int(share.argmax()), share.shape)
    if share[place, joint] >= MAX_HOLDING_EFFORT:
        where, name = float(places[place]), limits.names[int(joint)]
        needed, limit = float(abs(held[place, joint])), float(limits.max_effort[joint])
        unit = limits.effort_unit(int(joint))
        raise PlanningError(
            f"{name} needs {needed:.4g} {unit} to hold the arm at {100.0 * where:.0f} % of the path, "
            f"but its limit is {limit:.4g} {unit}",
            findings=[Finding("effort", "effort at rest", needed, limit, unit, where, (name,))],
        )
