"""What a planned motion was like on a simulated copy of the robot: data from planning processes."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.motions.forecast import Closest
from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Flaw:
    """What has gone wrong first.

    Attributes:
        time_s: since the motion's start.
        joint: the one that it is about; None for what is about none.
        says: what it was, in words.
    """

    time_s: float
    joint: str | None
    says: str


@dataclass(frozen=True, slots=True)
class SimulatedRun:
    """What the cycle did with a motion.

    Attributes:
        times_s: of the rows, since the motion's start, shape (n,).
        positions: measured, shape (n, dof), rad.
        effort: the greatest of each joint, as a share of its limit, shape (dof,).
        off_rad: the greatest distance from where it was commanded to be, of each joint, shape (dof,).
        duration_s: until it had settled, or ended otherwise.
        flaw: None if it has arrived and settled and nothing had to intervene.
    """

    times_s: Array
    positions: Array
    effort: Array
    off_rad: Array
    duration_s: float
    flaw: Flaw | None


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """The same, with what it came near to.

    Attributes:
        closest_self, closest_environment: see `cobot.motions.forecast.Forecast`, of the measured positions.
    """

    run: SimulatedRun
    flaw: Flaw | None
    closest_self: Closest | None
    closest_environment: Closest | None
