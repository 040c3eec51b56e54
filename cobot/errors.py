"""All errors, as one tree.

CobotError
├── ConfigError          a configuration file is missing, unreadable or contradictory
├── InputError           a request is invalid or impossible; nothing has moved
│   ├── LimitError       a value exceeds a limit in joint_limits.yaml
│   ├── NotFoundError    a named thing does not exist
│   └── HeaderError      a header of the request is missing
├── PlanningError        no motion could be planned; nothing has moved
│   ├── UnreachableError     no joint positions reach the goal pose
│   ├── CollisionError       the motion would touch the robot itself or its surroundings
│   └── PlanningTimeout      the planner did not finish within its time limit
├── ExecutionError       a motion was started but not completed
│   ├── ConditionNotMet      the motion has ended before its condition `until` was met
│   ├── MotionStopped        a client, a person or a safety function has stopped the motion
│   └── MotionTimeout        the motion did not reach its goal and settle in time
├── ConflictError        another client has control, or the current state does not permit the call
│   └── ChangedError         another client has changed the same object in the meantime
├── NotSupportedError    this product does not support the call
├── DeviceError          a device, a port or a peer rejected the request or disconnected
│   └── DeviceTimeout        the device did not answer in time
├── PayloadError         a body is larger than the service accepts
├── MediaTypeError       a body has a type that the endpoint does not accept
├── AuthenticationError  the call requires a valid token, and the client has sent none
├── PermissionDenied     the client's role does not permit the call
│   └── MisdirectedError     the request is addressed to another host
├── UnavailableError     a process, a file in shared memory or a device does not answer
│   ├── BusyError            too many connections are open to serve another one
│   └── NotReadyError        the robot answers, but its mode does not permit motions
└── SharedMemoryError    the shared memory contains unexpected data
    ├── LayoutError          it has another layout version, or belongs to another robot or program
    └── TornReadError        no consistent copy was read within the maximum number of tries

`app.api.errors` maps these classes to HTTP statuses.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Self

from cobot.findings import Explanation, Finding


class CobotError(Exception):
    """Base of all errors. Programs may compare `code`, which is stable; the message is for people.

    Attributes:
        findings: the facts behind an error about a motion. The decisive one is the first.
        explanation: changes that would make the motion work, if any were tried.
        explain: findings and explanation in the form of the REST API (docs/motions.md), if the client
            received the error from the service.
        details: further facts as texts and numbers, whose names depend on `code` (docs/conventions.md).
    """

    code: ClassVar[str] = "error"
    findings: tuple[Finding, ...] = ()
    explanation: Explanation | None = None
    explain: Mapping[str, Any] | None = None
    details: Mapping[str, Any] = MappingProxyType({})

    def __init__(
        self,
        *arguments: object,
        findings: Iterable[Finding] = (),
        details: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(*arguments)
        self.findings = tuple(findings)
        if details:
            self.details = dict(details)

    def with_message(self, message: str) -> Self:
        """A copy of the error with a different message."""
        error = type(self)(message, findings=self.findings, details=self.details)
        error.explanation, error.explain = self.explanation, self.explain
        return error


class ConfigError(CobotError):
    code = "config"


class InputError(CobotError):
    code = "input"


class LimitError(InputError):
    code = "limit"


class NotFoundError(InputError):
    code = "not_found"


class HeaderError(InputError):
    code = "header"


class PlanningError(CobotError):
    code = "planning"


class UnreachableError(PlanningError):
    code = "unreachable"


class CollisionError(PlanningError):
    code = "collision"


class PlanningTimeout(PlanningError):
    code = "planning_timeout"

    @classmethod
    def after(cls, timeout_s: float, message: str) -> Self:
        """The error for a planner that found no plan within its timeout."""
        return cls(message, findings=[Finding("time", "planning time", timeout_s, timeout_s, "s")])


class ExecutionError(CobotError):
    code = "execution"


class ConditionNotMet(ExecutionError):
    code = "condition_not_met"


class MotionStopped(ExecutionError):
    code = "stopped"


class MotionTimeout(ExecutionError):
    code = "motion_timeout"


class ConflictError(CobotError):
    code = "conflict"


class ChangedError(ConflictError):
    code = "changed"


class NotSupportedError(CobotError):
    code = "not_supported"


class DeviceError(CobotError):
    code = "device"


class DeviceTimeout(DeviceError):
    code = "device_timeout"


class PayloadError(CobotError):
    code = "payload"


class MediaTypeError(CobotError):
    code = "media_type"


class AuthenticationError(CobotError):
    code = "unauthenticated"


class PermissionDenied(CobotError):
    code = "forbidden"


class MisdirectedError(PermissionDenied):
    code = "misdirected"


class UnavailableError(CobotError):
    code = "unavailable"


class BusyError(UnavailableError):
    code = "busy"


class NotReadyError(UnavailableError):
    code = "not_ready"


class SharedMemoryError(CobotError):
    code = "shared_memory"


class LayoutError(SharedMemoryError):
    code = "layout"


class TornReadError(SharedMemoryError):
    code = "torn_read"


def _family(kind: type[CobotError]) -> Iterator[type[CobotError]]:
    yield kind
    for child in kind.__subclasses__():
        yield from _family(child)


BY_CODE: Mapping[str, type[CobotError]] = {kind.code: kind for kind in _family(CobotError)}
"""The error class of each code. Subclasses in other modules define no codes of their own."""


EXHAUSTED = {
    errno.ENOSPC: "a disk is full: make room, see df",
    errno.EDQUOT: "a disk quota is used up: make room",
    errno.EROFS: "a file system is read-only: make it writable",
    errno.EMFILE: "no file descriptor is left: close connections, or raise the limit (ulimit -n)",
    errno.ENFILE: "the computer has no file descriptor left",
    errno.ENOMEM: "the service has no memory left: raise the memory limit (ulimit -v), or free memory",
    errno.EAGAIN: "no further process or thread can be started: raise the limits (ulimit -u, ulimit -v)",
}
"""Messages for resources that may be exhausted at any time, each with a remedy."""


_IN_WORDS = {
    "Cannot allocate memory": errno.ENOMEM,
    "Could not allocate memory": errno.ENOMEM,  # MuJoCo
    "failed to map segment": errno.ENOMEM,
    "Too many open files": errno.EMFILE,
    "can't start new thread": errno.EAGAIN,
}
"""Fragments of the messages of errors that Python, the library loader and MuJoCo raise without an errno."""


def exhausted(error: BaseException | None) -> UnavailableError | None:
    """The error to report if `error` means that a resource of the computer is exhausted; otherwise None."""
    number = errno.ENOMEM if isinstance(error, MemoryError) else getattr(error, "errno", None)
    if isinstance(error, ImportError | RuntimeError | ValueError):
        number = next((number for words, number in _IN_WORDS.items() if words in str(error)), None)
    return UnavailableError(EXHAUSTED[number]) if number in EXHAUSTED else None
