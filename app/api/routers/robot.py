"""The arm's state and motion."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np
from fastapi import Query, Request, Response
from fastapi.responses import JSONResponse

from app.api.dependencies import Call, Gone
from app.api.errors import responses
from app.api.motions.goals import goal_of
from app.api.route import EndpointRouter
from app.api.schemas.device import Acknowledge, AcknowledgeAnswer
from app.api.schemas.explain import explain_of
from app.api.schemas.jobs import ACCEPTED, MoveQuery
from app.api.schemas.plan_answers import PlanningAnswer
from app.api.schemas.robot import (
    Angles,
    JointStates,
    MoveAnswer,
    Orientation,
    PoseAnswer,
    Position,
    Quaternion,
    ResetAnswer,
)
from app.api.schemas.signals import ActionAnswer, ContactAnswer
from app.api.state_json import StateAnswer, state_response
from app.services.motion.moves import Outcome
from app.services.motion.queue.moves import queue_request
from app.services.rights.job import JobKind
from app.services.state.first_contact import acknowledge_contact
from cobot import audit
from cobot.access.roles import Role
from cobot.errors import InputError
from cobot.motions.bodies import AnyMotion, MoveArc, MoveJoints, MoveNamed, MovePose, MoveSequence
from cobot.orientations import kuka_angles

How = Annotated[MoveQuery, Query()]
COMPLETED = "Motion completed successfully"
MOTION: dict[str, Any] = {
    "keyed": True,
    "response_model": MoveAnswer,
    "responses": responses(409, 501, 503) | ACCEPTED,
}

router = EndpointRouter(tags=["robot"])


@router.endpoint("GET /robot/joint_states", Role.OBSERVER, timeout_s=1.5, responses=responses(503))
async def joint_states(request: Request) -> JointStates:
    """Return the measured joint angles, velocities and efforts."""
    call = Call(request)
    state = await call.services.link.await_measured_state(call.timeout_s)
    return JointStates(
        name=list(call.services.robot.limits.names),
        position=state.position.tolist(),
        velocity=state.velocity.tolist(),
        effort=state.effort.tolist(),
    )


@router.endpoint("GET /robot/pose", Role.OBSERVER, timeout_s=1.5, responses=responses(503))
async def pose(request: Request) -> PoseAnswer:
    """Return the pose of the TCP in the base frame."""
    call = Call(request)
    state = await call.services.link.await_measured_state(call.timeout_s)
    x, y, z, qw, qx, qy, qz = state.tcp.tolist()
    a, b, c = kuka_angles(state.tcp[3:].tolist())
    return PoseAnswer(
        position=Position(x=x, y=y, z=z),
        orientation=Orientation(
            quaternion=Quaternion(x=qx, y=qy, z=qz, w=qw),
            euler_rad=Angles(a=a, b=b, c=c),
            euler_deg=Angles(a=np.degrees(a), b=np.degrees(b), c=np.degrees(c)),
        ),
        frame_id=call.services.robot.base_frame,
    )


@router.endpoint(
    "GET /robot/state", Role.OBSERVER, timeout_s=1.5, response_model=StateAnswer, responses=responses(503)
)
async def state(request: Request) -> Response:
    """Return the complete state, which the real-time loop publishes in each cycle. It is available even if
    the robot cannot be read.
    """
    call = Call(request)
    return state_response((await call.services.link.await_fresh_state(call.timeout_s)).record)


@router.endpoint("POST /robot/move/named", Role.OPERATOR, timeout_s=60.0, control=True, **MOTION)
async def move_named(body: MoveNamed, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Move to a named position. Returns when the arm has arrived and settled."""
    return await _move(Call(request), body, gone, how)


