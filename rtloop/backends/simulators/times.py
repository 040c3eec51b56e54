"""Percentiles of an unlimited number of durations, at constant cost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

MIN_TIME_S, MAX_TIME_S = 1e-6, 100.0
STEP = 0.02
"""Resolution of the logarithm of a duration. Percentiles are accurate to within 2 %."""
BUCKETS = math.ceil(math.log(MAX_TIME_S / MIN_TIME_S) / STEP) + 1


class DurationCounter:
    """Counts durations in logarithmic steps.

    Attributes:
        count: number of durations that were added.
    """

    def __init__(self) -> None:
        self.count = 0
        self._longest_s = 0.0
        self._counts = np.zeros(BUCKETS, np.int64)

    def add(self, duration_s: float) -> None:
        self.count += 1
        self._longest_s = max(self._longest_s, duration_s)
        within = min(max(duration_s, MIN_TIME_S), MAX_TIME_S)
        self._counts[round(math.log(within / MIN_TIME_S) / STEP)] += 1

    def shares(self) -> dict[str, float]:
        """Return p50, p99, p99.9 and max, s. Empty if no duration was added."""
        if not self.count:
            return {}
        below = np.cumsum(self._counts)
        found = {
            f"p{100.0 * share:g}": MIN_TIME_S
            * math.exp(STEP * int(np.searchsorted(below, share * self.count)))
            for share in (0.5, 0.99, 0.999)
        }
        return {**found, "max": self._longest_s}


class ServerTimes:
    """Timing statistics of a simulated controller.

    Attributes:
        answers: times from sending a packet to the arrival of its answer.
        lateness: delays at the start of the controller's periods.
    """

    def __init__(self) -> None:
        self.answers, self.lateness = DurationCounter(), DurationCounter()

    def shown(self) -> dict[str, Any]:
        """Return the number of answers, and the percentiles of answers and lateness, s."""
        found: dict[str, Any] = {"answers": self.answers.count}
        for name, times in (("answer_s", self.answers), ("lateness_s", self.lateness)):
            if times.count:
                found[name] = times.shares()
        return found
