"""The wrench of servo sessions. Oracle: what the session in the test was told, call by call."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.services.streaming.force import ForceSettings
from app.services.streaming.servo_wrench import ServoWrench
from cobot.errors import MotionStopped
from cobot.ipc.layout import Stream

PUSH = (1.0, -2.0, 3.0, 0.1, 0.2, 0.3)


class Told:
    """In the session's place."""

    def __init__(self, stream: Stream, error: Exception | None = None) -> None:
        self.stream = stream
        self.setpoints: list[tuple[int, list[float]]] = []
        self._error = error

    def take_setpoint(self, sequence: int, setpoint: np.ndarray) -> None:
        if self._error is not None:
            raise self._error
        self.setpoints.append((sequence, setpoint["wrench"].tolist()))


def test_a_session_is_told_when_it_begins_and_when_the_settings_change() -> None:
    force: Any = SimpleNamespace(settings=ForceSettings(enabled=True, wrench=PUSH))
    wrench, session = ServoWrench(force, 7), Told(Stream.CARTESIAN)
    told: Any = session
    wrench.begin(told)
    wrench.update(told)
    assert session.setpoints == [(1, list(PUSH))]
    force.settings = replace(force.settings, wrench=(0.0,) * 6)
    wrench.update(told)
    force.settings = ForceSettings(enabled=False, wrench=PUSH)
    wrench.update(told)
    assert session.setpoints[1:] == [(2, [0.0] * 6), (3, [0.0] * 6)]  # switched off, it exerts nothing


@pytest.mark.parametrize(
    "session", [Told(Stream.JOINT_IMPEDANCE), Told(Stream.CARTESIAN, MotionStopped("the session is over"))]
)
def test_one_that_takes_no_wrench_or_has_just_ended_is_left_alone(session: Any) -> None:
    force: Any = SimpleNamespace(settings=ForceSettings(enabled=True, wrench=PUSH))
    wrench = ServoWrench(force, 7)
    wrench.begin(session)
    wrench.update(session)
    assert session.setpoints == []