@router.endpoint("POST /robot/move/joints", Role.OPERATOR, timeout_s=60.0, control=True, **MOTION)
async def move_joints(body: MoveJoints, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Move to joint angles. Returns when the arm has arrived and settled."""
    return await _move(Call(request), body, gone, how)


@router.endpoint("POST /robot/move/pose", Role.OPERATOR, timeout_s=60.0, control=True, **MOTION)
async def move_pose(body: MovePose, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Move the TCP to a pose. Returns when the arm has arrived and settled."""
    return await _move(Call(request), body, gone, how)


@router.endpoint("POST /robot/move/arc", Role.OPERATOR, timeout_s=60.0, control=True, **MOTION)
async def move_arc(body: MoveArc, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Turn the TCP about an axis by an angle. Returns when the arm has arrived and settled."""
    return await _move(Call(request), body, gone, how)


@router.endpoint("POST /robot/move/sequence", Role.OPERATOR, timeout_s=600.0, control=True, **MOTION)
async def move_sequence(body: MoveSequence, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Run several motions as one, with blends between them. Returns when the arm has arrived and settled."""
    return await _move(Call(request), body, gone, how)


@router.endpoint("POST /robot/reset", Role.OPERATOR, timeout_s=25.0, responses=responses(409, 503))
async def reset(request: Request) -> ResetAnswer:
    """Leave an e-stop or a fault once its cause has been removed. Nothing moves. A running sequence ends."""
    call = Call(request)
    await call.services.stopping.reset(call.timeout_s)
    return ResetAnswer(success=True, message="the robot is ready to move")


@router.endpoint(
    "POST /robot/acknowledge", Role.OPERATOR, timeout_s=5.0, control=True, responses=responses(409, 503)
)
async def acknowledge(body: Acknowledge, request: Request) -> AcknowledgeAnswer:
    """Confirm that a person has checked the findings of the first contact against the arm.

    After this, the arm moves at full speed and accepts streaming sessions. If there is nothing to
    acknowledge, nothing changes.
    """
    services = Call(request).services
    found = await acknowledge_contact(services.link, payload_checked=body.payload_checked)
    message = "acknowledged: the robot moves at full speed" if found else "there was nothing to acknowledge"
    audit.add_details(message=message, payload_checked=body.payload_checked)
    return AcknowledgeAnswer(success=True, message=message, found=found)


async def _move(
    call: Call, body: AnyMotion | MoveSequence, gone: asyncio.Event, how: MoveQuery
) -> MoveAnswer | JSONResponse:
    """Execute one or several motions, immediately or from the queue, and answer with their result."""
    services, several = call.services, isinstance(body, MoveSequence)
    motions, radii_m = (body.motions, body.radii) if isinstance(body, MoveSequence) else ([body], [])
    goals = [goal_of(each, services) for each in motions]
    caller = call.caller(gone, JobKind.MOVE, body, wait=how.wait and not how.queue)
    check_queueing(how)
    if not how.queue:
        moves = services.moves
        motion = moves.move_sequence(goals, radii_m, caller) if several else moves.move(goals[0], caller)
        return await call.answer_end(caller, motion, answer)
    job = caller.job
    assert job is not None
    request = queue_request(job.request, goals, services.goals.request, how.blend_radius, radii_m, job)
    return call.answer_accepted(await services.jobs.enqueue(job, request, caller))


def check_queueing(how: MoveQuery) -> None:
    """Reject a blend radius without `queue`, because no motion follows to blend into.

    Raises:
        InputError: the motion has a blend radius but is not queued.
    """
    if not how.queue and how.blend_radius > 0.0:
        raise InputError("blend_radius: is only for queued motions; add queue=true")


def answer(outcome: Outcome) -> MoveAnswer:
    """Return the result of a motion as JSON, and note it for the audit log."""
    error, planned = outcome.error, outcome.planned
    stopped_by, contact = outcome.signals.stopped_by, outcome.signals.contact
    audit.add_details(motion=outcome.motion_id, error=str(error or ""))
    ended = f"Motion ended by its condition: {stopped_by}" if stopped_by else COMPLETED
    return MoveAnswer(
        success=error is None,
        message=ended if error is None else str(error),
        code=None if error is None else error.code,
        motion_id=outcome.motion_id,
        duration_s=outcome.duration_s,
        planning_time_s=outcome.planning_time_s,
        planning=None if planned is None else PlanningAnswer.model_validate(asdict(planned)),
        note=outcome.note,
        explain=None if error is None else explain_of(error),
        actions=[ActionAnswer.model_validate(asdict(each)) for each in outcome.signals.actions],
        stopped_by=stopped_by or None,
        contact=None if contact is None else ContactAnswer.model_validate(asdict(contact)),
        details=None if error is None else dict(error.details),
    )
