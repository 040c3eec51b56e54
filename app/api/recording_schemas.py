"""Requests and answers about recordings."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from cobot.loose_lists import RequestModel
from cobot.recording.events import EVENT_KINDS


class AskRecording(RequestModel):
    """The data to record."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"action": "dump", "seconds": 10.0}]})

    action: Literal["dump", "start", "stop"] = Field(
        "dump",
        description="dump: write the last seconds, which are in memory, to a file; start, stop: of a "
        "continuous recording.",
    )
    seconds: Annotated[float, Field(gt=0.0, le=600.0, allow_inf_nan=False)] | None = Field(
        None, description="Of a dump, s; at most what is in memory. Without it `recording.before_s`."
    )


class AskedRecordingAnswer(BaseModel):
    """What came of it."""

    names: list[str] = Field(
        description="Of the files that are whole now; after start: what their names will begin with."
    )


class RecordingAnswer(BaseModel):
    """A file."""

    name: str = Field(description="As GET /recordings/{name} wants it.")
    time: str = Field(description="Of the fault, the e-stop or the request, ISO 8601 in UTC.")
    reason: Literal["fault", "estop", "request", "continuous"] = Field(description="Why it was made.")
    size: int = Field(description="Bytes.")


class RecordedPoint(BaseModel):
    """Where the arm was."""

    time_s: float = Field(description="From the first cycle on, s.")
    joints: list[float] = Field(description="Measured, rad.")
    velocities: list[float] = Field(description="Measured, rad/s.")
    position: list[float] = Field(description="Of the TCP in the base frame: x, y, z, m.")


class RecordedEvent(BaseModel):
    """What happened."""

    time_s: float = Field(description="As of the points.")
    kind: str = Field(
        description="What has changed: a fault, estop and intervention also say so.",
        json_schema_extra={"enum": [*sorted(EVENT_KINDS)]},
    )
    mode: str = Field(description="Of rtloop, from then on.")
    text: str = Field(description="Why; empty if there is no reason.")


class RecordedPathAnswer(BaseModel):
    """A recording to be looked at."""

    duration_s: float = Field(description="From its first to its last cycle, s.")
    path: list[RecordedPoint] = Field(description="Some of its cycles, evenly.")
    events: list[RecordedEvent] = Field(description="All of them, the oldest first.")


class RecorderAnswer(BaseModel):
    """The process that records."""

    alive: bool = Field(description="Whether it runs.")
    pid: int = Field(description="0: it has not started yet.")
    recording: str = Field(description="What the files of the continuous recording begin with; empty: none.")
    lost: int = Field(description="Cycles that it came too late for; they are in no recording.")
    files: int = Field(description="So many recordings are there.")
    bytes: int = Field(description="And so large they are together.")
    problem: str = Field(description="Why nothing can be recorded; empty while all is well.")


class RecordingsAnswer(BaseModel):
    """What is there."""

    recordings: list[RecordingAnswer] = Field(description="The newest first.")
    recorder: RecorderAnswer | None = Field(description="null: this robot is not recorded.")
    max_bytes: int = Field(description="`recording.max_mb`: beyond it the oldest files go.")
