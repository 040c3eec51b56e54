"""The messages of a fleet, as JSON. Each message is checked on arrival, because it may come from anywhere."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import Field, ValidationError

from cobot.access.roles import RoleName
from cobot.addresses import NAME
from cobot.errors import InputError
from cobot.strict import StrictModel, sentences

MAX_BYTES = 64 * 1024
"""Maximum size of a message, in bytes."""
KEPT_EVENTS = 50
"""Number of events per robot that cells and hubs keep for clients that connect later."""
MAX_PROBLEMS, MAX_DRIFT = 20, 100
"""Maximum number of problems, and of changed programs, in a state."""
MAX_LIFETIME_S = 60.0
"""Maximum time between the issue of a command and its deadline."""
NOT_ENDED = ("queued", "planning", "running", "paused")
"""States of a job of the cell's service that has not ended."""
DEADLINE_S = 2.0
"""Default timeout for a cell to receive a command, in seconds."""
REST_S = 6.0
"""Time after the deadline of a command in which a cell must stop the arm and answer, in seconds."""
Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Id = Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{8,64}$")]
Person = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,64}$")]
Text = Annotated[str, Field(max_length=2000)]
Program = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
Target = Annotated[str, Field(pattern=rf"^({NAME}|\*)$")]
"""Name of a cell or robot, or * for all."""
Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Seconds = Annotated[float, Field(ge=0.0, le=1e12, allow_inf_nan=False)]
StateWord = Literal["ready", "moving", "paused", "stopping", "estop", "fault", "silent"]


class FleetProgram(StrictModel):
    """A stored program of a cell: its id, its display name, and its latest version."""

    id: Text
    label: Text
    version: int


class FleetState(StrictModel):
    """The state of one robot of a cell.

    Attributes:
        instance: a different number for each start of the cell's process.
        state: the state as a word; `silent` means that rtloop publishes nothing.
        configuration: hash of the settings and their files, which is the same in cells with the same robots.
        problems: problems that the service reports, or the reason why the service does not answer.
        panel: address of the cell's panel; "" for a cell without a panel.
        bundle: name, version and hash of the latest bundle.
        recordings: whether the hub may fetch recordings.
        drift: programs of that bundle that have changed since its activation, and "settings" if other
            settings are in force.
        counters: numbers of missed cycles, interventions of the safety layer, stops and e-stops since the
            real-time process started.
    """

    cell: Name
    robot: Name
    zone: Name | Literal[""] = ""
    instance: Id
    version: Text
    configuration: Text
    state: StateWord
    mode: Text = ""
    reason: Text = ""
    backend: Text = ""
    job: Text = ""
    program: Text = ""
    control: Text = ""
    speed_override: Annotated[float, Field(ge=0.0, le=10.0)] | None = None
    problems: Annotated[list[Text], Field(max_length=MAX_PROBLEMS)] = Field(default_factory=list)
    panel: Text = ""
    bundle: Text = ""
    recordings: bool = False
    drift: Annotated[list[Text], Field(max_length=MAX_DRIFT)] = Field(default_factory=list)
    counters: Annotated[dict[Text, Annotated[int, Field(ge=0)]], Field(max_length=20)] = Field(
        default_factory=dict
    )


class RobotEvent(StrictModel):
    """An event of the cell's service, see docs/events.md."""

    cell: Name
    robot: Name
    id: Text
    time: Text
    type: Text
    data: dict[str, Any]


class HubTime(StrictModel):
    """The time of the fleet. This clock starts at 0 when a hub starts, and does not depend on the time of
    day.

    Attributes:
        epoch: the hub's instance. Times of different epochs cannot be compared.
    """

    epoch: Id
    time_s: Seconds


class StopArm(StrictModel):
    """Stop the arm, and the program or motion that moves it."""

    accepted_by: ClassVar = "stop"
    kind: Literal["stop"]


class StartProgram(StrictModel):
    """Start one of the cell's stored programs, by default its latest version."""

    accepted_by: ClassVar = "program"
    kind: Literal["start"]
    program: Program
    version: Annotated[int, Field(ge=1, le=999_999_999)] | None = None


class PauseProgram(StrictModel):
    """Pause the running program, or the single motion."""

    accepted_by: ClassVar = "program"
    kind: Literal["pause"]


class ResumeProgram(StrictModel):
    """Resume the paused program or motion."""

    accepted_by: ClassVar = "program"
    kind: Literal["resume"]


class SetSpeed(StrictModel):
    """Set the speed override: the fraction of the planned speed."""

    accepted_by: ClassVar = "speed"
    kind: Literal["speed"]
    fraction: Annotated[float, Field(ge=0.0, le=1.0)]


class TakeFleetControl(StrictModel):
    """Take control for the fleet, so that the cell's other clients cannot move the arm."""

    accepted_by: ClassVar = "control"
    kind: Literal["take_control"]
    force: bool = False


class ReleaseFleetControl(StrictModel):
    """Release control."""

    accepted_by: ClassVar = "control"
    kind: Literal["release_control"]


class StageBundle(StrictModel):
    """Fetch a bundle from the hub, and check it. Nothing changes."""

    accepted_by: ClassVar = "roll_out"
    kind: Literal["stage"]
    bundle: Hash


class ActivateBundle(StrictModel):
    """Store the programs and positions of a staged bundle, and activate its settings."""

    accepted_by: ClassVar = "roll_out"
    kind: Literal["activate"]
    bundle: Hash


class RollBackBundle(StrictModel):
    """Restore what a bundle has replaced."""

    accepted_by: ClassVar = "roll_out"
    kind: Literal["roll_back"]
    bundle: Hash


# `accepted_by` is the setting name, below fleet.accept of a cell, that lists the accepted roles.
FleetAction = Annotated[
    StopArm
    | StartProgram
    | PauseProgram
    | ResumeProgram
    | SetSpeed
    | TakeFleetControl
    | ReleaseFleetControl
    | StageBundle
    | ActivateBundle
    | RollBackBundle,
    Field(discriminator="kind"),
]


class FleetCommand(StrictModel):
    """A command to robots.

    Attributes:
        id: the same in each retry, so that the cell recognises a retry.
        cell, robot, zone: targets of the command. A cell of another zone does not answer.
        who: the person or program, for the cell's audit.
        role: role of that person at the hub.
        epoch: epoch of `issued_s` and `expires_s`, see `HubTime`.
    """

    id: Id
    fleet: Name
    cell: Target
    robot: Target
    zone: Name | None = None
    action: FleetAction
    who: Person
    role: RoleName
    epoch: Id
    issued_s: Seconds
    expires_s: Seconds


class CommandAnswer(StrictModel):
    """The result of a command.

    Attributes:
        code: "ok", or the code of the error, see docs/services.md.
        repeated: whether this is the answer to an earlier try, so that nothing was executed again.
    """

    id: Text
    cell: Name
    robot: Name
    code: Text
    text: Text
    repeated: bool = False


Model = TypeVar("Model", bound=StrictModel)


def read(kind: type[Model], content: bytes) -> Model:
    """Read a message.

    Raises:
        InputError: the content is not a message of this kind.
    """
    if len(content) > MAX_BYTES:
        raise InputError(f"{kind.__name__}: has {len(content)} bytes, allowed: {MAX_BYTES}")
    try:
        return kind.model_validate_json(content)
    except ValidationError as exc:
        raise InputError(f"{kind.__name__}: {sentences(exc.errors())}") from exc


def written(message: StrictModel) -> bytes:
    return message.model_dump_json().encode()
