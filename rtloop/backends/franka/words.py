"""Texts for the robot's reflexes and modes, with advice."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Any

from cobot.foreign import MAX_NAME, joined_text, plain_text

MAX_ERRORS = 64
"""Maximum number of errors that are reported for one state; libfranka defines 41."""
MOVE_BACK = "move the arm back by hand, or in Desk"
REFLEXES = {
    "base_acceleration_initialization_timeout": "the acceleration sensor of its base did not start",
    "base_acceleration_invalid_reading": "the acceleration sensor of its base has invalid values",
    "cartesian_position_limits_violation": f"the arm has left its permitted space: {MOVE_BACK}",
    "cartesian_reflex": "something pushed the tool harder than the collision thresholds allow",
    "cartesian_velocity_profile_safety_violation": "a safety limit of the TCP's velocity was exceeded",
    "cartesian_velocity_violation": "the TCP was too fast",
    "communication_constraints_violation": "too many commands came too late, or not at all",
    "controller_torque_discontinuity": "the commanded torque jumped",
    "force_control_safety_violation": "a safety limit of force control was exceeded",
    "instability_detected": "the arm began to oscillate",
    "joint_motion_generator_acceleration_discontinuity": "the commanded acceleration jumped",
    "joint_motion_generator_position_limits_violation": "a commanded position is beyond a joint's limit",
    "joint_motion_generator_velocity_discontinuity": "the commanded velocity jumped",
    "joint_motion_generator_velocity_limits_violation": "a commanded velocity is beyond a joint's limit",
    "joint_move_in_wrong_direction": "a joint beyond its limit was moved further beyond it",
    "joint_position_limits_violation": f"a joint is beyond its limit: {MOVE_BACK}",
    "joint_position_motion_generator_start_pose_invalid": (
        "the motion did not begin at the position of the arm"
    ),
    "joint_reflex": "something pushed a joint harder than the collision thresholds allow",
    "joint_velocity_violation": "a joint was too fast",
    "max_goal_pose_deviation_violation": "the arm was pushed too far from its goal",
    "max_path_pose_deviation_violation": "the arm was pushed too far from its path",
    "power_limit_violation": "the arm took more power than it may",
    "self_collision_avoidance_violation": "two parts of the arm came too close to each other",
    "tau_j_range_violation": "a torque sensor is beyond its range",
}
"""Texts for the names of libfranka's errors. The names of other errors need no explanation."""
MODES = {
    "Idle": "ready",
    "Move": "moving",
    "Guiding": "guided by hand",
    "Reflex": "stopped by a reflex",
    "UserStopped": "stopped by its user stop",
    "AutomaticErrorRecovery": "recovering",
    "Other": "not ready",
}
REFUSALS = {
    "Guiding": "the arm is guided by hand: release its buttons, then reset",
    "UserStopped": "the user stop is pressed, or the enabling device let go: release it, then reset",
    "Other": "the robot is not ready: open its brakes and activate FCI in Desk, then reset",
}
"""Texts for the robot modes in which cobot cannot enable the arm."""


def in_words(names: Iterable[str]) -> str:
    """Return the errors as one sentence; "" if there are none."""
    known = islice(names, MAX_ERRORS)
    return "; ".join(REFLEXES.get(name) or plain_text(name, MAX_NAME).replace("_", " ") for name in known)


def explained(text: str) -> str:
    """Return a message from libfranka in which the names of errors in brackets are replaced by sentences."""
    inside = text[text.find("[") + 1 : text.rfind("]")] if "[" in text and "]" in text else ""
    names = [name.strip(' "') for name in inside.split(",")]
    known = [name for name in names if name in REFLEXES]
    return f"{in_words(known)} ({text})" if known else text


def active_errors(state: Any) -> list[str]:
    """Return the names of the errors in a libfranka state."""
    errors = state.current_errors if state is not None else None
    found = (name for name in dir(errors) if not name.startswith("_") and getattr(errors, name) is True)
    return list(islice(found, MAX_ERRORS))


def said(exc: Exception) -> str:
    """Return a message from libfranka as one line."""
    return joined_text(exc).removeprefix("libfranka: ")
