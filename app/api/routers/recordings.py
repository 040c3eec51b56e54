"""Recordings of what the robot did, as MCAP files."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Request
from fastapi.responses import FileResponse

from app.api.dependencies import Call, CobotRoute, json_body
from app.api.errors import responses
from app.api.recording_schemas import AskedRecordingAnswer, AskRecording, RecordingsAnswer
from cobot import audit

router = APIRouter(prefix="/recordings", tags=["recordings"], route_class=CobotRoute)
MEDIA_TYPE = "application/octet-stream"
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}}}
}
Name = Annotated[str, Path(max_length=200, description="One of GET /recordings.")]


@router.get("")
async def recordings(request: Request) -> RecordingsAnswer:
    """The recordings that are there, and how the recorder stands."""
    service = Call(request).services.recordings
    found = await asyncio.to_thread(service.all)
    status = service.status()
    return RecordingsAnswer.model_validate(
        {
            "recordings": [asdict(each) for each in found],
            "recorder": None if status is None else asdict(status),
            "max_bytes": service.max_bytes,
        }
    )


@router.post("", responses=responses(409, 413, 415, 422, 503), dependencies=[Depends(json_body)])
async def record(body: AskRecording, request: Request) -> AskedRecordingAnswer:
    """Write the last seconds to a file, or begin or end a continuous recording.

    A dump answers when its file is whole. Faults and e-stops are recorded without being asked for.
    """
    call = Call(request)
    names = await call.services.recordings.ask(body.action, body.seconds, call.timeout_s)
    audit.add_details(recordings=names)
    return AskedRecordingAnswer(names=names)


@router.get("/{name}", response_class=FileResponse, responses=responses(404, 422) | FILE)
async def recording(name: Name, request: Request) -> FileResponse:
    """One recording: an MCAP file, for Foxglove, `rosbags`, `cobot plot` and `cobot replay`."""
    path = await asyncio.to_thread(Call(request).services.recordings.path, name)
    return FileResponse(path, media_type=MEDIA_TYPE, filename=name)


@router.delete("/{name}", responses=responses(404, 422))
async def remove_recording(name: Name, request: Request) -> AskedRecordingAnswer:
    """Remove a recording for good."""
    await asyncio.to_thread(Call(request).services.recordings.remove, name)
    return AskedRecordingAnswer(names=[name])
