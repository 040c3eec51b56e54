"""Stored programs: listing, versions, and running one by name."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from fastapi import Header, Path, Query, Request, Response
from pydantic import BaseModel, Field

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.paging import After, Limit, page_of
from app.api.route import EndpointRouter
from app.api.routers.sequences import start_order
from app.api.schemas.jobs import ACCEPTED, Wait
from app.api.schemas.names import Label
from app.api.schemas.robot import StartedAnswer
from app.services.programs.sequences import SequenceOrder
from app.services.programs.stored import MAX_CHARACTERS, ProgramText, ProgramVersion
from cobot import audit
from cobot.access.roles import Role
from cobot.errors import InputError
from cobot.loose_lists import RequestModel
from cobot.motions.fields import example
from cobot.strict import shown

router = EndpointRouter(tags=["sequences"])
SEQUENCE = '{"waypoints": [{"named": "home"}]}'


Kind = Annotated[Literal["sequence", "lua"], Field(description="A sequence file (JSON) or a Lua program.")]
Id = Annotated[str, Path(max_length=200, description="Id of a stored program: a-z, 0-9, _ and -.")]
IfMatch = Annotated[
    str | None,
    Header(alias="If-Match", description='The version that the client knows, as in `ETag`, such as "3".'),
]


class SaveProgram(RequestModel):
    """A program to store."""

    model_config = example({"label": "Über Kiste 1", "text": SEQUENCE})

    label: Label
    kind: Kind = "sequence"
    text: str = Field(max_length=MAX_CHARACTERS, description="The unchanged file; unknown steps are kept.")
    note: str = Field("", max_length=200, description="Description of this version.")


class RunProgram(RequestModel):
    """Options for running a stored program."""

    model_config = example({"n_iterations": 1})

    n_iterations: int = Field(1, ge=1, le=1_000_000, description="Number of iterations.")
    delay_between_iterations: float = Field(
        0.0, ge=0.0, le=86400.0, allow_inf_nan=False, description="Pause between two iterations, s."
    )
    from_waypoint: int | None = Field(
        None, ge=1, le=100_000, description="Waypoint at which the first iteration starts. Default: home."
    )
    hold: bool = Field(False, description="Wait before the first motion until the job is resumed or stepped.")
    version: int | None = Field(
        None, ge=1, le=999_999_999, description="Version to run. Default: the newest."
    )


class StoredProgramAnswer(BaseModel):
    """A version of a stored program, without its text."""

    id: str = Field(description="Id of the program, used in paths.")
    label: str = Field(description="Displayed name.")
    kind: Kind
    version: int = Field(description="Number of the version, from 1.")
    author: str = Field(
        description="The client that saved it: the name of its token, or in quotes a name that was not "
        "verified."
    )
    time: str = Field(description="Time of saving, ISO 8601, UTC.")
    note: str = Field(description="Description of this version.")
    example: bool = Field(
        description="true: an example of the robot's cell, which can be run and copied, but not changed."
    )


class StoredTextAnswer(StoredProgramAnswer):
    """A version of a stored program."""

    text: str = Field(description="The file as it was saved.")


@router.endpoint("GET /programs", Role.OBSERVER, timeout_s=5.0, responses=responses(422))
async def programs(request: Request, limit: Limit = None, after: After = None) -> list[StoredProgramAnswer]:
    """Return the newest version of each stored program, and the examples of a simulated cell."""
    found = await Call(request).services.stored.all()
    return [_answer(each) for each in page_of(found, lambda each: each.id, limit, after)]


@router.endpoint("GET /programs/{program}", Role.OBSERVER, timeout_s=5.0, responses=responses(404, 422, 503))
async def program(
    program: Id,
    request: Request,
    response: Response,
    version: Annotated[
        int | None, Query(ge=1, le=999_999_999, description="Version to read. Default: the newest.")
    ] = None,
) -> StoredTextAnswer:
    """Return a stored program. `ETag` is its version, for `If-Match` when it is saved."""
    found = await Call(request).services.stored.read(program, version)
    response.headers["ETag"] = _tag(found)
    return _with_text(found)


@router.endpoint(
    "GET /programs/{program}/versions", Role.OBSERVER, timeout_s=5.0, responses=responses(404, 422, 503)
)
async def program_versions(
    program: Id, request: Request, limit: Limit = None, after: After = None
) -> list[StoredProgramAnswer]:
    """Return all kept versions of a stored program, the newest first."""
    found = await Call(request).services.stored.versions(program)
    return [_answer(each) for each in page_of(found, lambda each: str(each.version), limit, after)]


@router.endpoint(
    "PUT /programs/{program}", Role.PROGRAMMER, timeout_s=10.0, responses=responses(409, 412, 503)
)
async def save_program(
    program: Id, body: SaveProgram, request: Request, response: Response, if_match: IfMatch = None
) -> StoredProgramAnswer:
    """Save a version. `If-Match` names the version that was changed; omit it for a new program."""
    saved = ProgramText(body.label, body.kind, body.text, body.note)
    made = await Call(request).services.stored.save(program, saved, _version_of(if_match))
    audit.add_details(program=made.id, version=made.version)
    response.headers["ETag"] = _tag(made)
    return _answer(made)


@router.endpoint(
    "DELETE /programs/{program}",
    Role.PROGRAMMER,
    timeout_s=10.0,
    responses=responses(404, 409, 412, 422, 503),
)
async def delete_program(
    program: Id, request: Request, if_match: IfMatch = None
) -> list[StoredProgramAnswer]:
    """Delete a stored program with all its versions. Returns the remaining programs."""
    stored = Call(request).services.stored
    await stored.delete(program, _version_of(if_match))
    return [_answer(each) for each in await stored.all()]


@router.endpoint(
    "POST /programs/{program}/run",
    Role.OPERATOR,
    timeout_s=10.0,
    control=True,
    keyed=True,
    response_model=StartedAnswer,
    responses=responses(404, 409, 503) | ACCEPTED,
)
async def run_program(
    program: Id, body: RunProgram, request: Request, wait: Wait = True
) -> StartedAnswer | Response:
    """Run a stored program. Returns when its process is running. Only one program runs at a time."""
    call = Call(request)
    found = await call.services.stored.read(program, body.version)
    audit.add_details(program=found.id, version=found.version)
    order = SequenceOrder(
        config=found.saved.text.encode(),
        n_iterations=body.n_iterations,
        delay_between_iterations_s=body.delay_between_iterations,
        name=found.file_name,
        from_waypoint=body.from_waypoint,
        hold=body.hold,
    )
    return await start_order(call, order, wait=wait)


def _version_of(if_match: str | None) -> int | None:
    if if_match is None:
        return None
    found = re.fullmatch(r'(?:W/)?"([0-9]{1,9})"', if_match.strip())
    if not found:
        raise InputError(f'If-Match: {shown(if_match)} is not the ETag of a program; an ETag looks like "3"')
    return int(found[1])


def _tag(of: ProgramVersion) -> str:
    return f'"{of.version}"'


def _fields(of: ProgramVersion) -> dict[str, object]:
    saved = of.saved
    return {
        "id": of.id,
        "label": saved.label,
        "kind": saved.kind,
        "version": of.version,
        "author": of.author,
        "time": of.time,
        "note": saved.note,
        "example": of.example,
    }


def _answer(of: ProgramVersion) -> StoredProgramAnswer:
    return StoredProgramAnswer.model_validate(_fields(of))


def _with_text(of: ProgramVersion) -> StoredTextAnswer:
    return StoredTextAnswer.model_validate(_fields(of) | {"text": of.saved.text})
