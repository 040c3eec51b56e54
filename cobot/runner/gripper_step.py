"""The step that commands the gripper. It contains the name of the command, and the body of a POST
/robot/gripper/... request.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import Discriminator, Tag

from cobot.client import Client
from cobot.loose_lists import RequestModel
from cobot.motions.gripper_bodies import GripperGrasp, GripperHome, GripperMove, GripperRelease

CommandName = Literal["move", "grasp", "release", "home", "stop"]
COMMAND_TAGS = tuple(f"{name} command" for name in get_args(CommandName))


class MoveCommand(GripperMove):
    """Move the fingers to a width."""

    command: Literal["move"]


class GraspCommand(GripperGrasp):
    """Hold an object."""

    command: Literal["grasp"]


class ReleaseCommand(GripperRelease):
    """Release the object."""

    command: Literal["release"]


class HomeCommand(GripperHome):
    """Find the reference, or activate the gripper. Its fingers may move."""

    command: Literal["home"]


class StopCommand(RequestModel):
    """Stop the fingers where they are. A held object stays held."""

    command: Literal["stop"]


def _command(value: Any) -> str | None:
    name = value.get("command") if isinstance(value, dict) else getattr(value, "command", None)
    return f"{name} command" if name in get_args(CommandName) else None


GripperCommand = Annotated[
    Annotated[MoveCommand, Tag(COMMAND_TAGS[0])]
    | Annotated[GraspCommand, Tag(COMMAND_TAGS[1])]
    | Annotated[ReleaseCommand, Tag(COMMAND_TAGS[2])]
    | Annotated[HomeCommand, Tag(COMMAND_TAGS[3])]
    | Annotated[StopCommand, Tag(COMMAND_TAGS[4])],
    Discriminator(
        _command,
        custom_error_type="command",
        custom_error_message=f"must have a command, one of {', '.join(get_args(CommandName))}",
    ),
]


def describe_command(command: RequestModel) -> str:
    """A command as text: `grasp (width 0.04, force 20)`."""
    fields = command.model_dump(exclude_unset=True)
    name = fields.pop("command")
    given = ", ".join(f"{field} {value}" for field, value in fields.items())
    return f"{name} ({given})" if given else str(name)


def run_command(client: Client, command: RequestModel) -> None:
    """Send the command to the gripper. Returns when the fingers have finished.

    Raises:
        CobotError: the service's error, see `Client`.
    """
    fields = command.model_dump(exclude_unset=True)
    getattr(client.gripper, fields.pop("command"))(**fields)
