"""What the service knows of a robot. Oracle: numpy's own view of the record, filled at random."""

from __future__ import annotations

import numpy as np

from app.services.state.robot_state import RobotState
from cobot.ipc.layout import MotionResult
from cobot.ipc.state_fields import state_dtype
from cobot.types import LoopMode

SEED = 20261122
DOF = 7
ARRAYS = ("position", "velocity", "effort", "commanded_position", "tcp", "wrench")
SCALARS = (
    *("motion_id", "path_time_s", "path_duration_s", "path_rate", "stops_seen", "session"),
    *("points_taken", "points_dropped", "points_buffered", "underruns", "overruns", "torn_reads"),
)


def test_every_field_is_the_records_and_a_copy() -> None:
    random = np.random.default_rng(SEED)
    record = np.zeros((), state_dtype(DOF))
    for name in SCALARS:
        record[name] = random.integers(1, 1000)
    for name in ARRAYS:
        record[name] = random.uniform(-1.0, 1.0, record[name].shape)
    record["interventions"] = random.integers(0, 9, record["interventions"].shape)
    record["mode"], record["motion_result"], record["reason"] = 2, 1, "because é".encode()
    record["monotonic_ns"], record["measured_monotonic_ns"] = 5_000_000_000, 4_000_000_000
    state = RobotState(record, 7_500_000_000)
    for name in SCALARS:
        assert getattr(state, name) == record[name], name
    expected = record.copy()
    record[...] = np.zeros((), record.dtype)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(state, name), expected[name])
    assert state.interventions == expected["interventions"].tolist()
    assert (state.mode, state.motion_result) == (LoopMode(2), MotionResult(1))
    assert (state.published_s, state.age_s, state.measured_age_s) == (5.0, 2.5, 3.5)
    assert state.reason == "because é"
