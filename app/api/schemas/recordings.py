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
        description="dump: write the newest seconds in memory to a file; start, stop: begin or "
        "end a continuous recording.",
    )
    seconds: Annotated[float, Field(gt=0.0, le=600.0, allow_inf_nan=False)] | None = Field(
        None,
        description="Length of a dump, s; at most the length that is in memory. Default: "
        "`recording.before_s`.",
    )


class AskedRecordingAnswer(BaseModel):
    """The result of a request about recordings."""

    names: list[str] = Field(
        description="Names of the complete files; after `start`: the prefix of the file names."
    )


class RecordingAnswer(BaseModel):
    """A recorded file."""

    name: str = Field(description="Name for GET /recordings/{name}.")
    time: str = Field(description="Time of the fault, the e-stop or the request, ISO 8601 in UTC.")
    reason: Literal["fault", "estop", "request", "continuous"] = Field(
        description="Reason for the recording."
    )
    size: int = Field(description="Size of the file, bytes.")


class RecordedPoint(BaseModel):
    """The arm at one cycle of a recording."""

    time_s: float = Field(description="Time since the first cycle, s.")
    joints: list[float] = Field(description="Measured joint angles, rad.")
    velocities: list[float] = Field(description="Measured joint velocities, rad/s.")
    position: list[float] = Field(description="Position of the TCP in the base frame: x, y, z, m.")


class RecordedEvent(BaseModel):
    """An event in a recording."""

    time_s: float = Field(description="Time since the first cycle, s.")
    kind: str = Field(
        description="Kind of the change. A fault, an e-stop and an intervention have kinds of their own.",
        json_schema_extra={"enum": [*sorted(EVENT_KINDS)]},
    )
    mode: str = Field(description="Mode of the real-time loop from then on.")
    text: str = Field(description="The reason; empty without one.")


class RecordedPathAnswer(BaseModel):
    """The path of a recording."""

    duration_s: float = Field(description="Duration from the first to the last cycle, s.")
    path: list[RecordedPoint] = Field(description="A selection of cycles, evenly spaced.")
    events: list[RecordedEvent] = Field(description="All events, the oldest first.")


class RecorderAnswer(BaseModel):
    """The process that records."""

    alive: bool = Field(description="Whether the process is running.")
    pid: int = Field(description="Process id; 0: the process has not started yet.")
    recording: str = Field(
        description="Prefix of the file names of the continuous recording; empty: there is none."
    )
    lost: int = Field(description="Number of cycles that the process missed; no recording has them.")
    files: int = Field(description="Number of recordings.")
    bytes: int = Field(description="Total size of the recordings in bytes.")
    problem: str = Field(description="Reason why nothing can be recorded; empty: no problem.")


class RecordingsAnswer(BaseModel):
    """The recordings, and the recorder."""

    recordings: list[RecordingAnswer] = Field(description="The recordings, the newest first.")
    recorder: RecorderAnswer | None = Field(description="The recorder; null: this robot is not recorded.")
    max_bytes: int = Field(
        description="Maximum total size (`recording.max_mb`); above it the oldest files are deleted."
    )
