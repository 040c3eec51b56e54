"""Recordings of the robot's state over time, as MCAP files."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from functools import partial
from typing import Annotated, Any

from fastapi import Path, Query, Request, Response
from fastapi.responses import FileResponse

from app.api.costly import costly_turn
from app.api.dependencies import Call
from app.api.errors import responses
from app.api.paging import After, Limit, page_of
from app.api.route import EndpointRouter
from app.api.schemas.recordings import (
    AskedRecordingAnswer,
    AskRecording,
    RecordedEvent,
    RecordedPathAnswer,
    RecordedPoint,
    RecordingsAnswer,
)
from app.services.motion.planning_tasks import read_recorded_path
from cobot import audit
from cobot.access.roles import Role
from cobot.recording.path import RecordedPath

router = EndpointRouter(tags=["recordings"])
MEDIA_TYPE = "application/octet-stream"
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}}}
}
Name = Annotated[str, Path(max_length=200, description="Name of a recording, from GET /recordings.")]
Samples = Annotated[int, Query(ge=2, le=1000, description="Maximum number of cycles.")]


@router.endpoint("GET /recordings", Role.OBSERVER, timeout_s=1.5, responses=responses(422))
async def recordings(request: Request, limit: Limit = None, after: After = None) -> RecordingsAnswer:
    """Return the recordings, and the state of the recorder."""
    service = Call(request).services.recordings
    found = page_of(await asyncio.to_thread(service.all), lambda each: each.name, limit, after)
    status = service.status()
    return RecordingsAnswer.model_validate(
        {
            "recordings": [asdict(each) for each in found],
            "recorder": None if status is None else asdict(status),
            "max_bytes": service.max_bytes,
        }
    )


@router.endpoint("POST /recordings", Role.OPERATOR, timeout_s=120.0, responses=responses(409, 503))
async def record(body: AskRecording, request: Request) -> AskedRecordingAnswer:
    """Write the last seconds to a file, or start or stop a continuous recording.

    For a dump, the answer comes when its file is complete. Faults and e-stops are recorded automatically.
    """
    call = Call(request)
    names = await call.services.recordings.ask(body.action, body.seconds, call.timeout_s)
    audit.add_details(recordings=names)
    return AskedRecordingAnswer(names=names)


@router.endpoint(
    "GET /recordings/{name}",
    Role.OBSERVER,
    timeout_s=1.5,
    response_class=FileResponse,
    responses=responses(404, 422) | FILE,
)
async def recording(name: Name, request: Request) -> FileResponse:
    """Return a recording as an MCAP file, for Foxglove, `rosbags`, `cobot plot` and `cobot replay`."""
    path = await asyncio.to_thread(Call(request).services.recordings.path, name)
    return FileResponse(path, media_type=MEDIA_TYPE, filename=name)


@router.endpoint(
    "GET /recordings/{name}/path",
    Role.OBSERVER,
    timeout_s=60.0,
    response_model=RecordedPathAnswer,
    responses=responses(404, 422, 503),
)
async def recorded_path(name: Name, request: Request, samples: Samples = 200) -> Response:
    """Return the path of the arm in a recording, at a selection of its cycles, and the events."""
    call = Call(request)
    service = call.services.recordings
    path = await asyncio.to_thread(service.path, name)
    async with service.reading:  # so that motions keep most planning processes
        work = partial(read_recorded_path, path=path, samples=samples)
        found = await call.services.planning.compute(work, call.timeout_s)
    async with costly_turn(request):
        content = _answer(found).model_dump_json()
    return Response(content, media_type="application/json")


def _answer(found: RecordedPath) -> RecordedPathAnswer:
    assert found.poses is not None
    columns = (found.times_s, found.joints, found.velocities, found.poses[:, :3])
    names = tuple(RecordedPoint.model_fields)
    return RecordedPathAnswer(
        duration_s=float(found.times_s[-1]),
        path=[
            RecordedPoint.model_validate(dict(zip(names, row, strict=True)))
            for row in zip(*(each.tolist() for each in columns), strict=True)
        ],
        events=[RecordedEvent.model_validate(asdict(event)) for event in found.events],
    )


@router.endpoint("DELETE /recordings/{name}", Role.PROGRAMMER, timeout_s=1.5, responses=responses(404, 422))
async def remove_recording(name: Name, request: Request) -> AskedRecordingAnswer:
    """Delete a recording permanently."""
    await asyncio.to_thread(Call(request).services.recordings.remove, name)
    return AskedRecordingAnswer(names=[name])
