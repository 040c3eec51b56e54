"""The action /{robot}/servo_mode: a servo session that a client supervises.

The client still sends points through /{robot}/joint_cmd or the servo services. The goal is rejected if the
session cannot begin. Feedback is sent until the session ends. A cancel request, a servo_control stop, mode 0,
a new session, the watchdog, a stop or an e-stop ends the session.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

from app.graph.actions import GoalHandle, GoalStatus, RejectedGoalError
from app.services.streaming.servo import ServoService
from cobot.errors import ConflictError
from cobot.ipc.layout import ServoMode

FEEDBACK_S = 0.05
DEFINITION = """\
# Keep a servo session open; send its points to joint_cmd.
int32 mode                # 1 to 7, see docs/servo.md
float64 watchdog_timeout  # s, the session ends after this time without a point; 0: 0.5 s
float64 send_period       # s, how often points come; 0: the control period
---
int32 code                # 0: ended by a cancel or stop request; 1: ended for another reason
string message            # why it has ended
int64 points_received
int64 points_accepted
int64 points_refused
int64 points_taken        # points that have moved the arm
int64 underruns
string refused            # a JSON object: how many points were refused, by reason
---
int32 mode
bool active
string state              # opening, active, closing, idle
int64 session_id          # the session accepts points with this id only; 0: none yet
int64 point_id            # of the last accepted point
int64 points_received
int64 points_accepted
int64 points_refused
int64 points_taken
int64 jumps               # accepted points that the arm could not follow
int64 buffered            # accepted points that are still ahead
int64 underruns
int64 overruns
string last_refusal
"""
RESULT = ("points_received", "points_accepted", "points_refused", "points_taken", "underruns")
FEEDBACK = (
    "mode",
    "active",
    "state",
    "session_id",
    "point_id",
    *RESULT[:4],
    "jumps",
    "buffered",
    "underruns",
    "overruns",
    "last_refusal",
)
ENDED_AS_ASKED, ENDED_OTHERWISE = 0, 1


class ServoModeAction:
    """See `app.graph.actions.GraphAction`."""

    type_ = "aubo_interfaces/action/ServoMode"
    definition = DEFINITION

    def __init__(self, robot: str, servo: ServoService) -> None:
        self.name = f"/{robot}/servo_mode"
        self._servo = servo

    async def execute(self, goal: dict[str, Any], handle: GoalHandle) -> dict[str, Any]:
        servo = self._servo
        if goal["mode"] == ServoMode.NONE:
            raise RejectedGoalError("mode must be from 1 to 7: cancel the goal to leave a mode")
        if servo.active:
            raise ConflictError("a servo session is already running: end it first")
        number = await servo.begin(goal["mode"], goal["watchdog_timeout"], goal["send_period"])
        handle.accept()
        while servo.holds(number):
            handle.feedback(self._feedback())
            try:
                await asyncio.wait_for(handle.cancel_requested.wait(), FEEDBACK_S)
                break
            except TimeoutError:
                continue
        cancelled = handle.cancel_requested.is_set() and servo.holds(number)
        if cancelled:
            await servo.end("the goal was cancelled")
        return self._result(handle, cancelled=cancelled, replaced=servo.session != number)

    def _result(self, handle: GoalHandle, *, cancelled: bool, replaced: bool) -> dict[str, Any]:
        """Build the result. `replaced` is true if a client has requested a new session or mode 0 in the
        meantime.
        """
        values = self._servo.feedback()
        as_asked = cancelled or replaced
        if cancelled:
            handle.status = GoalStatus.CANCELED
        else:
            handle.status = GoalStatus.SUCCEEDED if as_asked else GoalStatus.ABORTED
        return {
            "code": ENDED_AS_ASKED if as_asked else ENDED_OTHERWISE,
            "message": values["reason"],
            "refused": json.dumps(values["refused"]),
            **{name: values[name] for name in RESULT},
        }

    def _feedback(self) -> dict[str, Any]:
        values = self._servo.feedback()
        return {name: values[name] for name in FEEDBACK}
