"""The state of a robot at one time. Other modules use this class instead of reading the record.

States are polled often, and most clients need few fields. So the record is copied as a whole, and each field
is converted only when it is read.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from cobot.ipc.layout import MotionResult, record_of
from cobot.ipc.state_fields import STATE_SCALARS, STATE_STRUCT
from cobot.reasons import Reason
from cobot.types import Array, LoopMode

PLACES = {name: place for place, (name, _) in enumerate(STATE_SCALARS)}
PUBLISHED_NS, MEASURED_NS = PLACES["monotonic_ns"], PLACES["measured_monotonic_ns"]

Value = TypeVar("Value")


class _Scalar(Generic[Value]):
    """A property that reads the number with the same name from the record and converts it to a type."""

    def __init__(self, kind: Callable[[Any], Value]) -> None:
        self._kind = kind

    def __set_name__(self, owner: type, name: str) -> None:
        self._place = PLACES[name]

    def __get__(self, state: RobotState, owner: type) -> Value:
        return self._kind(state.scalars[self._place])


class _Vector:
    """A property that reads the array with the same name from the record."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, state: RobotState, owner: type) -> Array:
        array: Array = state.record[self._name]
        return array


class RobotState:
    """A copy of rtloop's state block. Its fields have the names, units and meanings that
    `cobot.ipc.state_fields` defines.

    Attributes:
        record: the record with all fields.
        published_s: time of publication, on the link's clock.
        age_s: time since the publication, s.
        measured_age_s: time since the robot was read, s.
        interventions, intervened_ns: number of interventions of each kind, and time of the last one, in the
            order of `Intervention`.
    """

    __slots__ = ("_now_ns", "record", "scalars")

    position, velocity, effort, commanded_position = _Vector(), _Vector(), _Vector(), _Vector()
    tcp, wrench, external_effort = _Vector(), _Vector(), _Vector()
    mode, settled, motion_result = _Scalar(LoopMode), _Scalar(bool), _Scalar(MotionResult)
    cycle, motion_id, session, stops_seen = _Scalar(int), _Scalar(int), _Scalar(int), _Scalar(int)
    path_time_s, path_duration_s, path_rate = _Scalar(float), _Scalar(float), _Scalar(float)
    time_factor = _Scalar(float)
    points_taken, points_dropped, points_buffered = _Scalar(int), _Scalar(int), _Scalar(int)
    underruns, overruns, torn_reads = _Scalar(int), _Scalar(int), _Scalar(int)

    def __init__(self, record: np.ndarray, now_ns: int) -> None:
        """Copy a record that was just read.

        Args:
            record: record of the type `cobot.ipc.state_fields.state_dtype`.
            now_ns: the current time of CLOCK_MONOTONIC, from which the ages are computed.
        """
        octets = record.tobytes()
        self.record = record_of(octets, record.dtype)
        self.scalars = STATE_STRUCT.unpack_from(octets)  # much faster than reading with numpy
        self._now_ns = now_ns

    @property
    def interventions(self) -> list[int]:
        counts: list[int] = self.record["interventions"].tolist()
        return counts

    @property
    def intervened_ns(self) -> list[int]:
        moments: list[int] = self.record["intervened_ns"].tolist()
        return moments

    @property
    def published_s(self) -> float:
        return float(self.scalars[PUBLISHED_NS] * 1e-9)

    @property
    def age_s(self) -> float:
        return float((self._now_ns - self.scalars[PUBLISHED_NS]) * 1e-9)

    @property
    def measured_age_s(self) -> float:
        return float((self._now_ns - self.scalars[MEASURED_NS]) * 1e-9)

    @property
    def reason(self) -> Reason:
        return Reason.of_record(self.record)
