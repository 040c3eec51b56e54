"""What a planned motion will be like: data that comes from planning processes."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.trajectory import Trajectory
from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Closest:
    """The least distance between two things along a motion, m, and the share of its duration where it is."""

    first: str
    second: str
    distance_m: float
    share: float


@dataclass(frozen=True, slots=True)
class Forecast:
    """A motion that was planned and not run.

    Attributes:
        trajectory: None if the arm is at the goal already; then there is one sample and nothing moves.
        times_s: of the samples, shape (n,).
        joints: shape (n, dof), rad.
        poses: of the TCP in the base frame, shape (n, 7): m, then w, x, y, z.
        peaks: by quantity (velocity, acceleration, jerk, torque) the greatest of each joint, shape (dof,);
            the first three are true extrema.
        utilisation: the same as shares of the limits that the robot has, not of the request's share.
        closest_self, closest_environment: at the samples; None if nothing comes as near as was looked for.
    """

    trajectory: Trajectory | None
    times_s: Array
    joints: Array
    poses: Array
    peaks: dict[str, Array]
    utilisation: dict[str, Array]
    closest_self: Closest | None
    closest_environment: Closest | None
