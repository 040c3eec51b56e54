"""Why there is no motion, as numbers, and what would make one: the facts of an error beside its sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Check = Literal[
    "limit", "collision", "reach", "effort", "redundancy", "singularity", "constraint", "path", "time"
]
Kind = Literal["slower", "faster", "planner", "branch", "start", "goal", "free_axes", "end"]


@dataclass(frozen=True, slots=True)
class Finding:
    """What one check has found.

    Attributes:
        check: which one.
        quantity: what it looks at, as "position", "distance", "effort".
        value, limit: of the quantity, in `unit`, which is SI; "" for a share.
        share: where, as a share of the path (of its time, if it has been timed): 0 is the start, 1 the
            goal; None if it is nowhere in particular.
        of: the joint, or the two that come too near to each other.
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
        """By how much the value is beyond the limit, in `unit`."""
        return abs(self.value - self.limit)


@dataclass(frozen=True, slots=True)
class Remedy:
    """A change of a request with which it has been planned.

    Attributes:
        change: of the fields of `cobot.motions.requests.MotionRequest`.
        says: the same for people.
        duration_s: of the motion then.
    """

    kind: Kind
    change: dict[str, Any]
    says: str
    duration_s: float


@dataclass(frozen=True, slots=True)
class Failure:
    """Changes of one kind with which there is no motion either.

    Attributes:
        count: how many were tried.
        says, why: of the first of them: the change, and what became of it.
    """

    kind: Kind
    count: int
    says: str
    why: str


@dataclass(frozen=True, slots=True)
class Explanation:
    """What was tried when a motion could not be planned.

    Attributes:
        works: at the most one of each kind.
        tried: what did not work, one of each kind.
        spent_s, budget_s: the time that trying took, and could take; nothing is begun after it.
        start: the joints from where it was to go, rad.
        motion: of a sequence, which one, from 1 on; None if there is but one.
    """

    works: tuple[Remedy, ...]
    tried: tuple[Failure, ...]
    spent_s: float
    budget_s: float
    start: tuple[float, ...]
    motion: int | None = None
