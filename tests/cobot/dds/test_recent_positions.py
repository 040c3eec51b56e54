"""The range of recent positions. Oracle: all of them, counted out."""

from __future__ import annotations

import math

import numpy as np

from cobot.dds.recent_positions import SPAN_S, STEP_S, RecentPositions


def test_the_range_is_that_of_the_last_seconds_to_one_step() -> None:
    recent = RecentPositions()
    times_s = np.arange(0.0, 10.0, 0.002)
    for time_s in times_s.tolist():
        recent.add([time_s, -time_s], time_s)
    (low, _), (high, _) = recent.range()
    assert (low, high) == (np.clip(low, 9.998 - SPAN_S, 9.998 - SPAN_S + 2 * STEP_S), 9.998)
    assert recent.newest == [9.998, -9.998]
    assert len(recent._kept) <= 2 * SPAN_S / STEP_S


def test_what_is_not_a_number_is_no_position() -> None:
    recent = RecentPositions()
    assert recent.range() == ([], [])
    recent.add([math.nan], 0.0)
    recent.add([1.0], 0.1)
    assert recent.range() == ([1.0], [1.0])
