"""Reasons: sentences with a code and values, also through the state block and between processes.

Oracles: the fields that were given; json; pickle; the sources of the real-time loop.
"""

from __future__ import annotations

import json
import pickle
import re
from pathlib import Path

import numpy as np

from cobot.ipc.shm import encoded
from cobot.ipc.state_fields import state_dtype
from cobot.reasons import Reason, ReasonCode

REPOSITORY = Path(__file__).parents[2]
TRACKING = Reason("joint4 is away", ReasonCode.TRACKING, ("joint4",), 0.3, 0.1, "rad")
LATCHING = r'(?s)self\.(?:controller\.)?(?:stop|fault|estop|fast_stop)\(\s*f?["\']'
"""A stop with a bare sentence."""


def record_of(reason: Reason) -> np.ndarray:
    state = np.zeros((), state_dtype(7))
    state["reason"], state["reason_values"] = encoded(reason), (reason.value, reason.limit)
    for name, value in reason.fields().items():
        if isinstance(value, str):
            state[name] = value.encode()
    return state


def test_a_reason_is_its_sentence_and_has_a_code_and_values() -> None:
    assert TRACKING == "joint4 is away"
    assert json.loads(json.dumps({"reason": TRACKING, **TRACKING.fields()})) == {
        "reason": "joint4 is away",
        "reason_code": "tracking",
        "reason_of": "joint4",
        "reason_values": [0.3, 0.1],
        "reason_unit": "rad",
    }
    assert Reason("later").fields() == {}


def test_it_passes_through_the_state_block_and_to_another_process() -> None:
    for copy in (Reason.of_record(record_of(TRACKING)), pickle.loads(pickle.dumps(TRACKING))):
        assert copy == TRACKING
        assert copy.fields() == TRACKING.fields()
    late = Reason("late", ReasonCode.LATE, value=0.2, unit="s").and_then("again")
    assert late == "late; again"
    assert Reason.of_record(record_of(late)).fields()["reason_values"] == [0.2, None]


def test_each_stop_of_the_real_time_loop_has_a_code() -> None:
    files = sorted((REPOSITORY / "rtloop").rglob("*.pyx"))
    assert len(files) > 20
    for file in files:
        assert not re.findall(LATCHING, file.read_text(encoding="utf-8")), file.name
