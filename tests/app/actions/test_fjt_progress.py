"""How an arm stands to its trajectory. Oracle: a parabola that the test writes down itself."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.actions.fjt_progress import on_path
from cobot.trajectory import Trajectory

NAMES = ("a", "b")
OFF, LAG = np.array([0.01, -0.02]), np.array([0.1, 0.3])


def parabola() -> Trajectory:
    """q = 1 + 2 t + 3 t² and q = 4 − t over two seconds."""
    return Trajectory(np.array([0.0, 2.0]), np.array([[[1.0, 2.0, 3.0, 0, 0, 0], [4.0, -1.0, 0, 0, 0, 0]]]))


@pytest.mark.parametrize("rate", [0.0, 0.5, 1.0])
def test_desired_rates_are_those_of_the_clock_and_the_error_is_desired_minus_actual(rate: float) -> None:
    position = np.array([1 + 2 * 0.5 + 3 * 0.25, 3.5])
    velocity = np.array([2 + 6 * 0.5, -1.0]) * rate
    state: Any = SimpleNamespace(position=position - OFF, velocity=velocity - LAG)
    progress = on_path(parabola(), 0.5, rate, state, 3_000_000_007)
    told = progress.feedback(NAMES)
    assert told["joint_names"] == ["a", "b"]
    assert told["header"] == {"stamp": {"sec": 3, "nanosec": 7}}
    np.testing.assert_allclose(told["desired"]["positions"], position)
    np.testing.assert_allclose(told["desired"]["velocities"], velocity)
    np.testing.assert_allclose(told["desired"]["accelerations"], np.array([6.0, 0.0]) * rate**2)
    np.testing.assert_allclose(told["actual"]["positions"], position - OFF)
    np.testing.assert_allclose(told["error"]["positions"], OFF, atol=1e-12)
    np.testing.assert_allclose(told["error"]["velocities"], LAG, atol=1e-12)
    assert "accelerations" not in told["error"]
    for name in ("desired", "actual", "error"):
        assert told[name]["time_from_start"] == {"sec": 0, "nanosec": 500_000_000}
