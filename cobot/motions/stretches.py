"""Stretches, for planning processes: motions that the arm executes as one, and the data needed to extend
them.
"""

from __future__ import annotations

from dataclasses import dataclass

from cobot.motions.constraints import Constraints
from cobot.trajectory import Trajectory
from cobot.types import CartesianLimits, JointLimits


@dataclass(frozen=True, slots=True)
class Leg:
    """A motion from rest to rest, and the limits with which it was planned.

    Attributes:
        tcp: TCP limits; None if the TCP has no limits.
        constraints: path constraints, relative to the start of the motion.
    """

    motion: Trajectory
    limits: JointLimits
    tcp: CartesianLimits | None
    constraints: Constraints | None = None


@dataclass(frozen=True, slots=True)
class Corner:
    """A blend: a curve that replaces the last part of one path, of length `before`, and the first part of the
    next path, of length `after`.
    """

    curve: Trajectory
    before: float
    after: float
    used_m: float


@dataclass(frozen=True, slots=True)
class Stretch:
    """Motions as one trajectory, and the data needed to extend it. Picklable.

    Attributes:
        trajectory: the motion from rest at the start of the first motion, or from a point on the trajectory
            that it replaces.
        ends_s: the time at which each motion ends and the next begins; of the completed motions, only the
            last ones are listed.
        used_m: for each of the latest motions, the blend radius that is used at the corner before it, m; 0 if
            the arm stops or starts there.
        legs, radii_m, corners: legs, blend radii and corners since the last stop. Each radius belongs to the
            end of a motion.
        progress: path parameter over the time since `since_s`, valid from `valid_s` on; None if the arm must
            stop before a further motion.
        offset_s: path time of the replaced trajectory at which the new one begins.
    """

    trajectory: Trajectory
    ends_s: tuple[float, ...]
    used_m: tuple[float, ...]
    legs: tuple[Leg, ...]
    radii_m: tuple[float, ...]
    corners: tuple[Corner, ...]
    progress: Trajectory | None
    since_s: float
    valid_s: float
    offset_s: float = 0.0


def single_leg(leg: Leg) -> Stretch:
    """A single planned motion, after which the arm stops."""
    end_s = leg.motion.duration_s
    return Stretch(leg.motion, (end_s,), (0.0,), (leg,), (0.0,), (), None, 0.0, 0.0)
