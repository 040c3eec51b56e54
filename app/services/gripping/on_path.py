"""Gripper commands that are actions on the path of a motion."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from app.services.gripping.service import GripperService
from app.services.rights.claims import Caller
from app.services.rights.job import Job, JobKind
from app.services.rights.ownership import Ownership
from cobot.errors import CobotError
from cobot.motions.gripper_bodies import GripperRequest

VALID = ("move", "grasp", "release")
NAME = "an action on the path"
TIMEOUT_S = 30.0


class PathCommands:
    """Executes one robot's gripper commands that are actions on a path. Each command is a separate job."""

    def __init__(self, gripper: GripperService, ownership: Ownership) -> None:
        self._gripper = gripper
        self._ownership = ownership
        self._tasks: set[asyncio.Task[Any]] = set()

    def check(self, fields: Mapping[str, Any]) -> None:
        """Check that the gripper supports the command.

        Args:
            fields: the name of the command as `command`, and the fields of its request body.

        Raises:
            InputError: the command is unknown, or its fields are invalid.
            LimitError, NotSupportedError: see `check_command`.
        """
        self._gripper.check(GripperRequest.of(fields, VALID).command)

    def begin(self, fields: Mapping[str, Any]) -> None:
        """Begin the command and return at once. The command's job reports its result.

        Raises:
            CobotError: the gripper rejects the command. The command's job has failed with the same reason.
        """
        request = GripperRequest.of(fields, VALID)
        job = self._ownership.new_job(JobKind.GRIPPER, f"{NAME}: {request.words}")
        caller = Caller(NAME, None, self._ownership.stops, TIMEOUT_S, asyncio.Event(), job, waits=False)
        try:
            self._gripper.require_ready(request.command, caller)
        except CobotError as exc:
            self._ownership.end(job, exc)
            raise
        task = asyncio.create_task(self._run(request, caller, job))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _run(self, request: GripperRequest, caller: Caller, job: Job) -> None:
        try:
            await self._gripper.run(request.name, request.command, caller)
        except CobotError as exc:
            if not job.ended.is_set():  # the command was rejected before it began
                self._ownership.end(job, exc)
