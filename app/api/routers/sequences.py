"""Sequences of motions and Lua programs, each of which runs in a separate process."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import File, Form, Query, Request, Response, UploadFile

from app.api.dependencies import Call
from app.api.documentation.samples import link
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.jobs import ACCEPTED, Wait
from app.api.schemas.robot import LogAnswer, LogQuery, SequenceStatusAnswer, StartedAnswer
from app.services.programs.sequences import SequenceOrder
from cobot import audit
from cobot.access.roles import Role

router = EndpointRouter(tags=["sequences"])


def _text(description: str) -> Any:
    """Read a text field of a form. NUL is not allowed, because it cannot be part of a command line."""
    return Form(max_length=1000, pattern=r"^[^\x00-\x1f\x7f]*$", description=description)


ACTION = "Not used; accepted for compatibility and written to the log."


# Each parameter is a field of the form and of the published schema.
@router.endpoint(
    "POST /sequences/start",
    Role.PROGRAMMER,
    timeout_s=10.0,
    control=True,
    keyed=True,
    response_model=StartedAnswer,
    responses=responses(409, 503) | ACCEPTED,
)
async def start_sequence(
    request: Request,
    config: Annotated[
        UploadFile,
        File(
            description=f"A sequence (JSON) such as {link('sequence.json')}, see docs/sequence-files.md; or "
            f"a program (*.lua) such as {link('program.lua')}, see docs/lua.md."
        ),
    ],
    n_iterations: Annotated[int, Form(ge=1, le=1_000_000, description="Number of iterations.")] = 3,
    delay_between_iterations: Annotated[
        float, Form(ge=0.0, le=86400.0, allow_inf_nan=False, description="Pause between two iterations, s.")
    ] = 5.0,
    from_waypoint: Annotated[
        int | None,
        Form(ge=1, le=100_000, description="Waypoint at which the first iteration starts. Default: home."),
    ] = None,
    bag_path: Annotated[
        str, _text("A new folder below the recordings folder, in which to record; empty: no recording.")
    ] = "",
    topics: Annotated[str, _text("The data to record, separated by commas; empty: all.")] = "",
    hold: Annotated[
        bool, Form(description="Wait before the first motion until the job is resumed or stepped.")
    ] = False,
    joints_action: Annotated[str, _text(ACTION)] = "cobot/move_to_joints",
    pose_action: Annotated[str, _text(ACTION)] = "cobot/move_to_pose",
    wait: Wait = True,
) -> StartedAnswer | Response:
    """Start a sequence or a Lua program. Returns when its process is running. Only one runs at a time."""
    call = Call(request)
    content = await config.read()
    digest = hashlib.sha256(content).hexdigest()
    audit.add_details(file=config.filename or "", bytes=len(content), sha256=digest)
    order = SequenceOrder(
        config=content,
        n_iterations=n_iterations,
        delay_between_iterations_s=delay_between_iterations,
        bag_path=bag_path,
        topics=topics,
        joints_action=joints_action,
        pose_action=pose_action,
        name=config.filename or "",
        from_waypoint=from_waypoint,
        hold=hold,
    )
    return await start_order(call, order, wait=wait)


async def start_order(call: Call, order: SequenceOrder, *, wait: bool) -> StartedAnswer | Response:
    """Start a sequence or program, and answer with its number or, without `wait`, with its job."""
    status = await call.services.sequences.start(order, call.stops)
    assert status.sequence_id is not None
    assert status.pid is not None
    audit.add_details(sequence=status.sequence_id)
    job = call.services.ownership.sequence_job
    if not wait and job is not None:
        return call.answer_accepted(job.record())
    return StartedAnswer(sequence_id=status.sequence_id, pid=status.pid)


@router.endpoint("GET /sequences/status", Role.OBSERVER, timeout_s=1.5)
async def sequence_status(request: Request) -> SequenceStatusAnswer:
    """Return the state of the newest sequence."""
    call = Call(request)
    return SequenceStatusAnswer.model_validate(asdict(call.services.sequences.status))


@router.endpoint("GET /sequences/logs", Role.OBSERVER, timeout_s=1.5, responses=responses(422))
async def sequence_logs(query: Annotated[LogQuery, Query()], request: Request) -> LogAnswer:
    """Return the output of sequences and programs, including ended ones."""
    call = Call(request)
    return LogAnswer(lines=query.lines_of(call.services.sequences.lines))
