"""The searches of a peer over several problems, and the number of solved problems."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum, auto

from benchmarks.planning.motion_bench_maker import Problem


class Unsolved(Enum):
    """The reason why a peer has no path."""

    ENDS = auto()
    """The start or the goal touches something, by the peer's own shapes."""
    SEARCH = auto()


class MissingPeer(Exception):
    """Raised if the peer cannot run on this computer. The message gives the reason."""


Search = Callable[[Problem], tuple[float, ...] | Unsolved]
"""Times of the processor until a path, and until each later stage such as its simplification, ms."""


@dataclass(frozen=True, slots=True)
class Searches:
    """The times of each solved problem, and the number of problems whose ends the peer accepts."""

    times_ms: list[tuple[float, ...]]
    accepted: int

    @property
    def solved(self) -> str:
        return f"{len(self.times_ms)} solved of the {self.accepted} whose ends it accepts"


def run(search: Search, problems: Iterable[Problem]) -> Searches:
    found = [search(problem) for problem in problems]
    return Searches(
        [times for times in found if not isinstance(times, Unsolved)],
        sum(times is not Unsolved.ENDS for times in found),
    )
