"""Answers about the service as JSON: its health, its robots, the audit log and a reload."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from app.api.schemas.device import DeviceAnswer
from cobot.strict import StrictModel


class AuditQuery(StrictModel):
    """The audit entries that a client requests."""

    model_config = ConfigDict(strict=False)

    limit: int = Field(100, ge=1, le=1000, description="Maximum number of entries.")
    since: datetime | None = Field(
        None, description="Only entries of this time or later; without a time zone it is UTC."
    )
    after: str | None = Field(
        None,
        max_length=100,
        description="Id of an entry of an earlier response: the list continues with older ones.",
    )


class AuditEntry(BaseModel):
    """An action that a client has carried out or attempted."""

    model_config = ConfigDict(populate_by_name=True)

    id: str = Field(description="Id of the entry.")
    time: datetime = Field(description="Time of the action, UTC.")
    who: str = Field(
        description="The client: name of its access token; its own name, in quotes; anonymous; or a local "
        "user."
    )
    from_: str = Field(alias="from", description="Address and port of the client, or cli.")
    what: str = Field(
        description="The action: HTTP method and path, a vendor service, or an event of a connection."
    )
    outcome: str = Field(description="HTTP status, ok, or the error.")
    request: str | None = Field(None, description="The X-Request-Id, which log lines have too.")
    repeated: int | None = Field(
        None, description="Number of further actions of this kind in the same second."
    )
    details: dict[str, Any] = Field(
        {}, description="Further details, such as the motion, the upload or the error."
    )


class AuditAnswer(BaseModel):
    """Audit entries, the newest first."""

    entries: list[AuditEntry] = Field(description="The entries, the newest first.")
    lost: int = Field(description="Number of entries that could not be written since the service started.")
    problem: str = Field(description="Reason why nothing can be written now; empty: no problem.")


class RobotHealth(BaseModel):
    """Health of a robot. If the status is `degraded`, `problems` has the reasons."""

    status: Literal["ok", "degraded"] = Field(description="ok: no problem; degraded: see `problems`.")
    problems: list[str] = Field(description="The problems, one sentence each.")
    robot: dict[str, Any] = Field(description="The arm: its mode, its motion, and whether it has settled.")
    rtloop: dict[str, Any] = Field(description="The real-time process: pid, permissions, overruns.")
    service: dict[str, Any] = Field(
        description="This service: pid, time since its start, and the request that is moving the arm."
    )
    planning: dict[str, Any] = Field(
        description="The planning processes: state, and the numbers of usable, busy and replaced processes."
    )
    sequence: dict[str, Any] = Field(description="The newest sequence, as in /sequences/status.")
    session: dict[str, Any] | None = Field(description="The streaming session: number, client, mode.")
    recorder: dict[str, Any] | None = Field(
        description="The recorder: its process, the continuous recording, lost cycles, files, and its "
        "problem."
    )


class HealthAnswer(RobotHealth):
    """Health of the service and of its robots."""

    cycle_us: dict[str, dict[str, float]] = Field(
        description="Wake-up lateness and compute time of the cycle's phases, µs."
    )
    interventions: dict[str, int] = Field(description="Number of interventions of the safety layer, by kind.")
    last_interventions_s: dict[str, float | None] = Field(
        description="Time since the last intervention of each kind, s; null: there was none."
    )
    versions: dict[str, str] = Field(description="Versions of cobot and of the libraries that it uses.")
    robots: dict[str, RobotHealth] = Field(description="Health of each addressed robot, by its name.")


class LiveAnswer(BaseModel):
    """The service runs."""

    status: Literal["live"] = Field(description="Always live: a service that is not running does not answer.")


class ReadyAnswer(BaseModel):
    """Every robot that the request addresses accepts motions."""

    status: Literal["ready"] = Field(
        description="Always `ready`; otherwise the answer is a 503 with the reasons."
    )
    robots: list[str] = Field(description="Names of the robots.")


class ReloadAnswer(BaseModel):
    """The result of a reload, as sentences."""

    taken_over: list[str] = Field(description="Changes that apply now; empty if nothing has changed.")
    needs_restart: list[str] = Field(description="Changes that need a restart of cobot.")


class RestoreAnswer(BaseModel):
    """A checked backup, which the next start of cobot restores."""

    created: str = Field(description="When the backup was made, ISO 8601 in UTC.")
    contents: list[str] = Field(description="Contents of the backup, as sentences.")


class RobotAnswer(BaseModel):
    """A robot of this service."""

    name: str = Field(description="Name of the robot, for /robots/{robot}/...")
    model: str = Field(description="Name of the robot's model, from the model's file.")
    default: bool = Field(
        description="Whether this is the default robot, which endpoints without a robot's name use."
    )
    path: str = Field(description="Prefix of the paths of this robot's endpoints.")
    base_frame: str = Field(description="The frame of all poses of this robot.")
    joint_names: list[str] = Field(description="Names of the joints, from the base to the flange.")
    device: DeviceAnswer | None = Field(
        description="The device that moves the robot; null while it cannot be read."
    )
