"""The range of each joint's recent positions.

Two publishers report the same joints at different times, and a busy computer may delay one of them for
seconds. So only the ranges of the positions they have reported recently can be compared, not their newest
positions.
"""

from __future__ import annotations

import math
from collections import deque

SPAN_S, STEP_S = 2.0, 0.02
"""Time for which positions are kept, and the minimum time between two that are kept, s."""


class RecentPositions:
    """The positions that one publisher has reported.

    Attributes:
        newest: the newest positions, in the arm's order, rad.
        heard_s: time at which they arrived, on any clock.
    """

    def __init__(self) -> None:
        self.newest: list[float] = []
        self.heard_s = float("-inf")
        self._kept: deque[tuple[float, list[float]]] = deque()

    def add(self, positions: list[float], now_s: float) -> None:
        """Add positions that have arrived now. Those that are not numbers are ignored."""
        if not all(map(math.isfinite, positions)):
            return
        self.newest, self.heard_s = positions, now_s
        if len(self._kept) > 1 and now_s - self._kept[-2][0] < STEP_S:
            self._kept.pop()
        self._kept.append((now_s, positions))
        while now_s - self._kept[0][0] > SPAN_S:
            self._kept.popleft()

    def range(self) -> tuple[list[float], list[float]]:
        """The smallest and the largest position of each joint; empty lists before the first positions."""
        columns = list(zip(*(positions for _, positions in self._kept), strict=True))
        return [min(each) for each in columns], [max(each) for each in columns]
