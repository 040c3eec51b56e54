"""Motions with force: press, follow, search, insert."""

from __future__ import annotations

from typing import Any

from fastapi import Request, Response
from pydantic import BaseModel, Field

from app.api.dependencies import Call, Gone
from app.api.errors import ErrorCode, responses
from app.api.motions.goals import goal_of
from app.api.motions.signals import input_condition
from app.api.route import EndpointRouter
from app.api.schemas.explain import Details, Explain, explain_of
from app.api.schemas.jobs import ACCEPTED, Wait
from app.services.rights.job import JobKind
from app.services.streaming.force_run import ForceOutcome
from cobot import audit
from cobot.access.roles import Role
from cobot.motions.fields import example
from cobot.motions.force_bodies import AnyForceMotion, FollowMotion, InsertMotion, PressMotion, SearchMotion
from cobot.pose import Pose

DONE = "The motion with force has reached its end"


class TcpPose(BaseModel):
    """A pose of the TCP in the base frame: m, and KUKA angles in rad."""

    x: float = Field(description="m")
    y: float = Field(description="m")
    z: float = Field(description="m")
    a: float = Field(description="KUKA angle A about z, rad")
    b: float = Field(description="KUKA angle B about the new y, rad")
    c: float = Field(description="KUKA angle C about the newest x, rad")

    @classmethod
    def of(cls, pose: Pose) -> TcpPose:
        x, y, z = pose.position.tolist()
        a, b, c = pose.abc
        return cls(x=x, y=y, z=z, a=float(a), b=float(b), c=float(c))


class PushContact(BaseModel):
    """The first contact of the TCP."""

    pose: TcpPose = Field(description="Pose of the TCP when it touched.")
    distance_m: float = Field(description="Distance from the start along the push, m.")
    force_n: float = Field(description="Force at the first contact, N.")


class ForceAnswer(BaseModel):
    """How a force motion ended. Forces are along the push direction."""

    model_config = example(
        {
            "success": True,
            "message": DONE,
            "code": None,
            "stopped_by": "duration",
            "contact": {
                "pose": {"x": 0.5, "y": 0.0, "z": 0.2, "a": 0.0, "b": 3.1416, "c": 0.0},
                "distance_m": 0.021,
                "force_n": 5.2,
            },
            "force_n": 10.0,
            "max_force_n": 10.8,
            "pose": {"x": 0.5, "y": 0.0, "z": 0.2, "a": 0.0, "b": 3.1416, "c": 0.0},
            "distance_m": 0.021,
            "duration_s": 3.4,
            "explain": None,
        }
    )

    success: bool = Field(
        description="Whether the motion reached the requested end. Also true if the "
        "request allows other ends."
    )
    message: str = Field(description="The reason, if `success` is false.")
    code: ErrorCode | None = Field(description="A stable word for the reason, null on success.")
    stopped_by: str = Field(
        description="duration (press), path_end (follow), drop or target (search), depth (insert); or the "
        "limit that was reached first: max_distance, max_time, max_deviation, pattern_end, "
        "force (insert: the part does not advance), let_go; or the code of an error."
    )
    contact: PushContact | None = Field(description="The first contact; null: there was none.")
    force_n: float | None = Field(
        description="Mean force while the force was held, N; null if it was not held."
    )
    max_force_n: float = Field(description="Largest force, N.")
    pose: TcpPose | None = Field(description="Pose of the TCP at the end.")
    distance_m: float = Field(description="Distance of the TCP from its start along the push, m.")
    duration_s: float = Field(description="s")
    explain: Explain | None = Field(None, description="What to change, if known.")
    details: Details = None


FORCE: dict[str, Any] = {
    "keyed": True,
    "response_model": ForceAnswer,
    "responses": responses(409, 501, 503) | ACCEPTED,
}

Answer = ForceAnswer | Response

router = EndpointRouter(tags=["force"])


@router.endpoint("POST /robot/force/press", Role.OPERATOR, timeout_s=60.0, control=True, **FORCE)
async def press(body: PressMotion, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Approach until the TCP touches something, then hold a force for a given time."""
    return await _run(body, request, gone, wait)


@router.endpoint("POST /robot/force/follow", Role.OPERATOR, timeout_s=90.0, control=True, **FORCE)
async def follow(body: FollowMotion, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Approach until the TCP touches something, then move along a path and hold the force, for example to
    polish.
    """
    return await _run(body, request, gone, wait)


@router.endpoint("POST /robot/force/search", Role.OPERATOR, timeout_s=90.0, control=True, **FORCE)
async def search(body: SearchMotion, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Approach until the TCP touches something, then search along a pattern, in contact, for a hole or an
    edge.
    """
    return await _run(body, request, gone, wait)


@router.endpoint("POST /robot/force/insert", Role.OPERATOR, timeout_s=90.0, control=True, **FORCE)
async def insert(body: InsertMotion, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Search for a hole, then push a part into it compliantly, to a given depth."""
    return await _run(body, request, gone, wait)


async def _run(body: AnyForceMotion, request: Request, gone: Gone, wait: bool) -> Answer:
    call = Call(request)
    services = call.services
    caller = call.caller(gone, JobKind.FORCE, body, wait=wait)
    goal = goal_of(body.motion, services) if isinstance(body, FollowMotion) else None
    until = None
    if isinstance(body, SearchMotion) and body.until is not None:
        until = input_condition(services, "until", body.until)
    work = services.force_motions.run(body, goal, caller, until)
    return await call.answer_end(caller, work, _answer)


def _answer(outcome: ForceOutcome) -> ForceAnswer:
    error, contact = outcome.error, outcome.contact
    audit.add_details(stopped_by=outcome.stopped_by, error=str(error or ""))
    return ForceAnswer(
        success=error is None,
        message=DONE if error is None else str(error),
        code=None if error is None else error.code,
        stopped_by=outcome.stopped_by,
        contact=None
        if contact is None
        else PushContact(
            pose=TcpPose.of(contact.pose), distance_m=contact.distance_m, force_n=contact.force_n
        ),
        force_n=outcome.force_n,
        max_force_n=outcome.max_force_n,
        pose=None if outcome.pose is None else TcpPose.of(outcome.pose),
        distance_m=outcome.distance_m,
        duration_s=outcome.duration_s,
        explain=None if error is None else explain_of(error),
        details=None if error is None else dict(error.details),
    )
