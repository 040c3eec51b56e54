"""Reasons why the arm stopped, or moves more slowly than requested. A reason is a sentence, and a code with
values for programs, which may translate it.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Self

import numpy as np


class ReasonCode(StrEnum):
    """The codes of reasons. docs/conventions.md explains them, and the panel has a text for each."""

    OTHER = ""
    # Requests.
    ESTOP_REQUESTED = "estop_requested"
    FAST_STOP_REQUESTED = "fast_stop_requested"
    STOP_REQUESTED = "stop_requested"
    CLIENT_ENDED = "client_ended"
    CONDITION_MET = "condition_met"
    SHUTDOWN = "shutdown"
    T1 = "t1"
    # Silence, and lost connections.
    CLIENT_DIED = "client_died"
    CONNECTION_LOST = "connection_lost"
    JOG_SILENT = "jog_silent"
    NO_POINTS = "no_points"
    SERVICE_SILENT = "service_silent"
    # The arm and its surroundings.
    CONTACT = "contact"
    FENCE = "fence"
    JOINT_LIMIT = "joint_limit"
    NEAR_OBSTACLE = "near_obstacle"
    NOT_AT_REST = "not_at_rest"
    NOT_FOLLOWING = "not_following"
    NOT_SETTLED = "not_settled"
    OBSTACLE = "obstacle"
    SAFETY_LAYER = "safety_layer"
    SINGULARITY = "singularity"
    TORQUE_LIMIT = "torque_limit"
    TRACKING = "tracking"
    # The device.
    CONDITION_UNREADABLE = "condition_unreadable"
    DEVICE = "device"
    FROZEN = "frozen"
    HOLD_REFUSED = "hold_refused"
    JUMP = "jump"
    NO_PACKETS = "no_packets"
    OUTPUT_REJECTED = "output_rejected"
    PACKETS_TOO_FAST = "packets_too_fast"
    READING = "reading"
    WRITING = "writing"
    # The gripper, and the steps of programs.
    GRIPPER_BLOCKED = "gripper_blocked"
    GRIPPER_DEVICE = "gripper_device"
    GRIPPER_NOTHING = "gripper_nothing"
    GRIPPER_SIZE = "gripper_size"
    GRIPPER_SLOW = "gripper_slow"
    INPUT_NOT_MET = "input_not_met"
    # The computer and its programs.
    DAMAGED = "damaged"
    LATE = "late"
    NOT_FINITE = "not_finite"
    RESTARTED = "restarted"


class Reason(str):
    """A reason as text, with its code and values.

    Attributes:
        code: a `ReasonCode`, or the cause of a stop (`app.services.rights.stop_reason.StopCause`).
        of: names of the joint, links or other things concerned.
        value, limit: measured value and its limit in `unit`; NaN for a reason without a number.
    """

    __slots__ = ("code", "limit", "of", "unit", "value")

    code: str
    of: tuple[str, ...]
    value: float
    limit: float
    unit: str

    def __new__(
        cls,
        words: str,
        code: str = ReasonCode.OTHER,
        of: tuple[str, ...] = (),
        value: float = math.nan,
        limit: float = math.nan,
        unit: str = "",
    ) -> Self:
        made = super().__new__(cls, words)
        made.code, made.of, made.value, made.limit, made.unit = str(code), of, value, limit, unit
        return made

    @classmethod
    def of_text(cls, words: str) -> Reason:
        """Create a reason without a code from a text. A text that already is a reason is returned
        unchanged.
        """
        return words if isinstance(words, Reason) else cls(words)

    @classmethod
    def of_record(cls, state: np.ndarray) -> Reason:
        """The reason that a record of `cobot.ipc.state_fields.state_dtype` contains."""
        words, code, of, unit = (
            bytes(state[field].item()).decode("utf-8", "replace")
            for field in ("reason", "reason_code", "reason_of", "reason_unit")
        )
        value, limit = state["reason_values"].tolist()
        return cls(words, code, tuple(of.split(SEPARATOR)) if of else (), value, limit, unit)

    def and_then(self, words: str) -> Reason:
        """A copy of the reason with `words` appended to its sentence."""
        return Reason(f"{self}; {words}", self.code, self.of, self.value, self.limit, self.unit)

    def fields(self) -> dict[str, object]:
        """The reason's code and values for JSON. The keys are the names in the state block. Empty if the
        reason has no code.
        """
        if not self.code:
            return {}
        values = [None if math.isnan(each) else each for each in (self.value, self.limit)]
        return {
            "reason_code": self.code,
            "reason_of": SEPARATOR.join(self.of),
            "reason_values": values,
            "reason_unit": self.unit,
        }


SEPARATOR = ", "
"""Separator between the names in a text field of the state block."""
