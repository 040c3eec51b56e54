"""Punctuality is for the benchmarks; here only what is counted when time is lost.

Oracle: the kernel's own CLOCK_MONOTONIC.
"""

from __future__ import annotations

import signal
import time

import numpy as np
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Phase
from cobot.robot.description import RobotDescription
from rtloop.clock import FastClock, RealtimeClock
from rtloop.publisher import STATISTICS_CYCLES


def test_missed_periods_are_counted_and_not_caught_up() -> None:
    clock = RealtimeClock(1e-3)
    clock.wait(moving=True)
    time.sleep(0.02)
    late_ns = clock.wait(moving=True)
    assert late_ns >= 18e6
    assert clock.overruns >= 18
    deadline_ns = clock._deadline_ns
    assert deadline_ns > time.monotonic_ns() - 50e6, "the next deadline is near now, not in the past"


def test_a_cycle_never_begins_before_its_deadline() -> None:
    clock = RealtimeClock(1e-3)
    assert min(clock.wait(moving=True) for _ in range(50)) >= 0


def test_a_signal_does_not_end_the_wait() -> None:
    signals: list[int] = []
    before = signal.signal(signal.SIGALRM, lambda number, _: signals.append(number))
    try:
        clock = RealtimeClock(50e-3)
        signal.setitimer(signal.ITIMER_REAL, 5e-3, 5e-3)
        begun_s = time.monotonic()
        assert clock.wait(moving=True) >= 0
        assert time.monotonic() - begun_s >= 50e-3
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert signals, "it was heeded all the same"


def test_the_fast_clock_does_not_wait_while_the_arm_moves() -> None:
    clock, period_s = FastClock(20e-3), 20e-3

    def waited_s(*, moving: bool) -> float:
        begun_s = time.monotonic()
        assert clock.wait(moving=moving) == 0
        return time.monotonic() - begun_s

    moving_s = [waited_s(moving=True) for _ in range(1000)]
    assert sum(moving_s) < 1000 * period_s / 2
    begun_s = time.monotonic()
    assert waited_s(moving=False) >= 0.99 * period_s, "in step with the real clock when it does not move"
    waited_s(moving=False)
    assert time.monotonic() - begun_s >= 1.99 * period_s
    assert min(waited_s(moving=True) for _ in range(10)) < period_s / 2
    time.sleep(3 * period_s)
    assert waited_s(moving=False) >= 0.99 * period_s, "nothing is caught up of the time in which it moved"
    assert clock.overruns == 0


def test_every_cycle_is_in_the_histograms(settings: Settings, robot: RobotDescription) -> None:
    rig = Rig(settings, robot)
    try:
        rig.step(STATISTICS_CYCLES - 1)
        rig.loop.step(late_ns=5_000_000)
        statistics = rig.memory.statistics.read()
        assert int(statistics["cycles"]) == STATISTICS_CYCLES
        histogram = statistics["histogram"]
        assert int(histogram[Phase.UPDATE].sum()) == STATISTICS_CYCLES
        assert int(histogram[Phase.WAKEUP][HISTOGRAM_BUCKETS - 1]) == 1
        assert float(statistics["max_us"][Phase.WAKEUP]) == 5000.0
        assert np.all(statistics["max_us"][Phase.UPDATE] > 0.0)
    finally:
        rig.close()
