"""The actions /{robot}/gripper/gripper_cmd (control_msgs/action/GripperCommand) and
/{robot}/gripper/parallel_gripper_cmd (control_msgs/action/ParallelGripperCommand).

A goal is executed as a gripper command and as a job. A new command replaces the current one, whether it comes
from one of these actions or from another client. If an object stops the fingers, the goal succeeds with
`stalled` set. The results have no field for an error message, so the reason for a failure is reported in the
log, on /rosout and in the job.
"""

from __future__ import annotations

import asyncio
import contextlib

from app.actions.gripper_goal import FingerJoints, Grasped, OneGap
from app.graph.actions import GoalHandle, GoalStatus
from app.services.gripping.service import GripperService
from app.services.rights.claims import Caller
from app.services.rights.job import JobKind
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from cobot.errors import CobotError, MotionStopped, UnavailableError
from cobot.motions.gripper_bodies import GripperRequest
from cobot.ros.messages import Message

FEEDBACK_S = 0.05
TIMEOUT_S = 30.0
"""Timeout for a goal, s. It is the same as for POST /robot/gripper/move."""


class GripperAction:
    """See `app.graph.actions.GraphAction`.

    Args:
        robot: robot name.
        name: action name, below /{robot}/gripper.
        form: conversion between the action's messages and widths and forces.
    """

    definition = ""

    def __init__(
        self,
        robot: str,
        name: str,
        form: type[OneGap] | type[FingerJoints],
        gripper: GripperService,
        ownership: Ownership,
    ) -> None:
        self.name = f"/{robot}/gripper/{name}"
        self.type_ = form.type_
        self._form = form
        self._gripper = gripper
        self._ownership = ownership

    async def execute(self, goal: Message, handle: GoalHandle) -> Message:
        gripper, stops = self._gripper, self._ownership.stops
        report = gripper.report()
        request = self._form.read(goal).request(report.capabilities)
        gripper.check(request.command)
        self._ownership.require_control()
        if report.problem:
            raise UnavailableError(f"gripper {report.type}: {report.problem}")
        job = self._ownership.new_job(JobKind.GRIPPER, f"{self.name}: {request.words}")
        caller = Caller(self.name, None, stops, TIMEOUT_S, asyncio.Event(), job, waits=False)
        handle.accept()
        watchers = [
            asyncio.create_task(self._cancel(handle, caller)),
            asyncio.create_task(self._feed(handle, request)),
        ]
        try:
            outcome = await gripper.run(request.name, request.command, caller)
            error = outcome.error
        except CobotError as exc:
            error = exc
            if not job.ended.is_set():
                self._ownership.end(job, exc, stopped=isinstance(exc, MotionStopped))
        finally:
            for watcher in watchers:
                watcher.cancel()
        if error is None:
            handle.status = GoalStatus.SUCCEEDED
        else:
            cancelled = handle.cancel_requested.is_set() and isinstance(error, MotionStopped)
            handle.status = GoalStatus.CANCELED if cancelled else GoalStatus.ABORTED
            handle.explain(error)
        return self._form.result(self._grasped(request, ended=True))

    async def _cancel(self, handle: GoalHandle, caller: Caller) -> None:
        await handle.cancel_requested.wait()
        if caller.job is not None:
            self._gripper.cancel(caller.job, StopReason("the goal was cancelled", "cancelled").error)

    async def _feed(self, handle: GoalHandle, request: GripperRequest) -> None:
        while True:
            with contextlib.suppress(CobotError):
                handle.feedback(self._form.feedback(self._grasped(request, ended=False)))
            await asyncio.sleep(FEEDBACK_S)

    def _grasped(self, request: GripperRequest, *, ended: bool) -> Grasped:
        report = self._gripper.report()
        state = None if report.problem else report.state
        return Grasped.of(request, state, report.capabilities, ended=ended)


def gripper_actions(robot: str, gripper: GripperService, ownership: Ownership) -> list[GripperAction]:
    """Create the actions for a robot's gripper; empty if the robot has no gripper."""
    if not gripper.exists:
        return []
    forms: dict[str, type[OneGap] | type[FingerJoints]] = {
        "gripper_cmd": OneGap,
        "parallel_gripper_cmd": FingerJoints,
    }
    return [GripperAction(robot, name, form, gripper, ownership) for name, form in forms.items()]
