"""Events of motions: the beginning of each, and how it has ended."""

from __future__ import annotations

from typing import Any

from app.services.clients import CLIENT
from app.services.events.ring import RobotEvents
from app.services.state.robot_state import RobotState
from cobot.ipc.layout import MotionResult

ENDS = {
    MotionResult.ARRIVED: "finished",
    MotionResult.MET: "finished",
    MotionResult.STOPPED: "stopped",
    MotionResult.STOPPED_ASIDE: "stopped",
    MotionResult.FAILED: "failed",
}
"""What an event says of each."""


class MotionEvents:
    """Tells each beginning and each end once.

    Attributes:
        ended: the number of motions by the way they ended. None is missed: a motion begins only after the
            service has seen how the motion before it ended.
        last_ended: the number of the motion whose end is known already.
    """

    def __init__(self, events: RobotEvents) -> None:
        self._events = events
        self.ended = dict.fromkeys(ENDS, 0)
        self.last_ended = 0
        self._beginning: dict[str, Any] = {}

    def prepare(self, motion_id: int, duration_s: float) -> None:
        """A motion is being started; what there is to tell once it has begun."""
        self._beginning = {"motion": motion_id, "duration_s": duration_s, "by": str(CLIENT.get())}

    def forget_begin(self) -> None:
        """It does not begin."""
        self._beginning = {}

    def publish_begin(self) -> None:
        """It has."""
        if self._beginning:
            self._events.publish("motion", what="begun", **self._beginning)
            self._beginning = {}

    def look(self, state: RobotState) -> None:
        """See whether a motion has ended."""
        if state.motion_id == self.last_ended or state.motion_result not in self.ended:
            return
        self.last_ended = state.motion_id
        self.ended[state.motion_result] += 1
        if state.motion_id == self._beginning.get("motion"):  # it was short, and its beginning went unnoticed
            self.publish_begin()
        result = state.motion_result
        self._events.publish(
            "motion",
            what=ENDS[result],
            motion=state.motion_id,
            reason="" if result is MotionResult.ARRIVED else state.reason,
            path_time_s=state.path_time_s,
            duration_s=state.path_duration_s,
        )
