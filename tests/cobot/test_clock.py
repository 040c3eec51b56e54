"""Times of day calculated from CLOCK_MONOTONIC, on a clock whose readings the test interrupts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cobot.clock import SystemClock, WallTime

AHEAD_NS = 1_700_000_000_000_000_000


class InterruptedClock(SystemClock):
    """Both clocks advance by what `pause_ns` returns after each reading."""

    def __init__(self, pause_ns: Callable[[], int]) -> None:
        self.time_ns, self.ahead_ns = 1_000_000_000, AHEAD_NS
        self._pause_ns = pause_ns

    def now_ns(self) -> int:
        read = self.time_ns
        self.time_ns += self._pause_ns()
        return read

    def wall_ns(self) -> int:
        return self.now_ns() + self.ahead_ns


@pytest.mark.parametrize("seed", range(5))
def test_interrupted_readings_do_not_move_stamps(seed: int) -> None:
    random = np.random.default_rng(seed)
    clock = InterruptedClock(lambda: int(random.choice([50, 100, 20_000_000], p=[0.5, 0.3, 0.2])))
    wall = WallTime(clock)
    measured = [1_000_000 * number for number in range(1_000)]
    errors_ns = [wall.at(each) - each - AHEAD_NS for each in measured]
    assert max(errors_ns) - min(errors_ns) < 1_000
    assert max(map(abs, errors_ns)) < 1_000


@pytest.mark.parametrize("step_ns", [3_600_000_000_000, 5_000_000, -5_000_000, -3_600_000_000_000])
def test_a_time_of_day_that_is_set_is_followed(step_ns: int) -> None:
    clock = InterruptedClock(lambda: 100)
    wall = WallTime(clock)
    clock.ahead_ns += step_ns
    assert wall.at(0) == pytest.approx(AHEAD_NS + step_ns, abs=100)


def test_the_computers_own_clocks_agree() -> None:
    clock = SystemClock()
    wall = WallTime(clock)
    before_ns = clock.wall_ns()
    now_ns = clock.now_ns()
    after_ns = clock.wall_ns()
    slack_ns = 100_000  # the clocks' own resolution
    assert before_ns - slack_ns <= wall.at(now_ns) <= after_ns + slack_ns
