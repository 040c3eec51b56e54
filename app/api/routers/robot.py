"""State and motion of the arm."""

from __future__ import annotations

from collections.abc import Coroutine, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel

from app.api.constraints import constraints_of
from app.api.dependencies import Call, CobotRoute, Gone, json_body
from app.api.device_schemas import Acknowledge, AcknowledgeAnswer
from app.api.errors import responses
from app.api.explain_schemas import explain_of
from app.api.job_schemas import ACCEPTED, MoveQuery, accepted
from app.api.schemas import (
    Angles,
    JointStates,
    MoveAnswer,
    Orientation,
    PoseAnswer,
    Position,
    Quaternion,
    ResetAnswer,
)
from app.robot_services import Services
from app.services.jobs.job import JobKind
from app.services.motion.goals import NOWHERE, Goal, Goals, check_radii
from app.services.motion.moves import Outcome
from app.services.motion.ownership import Caller
from app.services.motion.queue_moves import QueueRequest
from app.services.state.first_contact import acknowledged
from cobot import audit
from cobot.errors import InputError
from cobot.motions.bodies import (
    AnyMotion,
    MoveArc,
    MoveJoints,
    MoveNamed,
    MovePose,
    MoveSequence,
    PathPoint,
    PathPose,
    TcpMotion,
)
from cobot.motions.requests import Arc, TcpSpeed, check_algorithm
from cobot.robot.frames import abc_from_quaternion, pose_from_abc
from cobot.types import Array, PlannerName, Pose, Scaling, Synchronization

How = Annotated[MoveQuery, Query()]
COMPLETED = "Motion completed successfully"
MOTION: dict[str, Any] = {
    "response_model": MoveAnswer,
    "responses": responses(409, 413, 415, 422, 503) | ACCEPTED,
    "dependencies": [Depends(json_body)],
}

router = APIRouter(prefix="/robot", tags=["robot"], route_class=CobotRoute)


@router.get("/joint_states", responses=responses(503))
async def joint_states(request: Request) -> JointStates:
    """Angles, velocities and efforts, as measured."""
    call = Call(request)
    state = await call.services.link.measured_state(call.timeout_s)
    return JointStates(
        name=list(call.services.robot.limits.names),
        position=state.position.tolist(),
        velocity=state.velocity.tolist(),
        effort=state.effort.tolist(),
    )


@router.get("/pose", responses=responses(503))
async def pose(request: Request) -> PoseAnswer:
    """The TCP in the base frame."""
    call = Call(request)
    state = await call.services.link.measured_state(call.timeout_s)
    x, y, z, qw, qx, qy, qz = state.tcp.tolist()
    a, b, c = abc_from_quaternion(state.tcp[3:])
    return PoseAnswer(
        position=Position(x=x, y=y, z=z),
        orientation=Orientation(
            quaternion=Quaternion(x=qx, y=qy, z=qz, w=qw),
            euler_rad=Angles(a=a, b=b, c=c),
            euler_deg=Angles(a=np.degrees(a), b=np.degrees(b), c=np.degrees(c)),
        ),
        frame_id=call.services.robot.base_frame,
    )


