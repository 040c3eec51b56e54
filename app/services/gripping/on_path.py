"""Commands to the gripper that actions on the path of a motion give."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from app.services.gripping.service import GripperService
from app.services.rights.claims import Caller
from app.services.rights.job import JobKind
from app.services.rights.ownership import Ownership
from cobot.errors import InputError
from cobot.motions.gripper_bodies import AnyGripperCommand, GripperGrasp, GripperMove, GripperRelease
from cobot.strict import sentences, shown

BODIES: dict[str, type[AnyGripperCommand]] = {
    "move": GripperMove,
    "grasp": GripperGrasp,
    "release": GripperRelease,
}
NAME = "an action on the path"
TIMEOUT_S = 30.0


class PathCommands:
    """The gripper of one robot, as actions on a path command it: each command is a job of its own."""

    def __init__(self, gripper: GripperService, ownership: Ownership) -> None:
        self._gripper = gripper
        self._ownership = ownership
        self._tasks: set[asyncio.Task[Any]] = set()

    def check(self, fields: Mapping[str, Any]) -> None:
        """See that the gripper can do it.

        Args:
            fields: `command`, and the body of that command.

        Raises:
            InputError: there is no such command, or its fields are wrong.
            LimitError, NotSupportedError: see `check_command`.
        """
        self._gripper.check(_command(fields)[1])

    def begin(self, fields: Mapping[str, Any]) -> None:
        """Begin it and return at once; its job says how it ends."""
        name, command = _command(fields)
        about = f"{NAME}: gripper {name} {command.model_dump_json(exclude_unset=True)}"
        job = self._ownership.new_job(JobKind.GRIPPER, about)
        caller = Caller(NAME, None, self._ownership.stops, TIMEOUT_S, asyncio.Event(), job, waits=False)
        task = asyncio.create_task(self._gripper.run(name, command, caller))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def _command(fields: Mapping[str, Any]) -> tuple[str, AnyGripperCommand]:
    name = fields.get("command")
    if not isinstance(name, str) or name not in BODIES:
        raise InputError(f"command: must be one of {', '.join(BODIES)}, got {shown(name)}")
    try:
        body = BODIES[name].model_validate({key: value for key, value in fields.items() if key != "command"})
    except ValidationError as exc:
        raise InputError(sentences(exc.errors())) from exc
    return name, body
