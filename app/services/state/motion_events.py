"""Publishes events for each motion's start and end."""

from __future__ import annotations

from typing import Any

from app.services.clients import CLIENT
from app.services.events.ring import RobotEvents
from app.services.state.robot_state import RobotState
from cobot.ipc.layout import MotionResult
from cobot.reasons import Reason

ENDS = {
    MotionResult.ARRIVED: "finished",
    MotionResult.MET: "finished",
    MotionResult.STOPPED: "stopped",
    MotionResult.STOPPED_ASIDE: "stopped",
    MotionResult.FAILED: "failed",
}
"""Result that the event reports, by the result of the motion."""


class MotionEvents:
    """Publishes the beginning and the end of each motion once.

    Attributes:
        ended: number of motions that have ended, by result. None is missed, because a motion begins only
            after the service has seen the result of the previous one.
        last_ended: number of the last motion whose end is known.
    """

    def __init__(self, events: RobotEvents) -> None:
        self._events = events
        self.ended = dict.fromkeys(ENDS, 0)
        self.last_ended = 0
        self._beginning: dict[str, Any] = {}

    def prepare(self, motion_id: int, duration_s: float) -> None:
        """Prepare the event of a motion that is being started."""
        self._beginning = {"motion": motion_id, "duration_s": duration_s, "by": str(CLIENT.get())}

    def forget_begin(self) -> None:
        """Drop the prepared event, because the motion has not begun."""
        self._beginning = {}

    def publish_begin(self) -> None:
        """Publish the prepared event, because the motion has begun."""
        if self._beginning:
            self._events.publish("motion", what="begun", **self._beginning)
            self._beginning = {}

    def look(self, state: RobotState) -> None:
        """Check whether a motion has ended, and publish its end."""
        if state.motion_id == self.last_ended or state.motion_result not in self.ended:
            return
        self.last_ended = state.motion_id
        self.ended[state.motion_result] += 1
        # a short motion, whose beginning was not noticed
        if state.motion_id == self._beginning.get("motion"):
            self.publish_begin()
        result = state.motion_result
        reason = Reason("") if result is MotionResult.ARRIVED else state.reason
        self._events.publish(
            "motion",
            what=ENDS[result],
            motion=state.motion_id,
            reason=reason,
            **reason.fields(),
            path_time_s=state.path_time_s,
            duration_s=state.path_duration_s,
        )
