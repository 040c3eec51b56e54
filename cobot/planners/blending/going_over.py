"""The transition between two motions that follow the same path with different timing, without a jump in
acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from cobot.motions.stretches import Corner, Leg
from cobot.planners.blending.joined import path_of
from cobot.planners.blending.leg_limits import largest
from cobot.planners.derivatives import chained
from cobot.planners.effort_reserve import TRANSITION_EFFORT
from cobot.planners.timing.coordinates import Coordinates
from cobot.planners.timing.path import JointCurve
from cobot.polynomials import greatest_rates
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import keeps_effort
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits

WIDTHS_S = (0.2, 0.3, 0.15, 0.45)
"""Durations of the transition, in the order in which they are tried."""
BEGINS = 6
"""Number of start times that are tried for each duration, beginning with the earliest."""
KNOT_S, LOOK_S = 0.01, 0.004
"""Time between the knots of a transition, and between the samples at which its limits are checked."""
JERK = 1.15
"""Factor on the jerk limit of plans for a transition. Plans use 0.8 of what the arm permits, so this is still
below the arm's limit.
"""
TOLERANCE = 1e-9
STEP = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
"""The quintic from 0 to 1 whose velocity and acceleration are 0 at both ends."""


@dataclass(frozen=True, slots=True)
class PathTiming:
    """A trajectory and its path parameter over time. The path parameter begins at time `since_s` of the
    trajectory.
    """

    trajectory: Trajectory
    progress: Trajectory
    since_s: float = 0.0

    def places(self, times_s: Array, derivative: int = 0) -> Array:
        """The path parameter or one of its derivatives at the given trajectory times. Shape: (n,)."""
        return np.asarray(self.progress.sample(times_s - self.since_s, derivative)[:, 0])

    def time_of(self, place: float) -> float:
        """The time at which the path parameter has this value."""
        knots = self.progress.breakpoints_s
        time_s = float(np.interp(place, self.progress.sample(knots)[:, 0], knots))
        off = float(place - self.progress.sample([time_s])[0, 0])
        rate = float(self.progress.sample([time_s], 1)[0, 0])
        return self.since_s + time_s + (off / rate if rate > 0.0 else 0.0)


@dataclass(frozen=True, slots=True)
class LimitedPath:
    """A path and the limits that apply along it."""

    path: JointCurve
    coordinates: Coordinates
    limits: JointLimits

    @classmethod
    def of(
        cls,
        robot: RobotDescription,
        legs: Sequence[Leg],
        paths: Sequence[JointCurve],
        corners: Sequence[Corner],
    ) -> LimitedPath:
        """The path of the given motions and its limits. The path includes the blends between the motions."""
        path, zones, _ = path_of(robot, legs, paths, corners)
        limits, of_tcp = largest(robot, legs)
        return cls(path, Coordinates(robot.model, path, limits, of_tcp, zones=zones), limits)

    def holds(self, robot: RobotDescription, law: Array, window: Trajectory) -> bool:
        """Whether the arm stays within the limits during a transition.

        Args:
            law: the path parameter and its three derivatives over time, shape (4, n).
            window: times of the transition.
        """
        if law[1].min() <= 0.0:
            return False
        shares = self.coordinates.shares(law[0])
        dof = self.path.dof
        limits = np.array(
            [self.limits.max_velocity, self.limits.max_acceleration, JERK * self.limits.max_jerk]
        )
        peaks = greatest_rates(window.coefficients, np.diff(window.breakpoints_s)).max(axis=1)
        if (peaks > limits * shares[:, :, :dof].min(axis=1) * (1.0 + TOLERANCE)).any():
            return False
        _, derivatives, slowness = self.coordinates.at(law[0])
        _, acceleration, jerk = np.abs(chained(derivatives, law))
        within = (
            (slowness * law[1] <= 1.0 + TOLERANCE).all()
            and (acceleration <= self.coordinates.max_acceleration * shares[1]).all()
            and (jerk <= JERK * self.coordinates.max_jerk * shares[2]).all()
        )
        return bool(within) and keeps_effort(robot.model, window, self.limits, TRANSITION_EFFORT)


def make_transition(
    robot: RobotDescription,
    course: LimitedPath,
    old: PathTiming,
    new: PathTiming,
    until: float,
    from_s: float,
) -> tuple[Trajectory, float, float] | None:
    """Return a trajectory that begins exactly like the old one and ends exactly like the new one, bit for
    bit.

    Args:
        until: path parameter up to which both paths are the same.
        from_s: time of the old trajectory before which it must not change.

    Returns:
        The trajectory; the time in it at which the new trajectory would have begun; and the time from which
        it equals the new trajectory. Returns None if no transition stays within the limits.
    """
    until_s = old.time_of(until)
    for width_s in WIDTHS_S:
        for begin_s in np.linspace(from_s, until_s - width_s, BEGINS) if until_s - width_s > from_s else ():
            found = _through(robot, course, old, new, until, (float(begin_s), width_s))
            if found is not None:
                return found
    return None


def _through(
    robot: RobotDescription,
    course: LimitedPath,
    old: PathTiming,
    new: PathTiming,
    until: float,
    window: tuple[float, float],
) -> tuple[Trajectory, float, float] | None:
    """Try `make_transition` in one time window. `window` contains the time at which the transition begins,
    and its approximate duration. Returns None if this fails.
    """
    first = int(np.searchsorted(old.trajectory.breakpoints_s, window[0]))
    begin_s = float(old.trajectory.breakpoints_s[first])
    middle_s = begin_s + 0.5 * window[1]
    ahead_s = new.time_of(float(old.places(np.array([middle_s]))[0])) - middle_s
    knots = new.trajectory.breakpoints_s
    last = int(np.searchsorted(knots, middle_s + ahead_s + 0.5 * window[1]))
    if last >= new.trajectory.segments or new.places(knots[last : last + 1])[0] > until:
        return None
    width_s = float(knots[last]) - ahead_s - begin_s
    times_s = np.linspace(0.0, width_s, int(np.ceil(width_s / KNOT_S)) + 1)
    law = _law(old, new, begin_s, ahead_s, width_s, times_s)
    positions, direction, bend, _ = course.path.derivatives(law[0])
    rows = [
        positions,
        direction * law[1][:, None],
        bend * law[1][:, None] ** 2 + direction * law[2][:, None],
    ]
    for order, row in enumerate(rows):
        row[0] = old.trajectory.sample([begin_s], order)[0]
        row[-1] = new.trajectory.sample(knots[last : last + 1], order)[0]
    between = from_hermite(times_s, *rows)
    looked_at = np.linspace(0.0, width_s, int(np.ceil(width_s / LOOK_S)) + 1)
    if not course.holds(robot, _law(old, new, begin_s, ahead_s, width_s, looked_at), between):
        return None
    end_s = begin_s + between.duration_s
    since_s = end_s - float(knots[last])
    times = [
        old.trajectory.breakpoints_s[: first + 1],
        begin_s + between.breakpoints_s[1:],
        since_s + knots[last + 1 :],
    ]
    pieces = [
        old.trajectory.coefficients[:first],
        between.coefficients,
        new.trajectory.coefficients[last:],
    ]
    before = old.trajectory
    whole = Trajectory(np.concatenate(times), np.concatenate(pieces), before.note, notices=before.notices)
    return whole, since_s, end_s


def _law(
    old: PathTiming, new: PathTiming, begin_s: float, ahead_s: float, width_s: float, times_s: Array
) -> Array:
    """The path parameter and its three derivatives during a transition, shape (4, n).

    They are a weighted mean that goes from the old motion to the new one. The time of the new motion is ahead
    by `ahead_s`.
    """
    mine = [old.places(begin_s + times_s, k) for k in range(4)]
    apart = [new.places(begin_s + ahead_s + times_s, k) - mine[k] for k in range(4)]
    share = [STEP.deriv(k)(times_s / width_s) / width_s**k for k in range(4)]
    return np.array(
        [mine[k] + sum(comb(k, i) * share[i] * apart[k - i] for i in range(k + 1)) for k in range(4)]
    )
