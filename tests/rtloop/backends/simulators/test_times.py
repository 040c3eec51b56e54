"""Percentiles from a histogram. Oracle: numpy's, of the durations themselves."""

from __future__ import annotations

import numpy as np
import pytest

from rtloop.backends.simulators.times import MAX_TIME_S, DurationCounter


def test_percentiles_are_as_exact_as_they_say() -> None:
    durations = np.random.default_rng(5).lognormal(-7.0, 1.5, 20_000)
    times = DurationCounter()
    for duration in durations:
        times.add(float(duration))
    shares = times.shares()
    assert times.count == len(durations)
    assert shares["max"] == durations.max()
    for name, share in (("p50", 50.0), ("p99", 99.0), ("p99.9", 99.9)):
        assert shares[name] == pytest.approx(np.percentile(durations, share), rel=0.03)


def test_what_is_out_of_range_counts_at_its_end() -> None:
    times = DurationCounter()
    assert times.shares() == {}
    for duration in (-1.0, 0.0, 1e6):
        times.add(duration)
    assert times.count == 3
    assert times.shares()["p99.9"] == pytest.approx(MAX_TIME_S, rel=0.03)
