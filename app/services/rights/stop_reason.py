"""The reason why a motion is stopped: in words for people, and as a cause and a client for programs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from app.services.clients import CLIENT
from cobot.errors import MotionStopped

StopCause = Literal[
    "stop",  # a client requested a stop, or `cobot stop` did
    "cancelled",  # a client ended only this job
    "replaced",  # a client requested something else instead
    "taken_over",  # a client took over the control
    "client_left",  # the client that requested the motion disconnected
    "scene",  # the motion would touch an object that has been added in the meantime
    "gripper",  # the gripper lost its object
    "move_before",  # the move before it in the queue failed
    "other_robot",  # another robot of the synchronous motion stopped
    "watchdog",  # a watchdog was not written in time
    "service",  # the service is shutting down
    "robot",  # rtloop or the device; the mode's reason has the details
]


def _client() -> str:
    return str(CLIENT.get())


@dataclass(frozen=True, slots=True)
class StopReason:
    """The reason for a stop.

    Attributes:
        text: the reason as a sentence.
        by: the client that caused the stop; "" if it is not known, or if no client caused it.
    """

    text: str
    cause: StopCause = "stop"
    by: str = field(default_factory=_client)

    def __str__(self) -> str:
        return self.text

    @property
    def error(self) -> MotionStopped:
        """Create the error of the motion that this reason has stopped."""
        return MotionStopped(self.text, details={"cause": self.cause, "by": self.by})
