"""State and motion of the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fastapi import APIRouter, Depends, Request

from app.api.dependencies import Call, CobotRoute, Gone, json_body
from app.api.errors import responses
from app.api.schemas import (
    Angles,
    JointStates,
    MoveAnswer,
    MoveJoints,
    MoveNamed,
    MovePose,
    NamedPositionAnswer,
    Orientation,
    PoseAnswer,
    Position,
    Quaternion,
    ResetAnswer,
)
from app.services.motion.execution import Goal, Outcome
from cobot import audit
from cobot.robot.frames import abc_from_quaternion
from cobot.types import PlannerName, Scaling, Synchronization

COMPLETED = "Motion completed successfully"
MOTION_RESPONSES = responses(409, 413, 415, 422, 503)


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


@router.get("/positions")
async def positions(request: Request) -> list[NamedPositionAnswer]:
    """The positions that have a name, from the SRDF."""
    call = Call(request)
    return [
        NamedPositionAnswer(
            name=position.name,
            group=position.group,
            description=position.description,
            joints=list(position.joints),
        )
        for position in call.services.robot.positions.values()
    ]


@router.post("/move/named", responses=MOTION_RESPONSES, dependencies=[Depends(json_body)])
async def move_named(body: MoveNamed, request: Request, gone: Gone) -> MoveAnswer:
    """Go to a named position; answers when the arm has arrived and settled."""
    call = Call(request)
    goal = call.services.motion.named(
        body.name, Scaling(body.speed, body.accel_scale), Synchronization(body.synchronization)
    )
    return _answer(await call.services.motion.move(_by(body, goal), call.caller(gone)))


@router.post("/move/joints", responses=MOTION_RESPONSES, dependencies=[Depends(json_body)])
async def move_joints(body: MoveJoints, request: Request, gone: Gone) -> MoveAnswer:
    """Go to joint angles; answers when the arm has arrived and settled."""
    call = Call(request)
    goal = call.services.motion.joints(
        body.joints, Scaling(body.speed, body.accel_scale), Synchronization(body.synchronization)
    )
    return _answer(await call.services.motion.move(_by(body, goal), call.caller(gone)))


@router.post("/move/pose", responses=MOTION_RESPONSES, dependencies=[Depends(json_body)])
async def move_pose(body: MovePose, request: Request, gone: Gone) -> MoveAnswer:
    """Bring the TCP to a pose; answers when the arm has arrived and settled."""
    call = Call(request)
    via = None if body.via is None else [body.via.x, body.via.y, body.via.z]
    goal = call.services.motion.pose(
        [body.x, body.y, body.z],
        [body.a, body.b, body.c],
        body.frame_id,
        body.planner,
        Scaling(body.speed, body.accel_scale),
        via,
        Synchronization(body.synchronization),
    )
    return _answer(await call.services.motion.move(_by(body, goal), call.caller(gone)))


@router.post("/reset", responses=responses(409, 503))
async def reset(request: Request) -> ResetAnswer:
    """Leave an e-stop or a fault, once its cause is gone. Nothing moves; a sequence that was running ends."""
    call = Call(request)
    await call.services.stopping.reset(call.timeout_s)
    return ResetAnswer(success=True, message="the robot is ready to move")


def _by(body: MoveNamed | MoveJoints | MovePose, goal: Goal) -> Goal:
    return replace(goal, planner=PlannerName(body.planner), algorithm=body.algorithm)


def _answer(outcome: Outcome) -> MoveAnswer:
    audit.add_details(motion=outcome.motion_id, error=str(outcome.error or ""))
    return MoveAnswer(
        success=outcome.error is None,
        message=COMPLETED if outcome.error is None else str(outcome.error),
        code=None if outcome.error is None else outcome.error.code,
        motion_id=outcome.motion_id,
        duration_s=outcome.duration_s,
        planning_time_s=outcome.planning_time_s,
        note=outcome.note,
    )
