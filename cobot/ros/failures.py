"""Responses and results that report a failure in fields of their ROS type, because ROS defines no general
field for failures.
"""

from __future__ import annotations

from enum import IntEnum

from cobot import errors
from cobot.errors import CobotError
from cobot.ros.messages import Message


class FjtError(IntEnum):
    """Values of `error_code` as in control_msgs/action/FollowJointTrajectory. The last one is defined by
    cobot.
    """

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5
    INTERRUPTED = -100  # cancelled, preempted, stopped, e-stop or fault, for which there is no other value


OF_ERROR: dict[type[CobotError], FjtError] = {
    CobotError: FjtError.INTERRUPTED,
    errors.ConfigError: FjtError.INTERRUPTED,
    errors.InputError: FjtError.INVALID_GOAL,
    errors.PlanningError: FjtError.INVALID_GOAL,
    errors.ExecutionError: FjtError.INTERRUPTED,
    errors.ConflictError: FjtError.INTERRUPTED,
    errors.NotSupportedError: FjtError.INVALID_GOAL,
    errors.DeviceError: FjtError.INTERRUPTED,
    errors.PayloadError: FjtError.INVALID_GOAL,
    errors.MediaTypeError: FjtError.INVALID_GOAL,
    errors.AuthenticationError: FjtError.INTERRUPTED,
    errors.PermissionDenied: FjtError.INTERRUPTED,
    errors.UnavailableError: FjtError.INTERRUPTED,
    errors.SharedMemoryError: FjtError.INTERRUPTED,
}
"""The `error_code` for each class of error. It is used for errors of derived classes that are not in this
table.
"""


def error_code_of(error: CobotError) -> FjtError:
    """The `error_code` of an error, from the most specific of its classes that is in the table."""
    own: FjtError | None = getattr(error, "error_code", None)
    return own or next(OF_ERROR[kind] for kind in type(error).__mro__ if kind in OF_ERROR)


def failed_result(result: Message, error: CobotError) -> Message:
    """The result of a goal that was accepted and then failed.

    Args:
        result: the defaults of the type, which would mean success. They are changed in place.
        error: the error. For types that have an `error_code`, its class determines the code; for types with a
            different code, the code is 1.
    """
    if "error_code" in result:
        result["error_code"] = int(error_code_of(error))
    elif "code" in result:
        result["code"] = 1
    for name in ("error_string", "message"):
        if name in result:
            result[name] = str(error)
    return result
