"""Motions as jobs: listing, cancelling and pausing them; and the speed override."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import Path, Query, Request, Response

from app.api.costly import costly_turn
from app.api.dependencies import Call, addressed, kept_body
from app.api.errors import responses
from app.api.motions.goals import goal_of
from app.api.paging import deprecated_value, page_of
from app.api.route import EndpointRouter
from app.api.schemas.jobs import (
    JobAnswer,
    JobQuery,
    JobsAnswer,
    JobsQuery,
    NewGoal,
    RetargetAnswer,
    SpeedOverrideAnswer,
    SpeedOverrideBody,
    job_answer,
)
from app.services.rights.job import JobRecord, JobState
from app.services.rights.job_book import KEPT
from cobot import audit
from cobot.access.roles import Role

ANSWER_S = 1.0
"""Part of an endpoint's timeout reserved for the answer, s."""
FEW = 50
"""Maximum number of jobs that are rendered at once, which takes a few milliseconds."""
CHANGED = responses(404, 409, 422, 503)

router = EndpointRouter(tags=["jobs"])
AtWaypoint = Annotated[
    int | None, Query(ge=0, description="For a sequence: waypoint to pause at; 0: the next one.")
]
Waypoint = Annotated[int | None, Query(ge=1, description="For a sequence: waypoint to continue from.")]
Id = Annotated[str, Path(max_length=100, description="Id of a job.")]


@router.endpoint(
    "GET /jobs", Role.OBSERVER, timeout_s=1.5, response_model=JobsAnswer, responses=responses(422)
)
async def jobs(query: Annotated[JobsQuery, Query()], request: Request) -> Response:
    """Return the active jobs, and the newest ended ones.

    Without a robot name, the answer has the jobs of all robots.
    """
    states = frozenset(query.state or JobState)
    paged = query.limit is not None or query.after is not None
    count = KEPT if paged else deprecated_value(query, "n")
    records = newest_jobs(request, count, states)
    if paged:
        records = page_of(records, lambda each: each.id, query.limit or FEW, query.after)
    if len(records) <= FEW:
        return _shown([job_answer(record) for record in records])
    answers: list[JobAnswer] = []
    async with costly_turn(request):
        for record in records:
            answers.append(job_answer(record))
            if len(answers) % FEW == 0:
                await asyncio.sleep(0)
        return _shown(answers)


def newest_jobs(
    request: Request, count: int, states: frozenset[JobState] = frozenset(JobState)
) -> list[JobRecord]:
    """Return the active jobs and the newest ended ones, at most `count` per robot."""
    found = [each.jobs.book.records(count, states) for each in addressed(request).values()]
    return [record for each in found for record in each]


def _shown(answers: list[JobAnswer]) -> Response:
    return Response(JobsAnswer(jobs=answers).model_dump_json(), media_type="application/json")


@router.endpoint("GET /jobs/{job}", Role.OBSERVER, timeout_s=60.0, responses=responses(404, 422))
async def job(job: Id, query: Annotated[JobQuery, Query()], request: Request) -> JobAnswer:
    """Return a job. With `wait_s`, the answer comes when the job has ended or the time is over."""
    call = Call(request)
    return job_answer(await call.services.jobs.wait(job, min(query.wait_s, call.timeout_s)))


@router.endpoint("POST /jobs/{job}/cancel", Role.OPERATOR, timeout_s=10.0, responses=CHANGED)
async def cancel_job(job: Id, request: Request) -> JobAnswer:
    """Cancel a job of any client: the arm stops on its path. Returns when it is at rest."""
    call = Call(request)
    audit.add_details(job=job)
    return job_answer(await call.services.jobs.cancel(job, max(call.timeout_s - ANSWER_S, ANSWER_S)))


@router.endpoint(
    "POST /jobs/{job}/pause", Role.OPERATOR, timeout_s=5.0, responses=responses(404, 409, 422, 501, 503)
)
async def pause_job(job: Id, request: Request, at_waypoint: AtWaypoint = None) -> JobAnswer:
    """Pause a job: the arm stops on its path and waits. Returns when it is at rest.

    With `at_waypoint`, a sequence or program first continues to that waypoint, and the answer comes at once.
    """
    services = Call(request).services
    audit.add_details(job=job)
    return job_answer(await services.jobs.pause(job, at_waypoint))


@router.endpoint("POST /jobs/{job}/resume", Role.OPERATOR, timeout_s=5.0, control=True, responses=CHANGED)
async def resume_job(job: Id, request: Request, waypoint: Waypoint = None) -> JobAnswer:
    """Resume a paused job. A sequence that is waiting at a waypoint can continue from any `waypoint`."""
    services = Call(request).services
    audit.add_details(job=job)
    return job_answer(await services.jobs.resume(job, waypoint))


@router.endpoint("POST /jobs/{job}/step", Role.OPERATOR, timeout_s=5.0, control=True, responses=CHANGED)
async def step_job(job: Id, request: Request) -> JobAnswer:
    """Continue a paused sequence or program for one more motion."""
    services = Call(request).services
    audit.add_details(job=job)
    return job_answer(await services.jobs.step(job))


@router.endpoint(
    "POST /jobs/{job}/retarget",
    Role.OPERATOR,
    timeout_s=20.0,
    control=True,
    responses=responses(404, 409, 501, 503),
)
async def retarget_job(job: Id, body: NewGoal, request: Request) -> RetargetAnswer:
    """Change the goal of a running motion, without a stop. If that is impossible, the motion continues
    unchanged.

    The body is that of a motion to a named position, to joint angles or to a pose. The arm leaves its path at
    a place ahead, with continuous accelerations. The whole path is checked for limits and collisions first.
    """
    call = Call(request)
    services = call.services
    audit.add_details(job=job)
    running = services.jobs.going(job)
    goal = goal_of(body.root, services)
    found = await services.retargeting.retarget(running, goal, call.timeout_s - ANSWER_S)
    running.change_goal(request.scope["path"], *kept_body(body))
    return RetargetAnswer(
        job=job,
        motion_id=found.motion_id,
        change_in_s=found.change_in_s,
        settled_in_s=found.settled_in_s,
        joints=found.joints.tolist(),
        duration_s=found.duration_s,
        planning_time_s=found.planning_s,
        note=found.note,
    )


@router.endpoint("GET /robot/speed_override", Role.OBSERVER, timeout_s=1.5)
async def speed_override(request: Request) -> SpeedOverrideAnswer:
    """Return the speed override, which determines how fast motions run along their paths."""
    return SpeedOverrideAnswer(fraction=Call(request).services.ownership.speed_fraction)


@router.endpoint(
    "POST /robot/speed_override",
    Role.OPERATOR,
    timeout_s=5.0,
    control=True,
    responses=responses(409, 501, 503),
)
async def set_speed_override(body: SpeedOverrideBody, request: Request) -> SpeedOverrideAnswer:
    """Set the speed override, for the current motion and all later ones. The change is jerk-limited.

    Rejected while another client is moving the arm or has control, and during a streaming session. A value
    that a program or the holder of a lease has set ends with the program or the lease.
    """
    ownership = Call(request).services.ownership
    await ownership.set_speed_fraction(body.fraction)
    return SpeedOverrideAnswer(fraction=ownership.speed_fraction)