@router.post("/move/named", **MOTION)
async def move_named(body: MoveNamed, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Go to a named position; answers when the arm has arrived and settled."""
    call = Call(request)
    caller = call.caller(gone, JobKind.MOVE, _said(body), wait=how.wait and not how.queue)
    return await _one(call, caller, goal_of(body, call.services), how)


@router.post("/move/joints", **MOTION)
async def move_joints(body: MoveJoints, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Go to joint angles; answers when the arm has arrived and settled."""
    call = Call(request)
    caller = call.caller(gone, JobKind.MOVE, _said(body), wait=how.wait and not how.queue)
    return await _one(call, caller, goal_of(body, call.services), how)


@router.post("/move/pose", **MOTION)
async def move_pose(body: MovePose, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Bring the TCP to a pose; answers when the arm has arrived and settled."""
    call = Call(request)
    caller = call.caller(gone, JobKind.MOVE, _said(body), wait=how.wait and not how.queue)
    return await _one(call, caller, goal_of(body, call.services), how)


@router.post("/move/arc", **MOTION)
async def move_arc(body: MoveArc, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Turn the TCP about an axis by an angle; answers when the arm has arrived and settled."""
    call = Call(request)
    caller = call.caller(gone, JobKind.MOVE, _said(body), wait=how.wait and not how.queue)
    return await _one(call, caller, goal_of(body, call.services), how)


@router.post("/move/sequence", **MOTION)
async def move_sequence(body: MoveSequence, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Several motions as one, with round corners; answers when the arm has arrived and settled."""
    call = Call(request)
    goals = [goal_of(motion, call.services) for motion in body.motions]
    caller = call.caller(gone, JobKind.MOVE, _said(body), wait=how.wait and not how.queue)
    check_queueing(how)
    if how.queue:
        return await _queued(call, caller, goals, body.radii, how)
    return await moved(call, caller, call.services.moves.move_sequence(goals, body.radii, caller))


@router.post("/reset", responses=responses(409, 503))
async def reset(request: Request) -> ResetAnswer:
    """Leave an e-stop or a fault, once its cause is gone. Nothing moves; a sequence that was running ends."""
    call = Call(request)
    await call.services.stopping.reset(call.timeout_s)
    return ResetAnswer(success=True, message="the robot is ready to move")


@router.post("/acknowledge", responses=responses(409, 413, 415, 422, 503), dependencies=[Depends(json_body)])
async def acknowledge(body: Acknowledge, request: Request) -> AcknowledgeAnswer:
    """Somebody has compared the arm with what the first contact with it has found.

    From now on it goes at full speed, and may be streamed to. Where there is nothing to acknowledge, it
    changes nothing.
    """
    services = Call(request).services
    services.ownership.require_control()
    found = await acknowledged(services.link, payload_checked=body.payload_checked)
    message = "acknowledged: the robot goes at full speed" if found else "there was nothing to acknowledge"
    audit.add_details(message=message, payload_checked=body.payload_checked)
    return AcknowledgeAnswer(success=True, message=message, found=found)


def _scaling(body: TcpMotion) -> Scaling:
    """A speed in m/s or rad/s is a limit of its own: without a share of the others they count in full."""
    in_units = body.speed_m_s is not None or body.speed_rad_s is not None
    speed = 1.0 if in_units and "speed" not in body.model_fields_set else body.speed
    return Scaling(speed, body.accel_scale)


def _arc_to(body: MovePose) -> Arc | None:
    if body.centre is None:
        if body.axis is not None:
            raise InputError("axis: goes with centre, which is missing")
        return None
    return Arc(_vector(body.centre), None if body.axis is None else _vector(body.axis))


def _pose(body: PathPose) -> Pose:
    return pose_from_abc(body.x, body.y, body.z, body.a, body.b, body.c)


def _vector(point: PathPoint) -> Array:
    return np.array([point.x, point.y, point.z])


def goal_of(body: AnyMotion, services: Services, *, checked: bool = True) -> Goal:
    """What a request asks for; joint angles are `checked` against the limits, which planning does too.

    Raises:
        InputError, LimitError: see `Goals.named`, `joints`, `pose` and `arc`.
    """
    constraints = constraints_of(body.constraints, services.robot.limits)
    if isinstance(body, MoveArc):
        return replace(_along_arc(body, services.goals), constraints=constraints)
    goal, planner = _to_goal(body, services.goals, checked=checked), PlannerName(body.planner)
    check_algorithm(planner, body.algorithm, constraints)
    return replace(goal, planner=planner, algorithm=body.algorithm, constraints=constraints)


def _along_arc(body: MoveArc, goals: Goals) -> Goal:
    goal = Goal(
        NOWHERE,
        _scaling(body),
        PlannerName.CIRC,
        arc=Arc(_vector(body.centre), _vector(body.axis), body.angle, body.rise, body.turn_tool),
        tcp_speed=TcpSpeed(body.speed_m_s, body.speed_rad_s),
        free_axes=tuple(body.free_axes),
        cyclic=body.cyclic,
    )
    return goals.pose(goal, body.frame_id)


def _to_goal(body: MoveNamed | MoveJoints | MovePose, goals: Goals, *, checked: bool) -> Goal:
    scaling, synchronization = Scaling(body.speed, body.accel_scale), Synchronization(body.synchronization)
    if isinstance(body, MoveNamed):
        return goals.named(body.name, scaling, synchronization, checked=checked)
    if isinstance(body, MoveJoints):
        return goals.joints(body.joints, scaling, synchronization, checked=checked)
    goal = Goal(
        _pose(body),
        _scaling(body),
        PlannerName(body.planner),
        via=None if body.via is None else _vector(body.via),
        synchronization=synchronization,
        arc=_arc_to(body),
        through=tuple(map(_pose, body.through)),
        radius_m=body.radius,
        tcp_speed=TcpSpeed(body.speed_m_s, body.speed_rad_s),
        free_axes=tuple(body.free_axes),
        cyclic=body.cyclic,
        end_joints=None if body.end_joints is None else np.array(body.end_joints),
    )
    return goals.pose(goal, body.frame_id)


def _said(body: BaseModel) -> str:
    return body.model_dump_json(exclude_unset=True)


async def _one(call: Call, caller: Caller, goal: Goal, how: MoveQuery) -> MoveAnswer | JSONResponse:
    """The answer to a request for one motion, at once or in its turn."""
    check_queueing(how)
    if how.queue:
        return await _queued(call, caller, [goal], [], how)
    return await moved(call, caller, call.services.moves.move(goal, caller))


def check_queueing(how: MoveQuery) -> None:
    """A motion that is not queued has no next one to go on into.

    Raises:
        InputError: it has a radius.
    """
    if not how.queue and how.blend_radius > 0.0:
        raise InputError("blend_radius: is for moves in the queue; it goes with queue=true")


async def _queued(
    call: Call, caller: Caller, goals: Sequence[Goal], radii_m: Sequence[float], how: MoveQuery
) -> JSONResponse:
    """The answer to a request for motions that are done in their turn: their job."""
    check_radii(goals, radii_m)
    services, job = call.services, caller.job
    assert job is not None
    first = goals[0]
    relative = first.in_tool or (first.arc is not None and first.arc.angle_rad is not None)
    of_one_piece = len(goals) > 1 or first.planner in (PlannerName.CIRC, PlannerName.POLYLINE)
    request = QueueRequest(
        job.request,
        [partial(services.goals.request, goal) for goal in goals],
        how.blend_radius,
        radii_m or [0.0] * (len(goals) - 1),
        job,
        anywhere=not relative,
        midway=not relative and not of_one_piece,
        count=len(goals),
    )
    return accepted(call, await services.jobs.enqueue(job, request, caller))


async def moved(
    call: Call, caller: Caller, motion: Coroutine[Any, Any, Outcome]
) -> MoveAnswer | JSONResponse:
    """The answer to a request for a motion: how it ended, or the job if nobody waits for that."""
    if caller.waits:
        return answer(await motion)
    assert caller.job is not None
    return accepted(call, await call.services.jobs.begin(caller.job, motion))


def answer(outcome: Outcome) -> MoveAnswer:
    """How a motion ended, as JSON; the audit log has it too."""
    audit.add_details(motion=outcome.motion_id, error=str(outcome.error or ""))
    return MoveAnswer(
        success=outcome.error is None,
        message=COMPLETED if outcome.error is None else str(outcome.error),
        code=None if outcome.error is None else outcome.error.code,
        motion_id=outcome.motion_id,
        duration_s=outcome.duration_s,
        planning_time_s=outcome.planning_time_s,
        note=outcome.note,
        explain=None if outcome.error is None else explain_of(outcome.error),
    )
