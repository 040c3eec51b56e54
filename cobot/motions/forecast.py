"""Data about a planned motion before it runs, from planning processes."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.trajectory import Trajectory
from cobot.types import Array, Numbers3


@dataclass(frozen=True, slots=True)
class Closest:
    """The shortest distance between two bodies along a motion, m.

    Attributes:
        share: time at which the shortest distance occurs, as a share of the duration.
        points: the nearest points of the first and of the second body, in the base frame, m.
    """

    first: str
    second: str
    distance_m: float
    share: float
    points: tuple[Numbers3, Numbers3]


@dataclass(frozen=True, slots=True)
class Forecast:
    """A motion that was planned but not run.

    Attributes:
        trajectory: the motion; None if the arm is already at the goal. Then there is one sample, and nothing
            moves.
        times_s: times of the samples, shape (n,).
        joints: joint positions of the samples, shape (n, dof), rad.
        poses: TCP poses in the base frame, shape (n, 7): x, y, z, m, and w, x, y, z.
        peaks: maximum of each joint, shape (dof,), by quantity (velocity, acceleration, jerk, torque); the
            first three are true extrema.
        utilisation: the peaks as shares of the robot's limits, without the request's scaling.
        closest_self, closest_environment: shortest distances among the samples; None if everything is farther
            apart than the search distance.
    """

    trajectory: Trajectory | None
    times_s: Array
    joints: Array
    poses: Array
    peaks: dict[str, Array]
    utilisation: dict[str, Array]
    closest_self: Closest | None
    closest_environment: Closest | None
