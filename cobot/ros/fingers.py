"""The fingers of a gripper as ROS joints: two linear joints, each of which moves by half of the width."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cobot.ros.messages import Message

FINGER_JOINTS = ("gripper_finger_1", "gripper_finger_2")
"""Joint names, in the order of their values."""
FRESH_S = 1.0
"""Maximum age of finger values in joint states, s."""


def gripper_states(robot: str) -> str:
    """The topic on which the service publishes the state of a robot's fingers."""
    return f"/{robot}/gripper/joint_states"


@dataclass(frozen=True, slots=True)
class FingerState:
    """The state of a gripper's two fingers.

    Attributes:
        width: width between the fingers, m.
        speed: speed at which the width changes, m/s.
        force: force at the fingers, N; NaN if unknown.
    """

    width: float
    speed: float = 0.0
    force: float = math.nan

    @property
    def rows(self) -> dict[str, list[float]]:
        """Position (m), velocity (m/s) and effort (N) of each joint."""
        joints = len(FINGER_JOINTS)
        return {
            "position": [0.5 * self.width] * joints,
            "velocity": [0.5 * self.speed] * joints,
            "effort": [self.force] * joints,
        }

    @property
    def message(self) -> Message:
        """The joints as sensor_msgs/msg/JointState, without a header."""
        return {"name": list(FINGER_JOINTS), **self.rows}

    @classmethod
    def of(cls, message: Message) -> FingerState | None:
        """Read the fingers from a message that `message` has created. None if the message contains other
        joints, or no joints.
        """
        values = [message[name] for name in ("position", "velocity", "effort")]
        if tuple(message["name"]) != FINGER_JOINTS or any(not _is_whole(each) for each in values):
            return None
        (position, velocity, effort) = (_number(each[0]) for each in values)
        return cls(2.0 * position, 2.0 * velocity, effort)


def _is_whole(values: Sequence[float | None]) -> bool:
    return len(values) == len(FINGER_JOINTS)


def _number(value: float | None) -> float:
    return math.nan if value is None else value  # JSON has no NaN
