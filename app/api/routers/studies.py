"""Studies: questions about the robot that need thousands of computations, which run in a separate process."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

from fastapi import Path, Request
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.paging import After, Limit, page_of
from app.api.route import EndpointRouter
from app.services.programs.study_files import MAP, TABLES, StudyStatus
from cobot import audit
from cobot.access.roles import Role
from cobot.errors import InputError
from cobot.loose_lists import RequestModel
from cobot.motions.fields import example
from cobot.strict import shown

router = EndpointRouter(tags=["studies"])
BOX = {"low": [0.3, -0.3, 0.2], "high": [0.7, 0.3, 0.6]}
TABLE: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}
}
Id = Annotated[str, Path(max_length=200, description="Id of a study: 12 hexadecimal digits.")]
Part = dict[str, Any]


class StartStudy(RequestModel):
    """A study, as in a study file but without files and functions. The process that computes it checks the
    keys.
    """

    model_config = example(
        {
            "question": "Which places does the arm reach?",
            "kind": "reach",
            "space": {"box": BOX, "spacing_m": 0.2},
        }
    )

    question: str = Field(min_length=1, max_length=500, description="The question in words.")
    kind: Literal["reach", "placement", "cycle", "robustness", "compare"] = Field(
        description="Kind of the study; each kind has its own keys."
    )
    seed: int | None = Field(None, ge=0, lt=2**63, description="Seed of all random numbers. Default: 0.")
    metric: str | None = Field(None, max_length=100, description="The metric that decides the answer.")
    robot: Part | None = Field(
        None, description="Additional objects, and a tool to use in place of the current one."
    )
    space: Part | None = Field(None, description="Places or parameters.")
    targets: Part | None = Field(None, description="For placement: the places that the arm must reach.")
    method: str | None = Field(None, max_length=100, description="For reach: ik, free or lin.")
    approach: Any = Field(None, description="Directions of the TCP's z axis.")
    spins: int | None = Field(None, description="Number of turns about each direction.")
    start: str | list[float] | None = Field(
        None, description="For the method lin: the start of the line, a named position or joint positions."
    )
    program: list[Part] | Part | None = Field(
        None, description='Moves, or `{"stored": ID, "moves": {...}}` of a stored program.'
    )
    orders: list[list[int]] | None = Field(
        None, description="For cycle: groups of moves whose order is free."
    )
    samples: int | None = Field(None, description="Number of samples of the random parameters.")
    design: str | None = Field(
        None, max_length=100, description="For robustness: distribution of the samples."
    )
    goal: str | None = Field(
        None, max_length=100, description="Whether a large or a small metric is better: max or min."
    )
    confidence: float | None = Field(None, description="For robustness: confidence level of the intervals.")
    search: Part | None = Field(None, description="A search with Optuna.")
    study: Part | None = Field(None, description="For compare: the part common to all variants.")
    variants: dict[str, Part] | None = Field(None, description="For compare: the variants by name.")
    max_s: float = Field(
        3600.0, gt=0.0, le=86400.0, allow_inf_nan=False, description="Maximum duration of this run, s."
    )


class BestPlacement(BaseModel):
    """The best placement. A pose is x, y, z in m and a quaternion w, x, y, z."""

    base: list[float] = Field(description="Pose of the base in the current base frame.")
    tcp: list[float] = Field(description="Pose of the TCP in the frame of the flange.")


class StudyAnswer(BaseModel):
    """A study."""

    id: str = Field(description="Id: a hash of the question, the robot, its tool and its scene.")
    question: str = Field(description="The question in words.")
    kind: str = Field(description="Kind of the study.")
    state: Literal["running", "finished", "partial", "failed"] = Field(
        description="A partial study continues when the same study is started again."
    )
    reason: str = Field(
        description="Reason why the study is not finished. Empty while it is running and after it has "
        "finished."
    )
    tasks: int = Field(description="Number of tasks.")
    done: int = Field(description="Number of tasks that are done.")
    rate_hz: float = Field(description="Tasks per second of the current run.")
    left_s: float | None = Field(description="Estimated remaining time, s; null while it is unknown.")
    answer: dict[str, Any] = Field(description="The answer from the results so far, by displayed names.")
    placement: BestPlacement | None = Field(
        description="The best placement; only for a completed study of the kind placement."
    )
    maps: bool = Field(description="Whether the study has a map: GET /studies/{study}/map.")
    job: str = Field(description="The job of the study's last run: POST /jobs/{job}/cancel ends it.")
    owner: str = Field(description="The client that started it.")
    started_at: str = Field(description="Start of the last run, ISO 8601, UTC.")
    document: dict[str, Any] = Field(description="The requested study.")


class StudiesAnswer(BaseModel):
    """The studies of a robot."""

    studies: list[StudyAnswer] = Field(description="The studies, the newest first.")


class StudyMap(BaseModel):
    """Places with their results, for a map. The lists have one item per place."""

    x: list[float] = Field(description="x of each place in the base frame, m.")
    y: list[float] = Field(description="y of each place in the base frame, m.")
    z: list[float] = Field(description="z of each place in the base frame, m.")
    values: dict[str, list[float | None]] = Field(
        description="Values of each metric; null where a place is not reached."
    )
    ranges: dict[str, list[float]] = Field(description="Lowest and highest value of each metric's scale.")
    scale: list[list[float]] = Field(description="Evenly spaced colours of the scale, RGB, 0 to 255.")
    spacing: float = Field(description="Distance between neighbouring places, m.")
    metrics: list[str] = Field(description="The metrics, the chosen one first.")
    every: int = Field(description="The map shows every Nth place of the study; 1: all of them.")


@router.endpoint("GET /studies", Role.OBSERVER, timeout_s=5.0, responses=responses(422))
async def studies(request: Request, limit: Limit = None, after: After = None) -> StudiesAnswer:
    """Return the studies of the robot. A running study has its partial answer."""
    found = page_of(await Call(request).services.studies.all(), lambda each: each.id, limit, after)
    return StudiesAnswer(studies=[_answer(each) for each in found])


@router.endpoint("POST /studies", Role.PROGRAMMER, timeout_s=60.0, responses=responses(404, 409, 501, 503))
async def start_study(body: StartStudy, request: Request) -> StudyAnswer:
    """Start a study in a process of the lowest priority, or continue it. Returns once its tasks are known.

    It uses the service's robot, scene, tool and positions as they are now. One study runs at a time.
    """
    call = Call(request)
    document = body.model_dump(exclude_unset=True, exclude={"max_s"})
    stored = None
    if isinstance(body.program, dict):
        name = body.program.get("stored")
        if not isinstance(name, str):
            raise InputError(f"program.stored: must be the id of a stored program, got {shown(name)}")
        found = await call.services.stored.read(name)
        if found.saved.kind != "sequence":
            raise InputError(f"program.stored: {name} is a Lua program; a study takes sequences")
        stored = (found.saved.text, found.file_name)
    status = await call.services.studies.start(document, stored, body.max_s, call.timeout_s)
    audit.add_details(study=status.id, job=status.job)
    return _answer(status)


@router.endpoint("GET /studies/{study}", Role.OBSERVER, timeout_s=5.0, responses=responses(404, 422))
async def study(study: Id, request: Request) -> StudyAnswer:
    """Return a study. Its answer is partial while the study is running."""
    return _answer(await Call(request).services.studies.read(study))


@router.endpoint(
    "GET /studies/{study}/map",
    Role.OBSERVER,
    timeout_s=5.0,
    response_class=FileResponse,
    responses=responses(404, 422) | {200: {"model": StudyMap}},
)
async def study_map(study: Id, request: Request) -> FileResponse:
    """Return the map of a reach study, with at most 20000 places."""
    path = await Call(request).services.studies.file(study, MAP)
    return FileResponse(path, media_type="application/json")


@router.endpoint(
    "GET /studies/{study}/table",
    Role.OBSERVER,
    timeout_s=5.0,
    response_class=FileResponse,
    responses=responses(404, 422) | TABLE,
)
async def study_table(study: Id, request: Request) -> FileResponse:
    """Return all results of a run as a SQLite or Parquet file with one row per task, once the run has
    ended.
    """
    path = await Call(request).services.studies.file(study, *TABLES)
    name = f"{study}-{path.name}"
    return FileResponse(path, media_type="application/octet-stream", filename=name)


@router.endpoint(
    "DELETE /studies/{study}", Role.PROGRAMMER, timeout_s=10.0, responses=responses(404, 409, 422, 503)
)
async def delete_study(study: Id, request: Request) -> StudiesAnswer:
    """Delete a study with its results. Returns the remaining studies."""
    service = Call(request).services.studies
    await service.delete(study)
    return StudiesAnswer(studies=[_answer(each) for each in await service.all()])


def _answer(status: StudyStatus) -> StudyAnswer:
    return StudyAnswer.model_validate(asdict(status))
