"""Motions that the arm goes through as one, and what is known of them: data for planning processes."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.motions.constraints import Constraints
from cobot.trajectory import Trajectory
from cobot.types import CartesianLimits, JointLimits


@dataclass(frozen=True, slots=True)
class Leg:
    """A motion from rest to rest, and the limits that it has been planned with; None for no TCP's.

    Attributes:
        constraints: what it keeps from its start on.
    """

    motion: Trajectory
    limits: JointLimits
    tcp: CartesianLimits | None
    constraints: Constraints | None = None


@dataclass(frozen=True, slots=True)
class Corner:
    """A round corner: a curve between the last `before` of one path and the first `after` of the next."""

    curve: Trajectory
    before: float
    after: float
    used_m: float


@dataclass(frozen=True, slots=True)
class Stretch:
    """Motions as one trajectory, and what is needed to have others follow. Picklable.

    Attributes:
        trajectory: from where the first begins, at rest; or from a place on the trajectory that it replaces.
        ends_s: when each motion gives way to the next one; of those that are over only the last ones.
        used_m: of the motions that have come last, how much of the radius is used of the corner before each;
            0: the arm stops there, or begins.
        legs, radii_m, corners: since the last stop; each radius is of a motion's end, the last one's too.
        progress: the parameter of their path over the time since `since_s`, which is right from `valid_s` on;
            None if no other motion can follow the last one without a stop.
        offset_s: the path time of the replaced trajectory at which this one begins.
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


def alone(leg: Leg) -> Stretch:
    """A single motion, as it has been planned, after which the arm stops."""
    end_s = leg.motion.duration_s
    return Stretch(leg.motion, (end_s,), (0.0,), (leg,), (0.0,), (), None, 0.0, 0.0)
