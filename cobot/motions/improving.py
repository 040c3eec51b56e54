"""The state of a motion that is made faster while the planning time of its request lasts."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from cobot.motions.planners import Way
from cobot.motions.requests import MotionRequest
from cobot.trajectory import Trajectory
from cobot.types import Array


class PlanQuality(StrEnum):
    """How far a motion has been improved.

    FIRST: the first motion that has passed all checks.
    IMPROVED: a faster one than the first; further planning time may find a faster one still.
    FINAL: further planning time finds no motion that is noticeably faster.
    """

    FIRST = "first"
    IMPROVED = "improved"
    FINAL = "final"


@dataclass(frozen=True, slots=True)
class Improving:
    """The fastest motion so far, and where the search for a faster one continues. Picklable.

    Attributes:
        best: the fastest motion so far. It has passed all checks.
        first_duration_s: duration of the first motion, s.
        goals: joint positions at which the motion may end, shape (n, dof), rad.
        lower_bounds_s: for each goal, the time, s, that the slowest joint needs alone. No motion to this goal
            is faster.
        tries, improvements: number of tries so far, and number of tries that found a faster motion.
        spent_s: time spent on the tries, s.
        done: whether a further try would find no noticeably faster motion.
        points: number of control points of the curves that are tried.
        step_rad: size of the random changes.
        change: the change that made the last motion faster, shape (points, dof), rad; None to repeat no
            change.
    """

    best: Trajectory
    first_duration_s: float
    goals: Array
    lower_bounds_s: Array
    tries: int = 0
    improvements: int = 0
    spent_s: float = 0.0
    done: bool = False
    points: int = 16
    step_rad: float = 0.2
    change: Array | None = None

    @property
    def quality(self) -> PlanQuality:
        if self.done:
            return PlanQuality.FINAL
        return PlanQuality.IMPROVED if self.improvements else PlanQuality.FIRST

    @property
    def lower_bound_s(self) -> float:
        """Lower bound of the duration of a motion to any of the goals, s."""
        return float(self.lower_bounds_s.min())


@dataclass(frozen=True, slots=True)
class Planned:
    """The quality of a planned motion.

    Attributes:
        tries, improvements: see `Improving`.
        first_duration_s: duration of the first motion that passed all checks, s.
        lower_bound_s: see `Improving`; None if it was not computed.
    """

    quality: PlanQuality
    first_duration_s: float
    tries: int = 0
    improvements: int = 0
    lower_bound_s: float | None = None

    @classmethod
    def of(cls, request: MotionRequest, found: Trajectory | Improving | None) -> Planned:
        """The quality of the motion that was planned for a request; None if the arm is already at the
        goal.
        """
        if isinstance(found, Improving):
            return cls(
                found.quality, found.first_duration_s, found.tries, found.improvements, found.lower_bound_s
            )
        can_improve = found is not None and request.traits.way is Way.SEARCH
        quality = PlanQuality.FIRST if can_improve else PlanQuality.FINAL
        return cls(quality, 0.0 if found is None else found.duration_s)
