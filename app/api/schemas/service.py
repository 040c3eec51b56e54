"""Answers about the service as JSON: its health, its robots, the audit and a reload."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from app.api.schemas.device import DeviceAnswer
from cobot.strict import StrictModel


class AuditQuery(StrictModel):
    """The audit entries that a client asks for."""

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
    time: datetime = Field(description="When, UTC.")
    who: str = Field(
        description="Name of the access token; a client's own name in quotes; anonymous; a local user."
    )
    from_: str = Field(alias="from", description="Address and port, or cli.")
    what: str = Field(description="Method and path; the vendor service; what a connection has done.")
    outcome: str = Field(description="HTTP's status, or ok, or what went wrong.")
    request: str | None = Field(None, description="The X-Request-Id, also in the lines of the log.")
    repeated: int | None = Field(None, description="How many more of this kind followed in the same second.")
    details: dict[str, Any] = Field({}, description="Further facts: the motion, the upload, the error.")


class AuditAnswer(BaseModel):
    """The newest entries, the newest of them first."""

    entries: list[AuditEntry] = Field(description="The newest first.")
    lost: int = Field(description="Entries that could not be written since the service started.")
    problem: str = Field(description="Why nothing can be written now; empty: no problem.")


class RobotHealth(BaseModel):
    """Health of a robot; `degraded` comes with `problems`."""

    status: Literal["ok", "degraded"] = Field(description="ok: there is no problem.")
    problems: list[str] = Field(description="What is wrong, a sentence each.")
    robot: dict[str, Any] = Field(description="The arm: mode, motion, whether it is settled.")
    rtloop: dict[str, Any] = Field(description="The real-time process: pid, permissions, overruns.")
    service: dict[str, Any] = Field(
        description="This service: pid, time since its start, what moves the arm."
    )
    planning: dict[str, Any] = Field(
        description="The planning processes: state, how many are usable and busy, how many were replaced."
    )
    sequence: dict[str, Any] = Field(description="The newest sequence, as in /sequences/status.")
    session: dict[str, Any] | None = Field(description="The streaming session: number, client, mode.")
    recorder: dict[str, Any] | None = Field(
        description="What is recorded: the process, the continuous recording, lost cycles, files, problem."
    )


class HealthAnswer(RobotHealth):
    """Health of the service and of its robots."""

    cycle_us: dict[str, dict[str, float]] = Field(
        description="Wake-up lateness and compute time of the cycle's phases, µs."
    )
    interventions: dict[str, int] = Field(description="What the safety layer caught, by kind.")
    last_interventions_s: dict[str, float | None] = Field(
        description="Seconds since the last one of each kind; null: there was none."
    )
    versions: dict[str, str] = Field(description="Versions of cobot and of the libraries that it uses.")
    robots: dict[str, RobotHealth] = Field(description="Health of each addressed robot, by its name.")


class LiveAnswer(BaseModel):
    """The service runs."""

    status: Literal["live"] = Field(description="A service that does not run gives no answer.")


class ReadyAnswer(BaseModel):
    """Every robot that the request addresses accepts motions."""

    status: Literal["ready"] = Field(
        description="Always `ready`; otherwise the answer is a 503 with the reasons."
    )
    robots: list[str] = Field(description="Their names.")


class ReloadAnswer(BaseModel):
    """What the reload has done, as sentences."""

    taken_over: list[str] = Field(description="Changes that apply now; empty if nothing has changed.")
    needs_restart: list[str] = Field(description="Changes that need a restart of cobot.")


class RestoreAnswer(BaseModel):
    """A backup that was checked. The next start of cobot restores it."""

    created: str = Field(description="When the backup was made, ISO 8601 in UTC.")
    contents: list[str] = Field(description="Contents of the backup, as sentences.")


class RobotAnswer(BaseModel):
    """A robot of this service."""

    name: str = Field(description="For /robots/{robot}/...")
    model: str = Field(description="The name of its model, as the model's file has it.")
    default: bool = Field(description="Endpoints without the name of a robot use this one.")
    path: str = Field(description="Beginning of the paths of its own endpoints.")
    base_frame: str = Field(description="The frame of all its poses.")
    joint_names: list[str] = Field(description="From the base to the flange.")
    device: DeviceAnswer | None = Field(description="The device that moves it; null while it cannot be read.")
