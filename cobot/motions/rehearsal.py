"""Data about the dry run of a planned motion on a simulated copy of the robot, from planning processes."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.motions.forecast import Closest
from cobot.reasons import Reason
from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Flaw:
    """The first problem of a dry run.

    Attributes:
        time_s: time of the problem since the motion began, s.
        joint: the affected joint; None if it affects no single joint.
        says: description of the problem.
    """

    time_s: float
    joint: str | None
    says: Reason


@dataclass(frozen=True, slots=True)
class SimulatedRun:
    """How the real-time loop executed a motion in a dry run.

    Attributes:
        times_s: times of the rows since the motion began, shape (n,).
        positions: measured joint positions, shape (n, dof), rad.
        effort: maximum effort of each joint, as a share of its limit, shape (dof,).
        off_rad: maximum distance of each joint from its commanded position, shape (dof,), rad.
        duration_s: time until the motion settled, or ended for a different reason, s.
        flaw: the first problem; None if the motion reached its goal and settled without an intervention.
    """

    times_s: Array
    positions: Array
    effort: Array
    off_rad: Array
    duration_s: float
    flaw: Flaw | None


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A dry run together with its shortest distances.

    Attributes:
        closest_self, closest_environment: shortest distances at the measured positions; see
            `cobot.motions.forecast.Forecast`.
    """

    run: SimulatedRun
    flaw: Flaw | None
    closest_self: Closest | None
    closest_environment: Closest | None
