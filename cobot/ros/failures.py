"""Responses and results that report a failure, in the fields that their ROS type has; ROS itself has none."""

from __future__ import annotations

from enum import IntEnum

from cobot.ros.messages import Message


class FjtError(IntEnum):
    """Values of `error_code` as in control_msgs/action/FollowJointTrajectory; the last one is cobot's own."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5
    INTERRUPTED = -100  # cancelled, preempted, stopped, e-stop, fault: none of the others means that


def failed_result(result: Message, error: FjtError, sentence: str) -> Message:
    """The result of a goal that was accepted and came to nothing.

    Args:
        result: the defaults of the type, which would mean success; changed in place.
        error: for types with an `error_code`; types with another code get 1.
    """
    if "error_code" in result:
        result["error_code"] = int(error)
    elif "code" in result:
        result["code"] = 1
    for name in ("error_string", "message"):
        if name in result:
            result[name] = sentence
    return result
