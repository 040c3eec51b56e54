"""The facts behind a planning error: the reasons why planning failed, as numbers, and changed requests that
would work.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Check = Literal[
    "limit", "collision", "reach", "effort", "redundancy", "singularity", "constraint", "path", "time"
]
Kind = Literal["slower", "faster", "planner", "branch", "start", "goal", "free_axes", "end"]


@dataclass(frozen=True, slots=True)
class Finding:
    """The finding of one check.

    Attributes:
        check: the check that failed.
        quantity: the checked quantity, for example "position", "distance" or "effort".
        value, limit: value and limit of the quantity, in `unit`, which is SI; "" for a share.
        share: location on the path, from 0 at the start to 1 at the goal. It is a share of the duration if
            the path has a time parameterization. None if the finding has no location.
        of: joint name, or names of the two bodies that come too close to each other.
    """

    check: Check
    quantity: str
    value: float
    limit: float
    unit: str
    share: float | None = None
    of: tuple[str, ...] = ()

    @property
    def excess(self) -> float:
        """Amount by which the value exceeds the limit, in `unit`."""
        return abs(self.value - self.limit)


@dataclass(frozen=True, slots=True)
class Remedy:
    """A change to a request that made planning succeed.

    Attributes:
        change: changed fields of `cobot.motions.requests.MotionRequest`.
        says: the change as a human-readable sentence.
        duration_s: duration of the changed motion.
    """

    kind: Kind
    change: dict[str, Any]
    says: str
    duration_s: float


@dataclass(frozen=True, slots=True)
class Failure:
    """Changes of one kind with which planning also failed.

    Attributes:
        count: number of changes that were tried.
        says, why: the first of these changes and its result, as human-readable sentences.
    """

    kind: Kind
    count: int
    says: str
    why: str


@dataclass(frozen=True, slots=True)
class Explanation:
    """The changes that were tried because planning of a motion had failed.

    Attributes:
        works: changes that work, at most one of each kind.
        tried: changes that do not work, one entry for each kind.
        spent_s, budget_s: time that the trials took, and time that is allowed for them, s. No trial starts
            after the allowed time.
        start: joint positions at the start, rad.
        motion: number of the motion in a sequence, from 1; None for a single motion.
    """

    works: tuple[Remedy, ...]
    tried: tuple[Failure, ...]
    spent_s: float
    budget_s: float
    start: tuple[float, ...]
    motion: int | None = None
