"""Timed joint trajectories."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, cast

from fastapi import File, Query, Request, Response, UploadFile

from app.api.dependencies import Call, Gone
from app.api.documentation.samples import link
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.jobs import ACCEPTED, Wait
from app.api.schemas.robot import LogAnswer, LogQuery
from app.api.schemas.trajectories import CsvQuery, SendTrajectory, SentAnswer
from app.services.motion.csv_points import read_points
from app.services.motion.trajectories import Options, StartedTrajectory
from app.services.rights.job import JobKind
from cobot import audit
from cobot.access.roles import Role
from cobot.types import Waypoint

router = EndpointRouter(tags=["trajectory"])
SEND: dict[str, Any] = {
    "keyed": True,
    "response_model": SentAnswer,
    "responses": responses(409, 503) | ACCEPTED,
}


@router.endpoint("POST /trajectory/send", Role.OPERATOR, timeout_s=20.0, control=True, **SEND)
async def send_trajectory(
    body: SendTrajectory, request: Request, gone: Gone, wait: Wait = True
) -> SentAnswer | Response:
    """Run a trajectory through timed points. Returns when it has begun."""
    call = Call(request)
    options = Options(body.validate_limits, body.retime, body.move_to_start, body.smoothing_rad)

    def read(check: Callable[[Waypoint], None]) -> list[Waypoint]:
        points = [
            Waypoint(p.positions, p.time_from_start, p.velocities, p.accelerations, f"points[{index}]")
            for index, p in enumerate(body.points)
        ]
        check(points[0])
        return points

    caller = call.caller(gone, JobKind.TRAJECTORY, f"{len(body.points)} points", wait=wait)
    sending = call.services.trajectories.send(read, options, caller)
    return await call.answer_end(caller, sending, _answer)


@router.endpoint("POST /trajectory/send_csv", Role.OPERATOR, timeout_s=60.0, control=True, **SEND)
async def send_csv(
    file: Annotated[
        UploadFile,
        File(
            description=f"A CSV file such as {link('trajectory.csv')}. Header: joint1 ... joint7 or the "
            f"joints' own names, and t. Angles in rad, t in s."
        ),
    ],
    query: Annotated[CsvQuery, Query()],
    request: Request,
    gone: Gone,
) -> SentAnswer | Response:
    """Run a trajectory from a CSV file. Returns when it has begun."""
    call = Call(request)
    options = Options(query.validate_limits, query.retime, query.move_to_start, query.smoothing_rad)
    digest = await asyncio.to_thread(hashlib.file_digest, cast(Any, file.file), "sha256")
    await file.seek(0)
    audit.add_details(file=file.filename or "", bytes=file.size, sha256=digest.hexdigest())
    read = partial(read_points, file.file, query.separator, call.services.robot.limits.names)
    caller = call.caller(gone, JobKind.TRAJECTORY, file.filename or "", wait=query.wait)
    sending = call.services.trajectories.send(read, options, caller)
    return await call.answer_end(caller, sending, _answer)


@router.endpoint("GET /trajectory/logs", Role.OBSERVER, timeout_s=1.5, responses=responses(422))
async def trajectory_logs(query: Annotated[LogQuery, Query()], request: Request) -> LogAnswer:
    """Return the results of trajectories (accepted, arrived, stopped or rejected), with reasons."""
    call = Call(request)
    return LogAnswer(lines=query.lines_of(call.services.trajectories.lines))


def _answer(sent: StartedTrajectory) -> SentAnswer:
    audit.add_details(motion=sent.motion_id)
    changes = sent.changes
    return SentAnswer(
        motion_id=sent.motion_id,
        duration_s=sent.duration_s,
        points=sent.points,
        note=sent.note,
        blended_rad=changes.blended_rad,
        smoothed_rad=changes.smoothed_rad,
        stretch=changes.stretch,
        slowed_s=None if changes.slowed_s is None else list(changes.slowed_s),
    )
