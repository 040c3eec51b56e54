"""The table of result codes. Vendor services answer with these codes, and rejections carry them on every
transport.

0 is success; all other codes are positive. Transports with words instead of numbers use the names in lower
case, which are the codes in `cobot.errors`.

`docs/services.md` shows the table. A test checks that this table agrees with the document, and that every
error has a code.
"""

from __future__ import annotations

from enum import IntEnum

from cobot import errors
from cobot.errors import CobotError


class Code(IntEnum):
    """The result of a call."""

    OK = 0
    ERROR = 1
    CONFIG = 2
    INPUT = 10
    LIMIT = 11
    NOT_FOUND = 12
    PLANNING = 20
    UNREACHABLE = 21
    COLLISION = 22
    PLANNING_TIMEOUT = 23
    EXECUTION = 30
    STOPPED = 31
    MOTION_TIMEOUT = 32
    CONDITION_NOT_MET = 33
    CONFLICT = 40
    CHANGED = 41
    UNAVAILABLE = 50
    NOT_READY = 51
    SHARED_MEMORY = 52
    LAYOUT = 53
    TORN_READ = 54
    BUSY = 55
    NOT_SUPPORTED = 60
    DEVICE = 61
    DEVICE_TIMEOUT = 62
    PAYLOAD = 70
    MEDIA_TYPE = 71
    HEADER = 72
    UNAUTHENTICATED = 80
    FORBIDDEN = 81
    MISDIRECTED = 82


MEANINGS: dict[Code, str] = {
    Code.OK: "done, or for a motion: accepted and planned",
    Code.ERROR: "an error in cobot itself; its log has the details",
    Code.CONFIG: "a configuration or program file is missing, unreadable or contradictory",
    Code.INPUT: "an argument is invalid; nothing has happened",
    Code.LIMIT: "an argument is beyond a limit",
    Code.NOT_FOUND: "a named object does not exist: a signal, a frame, a handle, a file",
    Code.PLANNING: "no motion could be planned; nothing has moved",
    Code.UNREACHABLE: "no joint positions reach the goal pose",
    Code.COLLISION: "the motion would touch the robot itself or its surroundings",
    Code.PLANNING_TIMEOUT: "the planner did not finish in time",
    Code.EXECUTION: "the execution failed after its start",
    Code.STOPPED: "a client, a person or a safety function stopped the motion",
    Code.MOTION_TIMEOUT: "the motion did not reach its goal in time",
    Code.CONDITION_NOT_MET: "the motion ended without its end condition",
    Code.CONFLICT: "another client has control, or the current state does not permit this call",
    Code.CHANGED: "another client has changed the object in the meantime; the message names the client",
    Code.UNAVAILABLE: "a process, a file in shared memory or a device does not answer",
    Code.NOT_READY: "the robot is in a mode that does not permit motions",
    Code.SHARED_MEMORY: "shared memory contains unexpected data",
    Code.LAYOUT: "shared memory belongs to another version or another robot",
    Code.TORN_READ: "no consistent copy of the state could be read",
    Code.BUSY: "too many connections are open; try again",
    Code.NOT_SUPPORTED: "cobot or the robot cannot do this; the message says why",
    Code.DEVICE: "a device, a port or a peer rejected the request or disconnected",
    Code.DEVICE_TIMEOUT: "a device, a port or a peer did not answer in time",
    Code.PAYLOAD: "the request is too large",
    Code.MEDIA_TYPE: "the request has the wrong content type",
    Code.HEADER: "a header of the request is missing",
    Code.UNAUTHENTICATED: "the call needs a valid access token",
    Code.FORBIDDEN: "the client's role does not permit the call, or a web page of another origin sent it",
    Code.MISDIRECTED: "the service was called by the name of another host",
}

OF_ERROR: dict[type[CobotError], Code] = {
    CobotError: Code.ERROR,
    errors.ConfigError: Code.CONFIG,
    errors.InputError: Code.INPUT,
    errors.LimitError: Code.LIMIT,
    errors.NotFoundError: Code.NOT_FOUND,
    errors.PlanningError: Code.PLANNING,
    errors.UnreachableError: Code.UNREACHABLE,
    errors.CollisionError: Code.COLLISION,
    errors.PlanningTimeout: Code.PLANNING_TIMEOUT,
    errors.ExecutionError: Code.EXECUTION,
    errors.MotionStopped: Code.STOPPED,
    errors.MotionTimeout: Code.MOTION_TIMEOUT,
    errors.ConditionNotMet: Code.CONDITION_NOT_MET,
    errors.ConflictError: Code.CONFLICT,
    errors.ChangedError: Code.CHANGED,
    errors.PayloadError: Code.PAYLOAD,
    errors.MediaTypeError: Code.MEDIA_TYPE,
    errors.HeaderError: Code.HEADER,
    errors.AuthenticationError: Code.UNAUTHENTICATED,
    errors.PermissionDenied: Code.FORBIDDEN,
    errors.MisdirectedError: Code.MISDIRECTED,
    errors.UnavailableError: Code.UNAVAILABLE,
    errors.NotReadyError: Code.NOT_READY,
    errors.SharedMemoryError: Code.SHARED_MEMORY,
    errors.LayoutError: Code.LAYOUT,
    errors.TornReadError: Code.TORN_READ,
    errors.BusyError: Code.BUSY,
    errors.NotSupportedError: Code.NOT_SUPPORTED,
    errors.DeviceError: Code.DEVICE,
    errors.DeviceTimeout: Code.DEVICE_TIMEOUT,
}


ERROR_OF: dict[int, type[CobotError]] = {int(code): kind for kind, code in OF_ERROR.items()}
"""The error class of each code."""


def code_of(error: CobotError) -> Code:
    """The code of an error, from the most specific of its classes that has one."""
    return next(OF_ERROR[kind] for kind in type(error).__mro__ if kind in OF_ERROR)
