"""Jobs as JSON."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from typing import Annotated, Any

from fastapi import Query
from pydantic import BaseModel, ConfigDict, Field, RootModel

from app.api.errors import RefusedAnswer
from app.api.paging import AFTER, LIMIT
from app.api.schemas.explain import explain_of
from app.api.schemas.robot import WAIT
from app.api.schemas.signals import ActionAnswer, ContactAnswer
from app.services.rights.job import JobKind, JobRecord, JobState
from app.services.rights.job_book import KEPT
from cobot.errors import CobotError
from cobot.loose_lists import RequestModel
from cobot.motions.bodies import AnyMotion
from cobot.motions.fields import HOME, example
from cobot.strict import StrictModel

MAX_BODY = 4096
"""Maximum length of a request body that is stored with its job, in characters of JSON."""
MAX_WAIT_S = 60.0


class JobRequest(BaseModel):
    """The HTTP request that began a job, or the newest one that changed its goal."""

    path: str = Field(description="Path without the API version, such as /robot/move/joints.")
    body: dict[str, Any] | None = Field(
        description="The fields that were sent; null without a JSON body, or if it has more than "
        f"{MAX_BODY} characters."
    )


class JobAnswer(BaseModel):
    """A job: a request to move, from its arrival to its end."""

    id: str = Field(description="Id of this job.")
    robot: str = Field(description="Name of the robot.")
    kind: JobKind = Field(description="Kind of the request.")
    state: JobState = Field(
        description="queued, planning, running or paused; after the end finished, failed, cancelled (it was "
        "stopped) or interrupted (the service ended)."
    )
    request: str = Field(
        json_schema_extra={"deprecated": True},  # `deprecated=True` would warn at each access
        description="The path and the body as one text, shortened. Use `requested` instead.",
    )
    requested: JobRequest | None = Field(
        description="The HTTP request; null for a job that was not requested over HTTP, for example over ROS."
    )
    owner: str = Field(description="The client that requested it.")
    parent: str | None = Field(description="Id of the sequence's job, if this job belongs to a sequence.")
    motion_id: int | None = Field(
        description="Number of the job's newest motion; null before the first motion."
    )
    progress: float = Field(
        description="Completed share of the motion's path time, 0 to 1; for a sequence: of its waypoints."
    )
    planned_duration_s: float | None = Field(description="Duration of the motion at its planned speed.")
    remaining_s: float | None = Field(
        description="Remaining time, at the current speed override; null while it is unknown."
    )
    note: str = Field(description="How the motion differs from the request; empty if it does not.")
    error: RefusedAnswer | None = Field(
        description="Reason why the job has not succeeded, in the form of an error response."
    )
    actions: list[ActionAnswer] = Field(description="Results of the actions on the path.")
    waits_for: str | None = Field(description="The condition that the motion is waiting for.")
    stopped_by: str | None = Field(description="The condition that has ended the motion.")
    contact: ContactAnswer | None = Field(description="The state of the arm when the condition was met.")
    created_at: datetime = Field(description="Time of the request.")
    started_at: datetime | None = Field(description="Time when the first motion began.")
    ended_at: datetime | None = Field(
        description="Time of the end; for a job that a crash interrupted, the last time at which the "
        "service is known to have run."
    )


class JobsAnswer(BaseModel):
    """A list of jobs."""

    jobs: list[JobAnswer] = Field(
        description="The jobs, the newest first; with several robots, robot by robot."
    )


class JobsQuery(StrictModel):
    """The jobs that a client requests."""

    model_config = ConfigDict(strict=False)

    limit: int | None = Field(None, ge=1, le=KEPT, description=f"{LIMIT} Default: 50.")
    after: str | None = Field(None, max_length=100, description=AFTER)
    n: int = Field(
        50,
        ge=1,
        le=KEPT,
        deprecated=True,
        description="Maximum number of jobs per robot. Ignored with `limit` or `after`.",
    )
    state: list[JobState] = Field([], description="Only jobs in one of these states.")


class JobQuery(StrictModel):
    """How long the client waits for a job."""

    model_config = ConfigDict(strict=False)

    wait_s: float = Field(
        0.0,
        ge=0.0,
        le=MAX_WAIT_S,
        description="Maximum time until the answer, s. The answer comes earlier if the job ends.",
    )


class MoveQuery(BaseModel):
    """Whether the client waits for the motion, and whether the motion is queued."""

    wait: bool = Field(True, description=WAIT)
    queue: bool = Field(
        False,
        description="true: run the motion after those that are already queued. The answer is a 202 with the "
        "job as soon as the motion is planned.",
    )
    blend_radius: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        allow_inf_nan=False,
        description="With queue: blend radius at the end of this motion, m. Within it the TCP may leave the "
        "path and continue into the next motion without a stop, if that is queued in time. 0: "
        "the TCP stops.",
    )


class NewGoal(RootModel[AnyMotion]):
    """The body of a motion to a named position, to joint angles or to a pose."""

    model_config = example({"joints": [0.5, 0.5, *HOME[2:]], "speed": 0.25})


class RetargetAnswer(BaseModel):
    """Where the arm leaves its former path, and the motion from there."""

    job: str = Field(description="Id of the job, which continues.")
    motion_id: int = Field(description="Number of the motion, which stays the same.")
    change_in_s: float = Field(
        description="Time at planned speed until the arm leaves its former path; 0 if it already has."
    )
    settled_in_s: float = Field(
        description="Time at planned speed until the arm follows only the new motion. Until then the new "
        "motion is added to the former one, which slows down."
    )
    joints: list[float] = Field(description="Joint positions where the arm leaves its former path, rad.")
    duration_s: float = Field(description="Time from there to the new goal, at planned speed.")
    planning_time_s: float = Field(
        description="Time from the request until the real-time loop had the new motion."
    )
    note: str = Field(description="How the motion differs from the request; empty if it does not.")


class SpeedOverrideBody(RequestModel):
    """A new speed override."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"fraction": 1.0}]})

    fraction: float = Field(
        ge=0.0,
        le=1.0,
        allow_inf_nan=False,
        description="Share of the planned speed: 0 (the arm waits) or 0.01 to 1.",
    )


class SpeedOverrideAnswer(BaseModel):
    """The speed override."""

    fraction: float = Field(description="Share of the planned speed.")


Wait = Annotated[bool, Query(description=WAIT)]
ACCEPTED: dict[int | str, dict[str, Any]] = {
    202: {
        "model": JobAnswer,
        "description": "With wait=false or queue=true: the job. The header `Location` is its URL.",
    }
}


def job_answer(record: JobRecord) -> JobAnswer:
    """Return a job as JSON."""
    error = None
    if record.error is not None:
        found = CobotError(findings=record.error.findings)
        error = RefusedAnswer(
            detail=record.error.detail,
            code=record.error.code,
            explain=explain_of(found),
            details=dict(record.error.details),
        )
    words = {"waits_for": record.waits_for or None, "stopped_by": record.stopped_by or None}
    requested = {"path": record.path, "body": record.body} if record.path else None
    return JobAnswer.model_validate(asdict(record) | words | {"error": error, "requested": requested})
