"""Motions and gripper commands that are planned first and executed later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np
from fastapi import Path, Query, Request, Response

from app.api.dependencies import Call, Gone
from app.api.errors import responses, tell
from app.api.middleware.access import identity_of
from app.api.motions.explanations import explained
from app.api.motions.goals import goal_of
from app.api.paging import After, Limit, page_of
from app.api.route import EndpointRouter
from app.api.routers.robot import How, answer, check_queueing
from app.api.schemas.jobs import ACCEPTED
from app.api.schemas.plan_answers import (
    DistanceAnswer,
    MotionAnswer,
    MotionPoint,
    NoticeAnswer,
    PlanAnswer,
    PlanDistance,
    PlanningAnswer,
    PlanPoint,
    PlanUse,
    RehearsalAnswer,
    RehearsalFlaw,
)
from app.api.schemas.plans import (
    Approve,
    Execute,
    Improve,
    KeptPlan,
    MotionQuery,
    PlanArc,
    PlanGripper,
    PlanJoints,
    PlanNamed,
    Planning,
    PlanPath,
    PlanPose,
    PlanSequence,
)
from app.api.schemas.robot import MoveAnswer
from app.robot_services import Services
from app.services.motion.plan import Plan
from app.services.motion.plan_attempt import PlanOptions
from app.services.rights.job import JobKind
from cobot.access.roles import Role
from cobot.errors import CobotError, InputError
from cobot.motions.bodies import AnyMotion
from cobot.motions.forecast import Closest, Forecast
from cobot.motions.gripper_bodies import GripperRequest
from cobot.motions.rehearsal import Flaw, Rehearsal

PLAN: dict[str, Any] = {
    "responses": responses(409, 501, 503),
}

PlanOfPath = Annotated[str, Path(max_length=64, description="Id of a plan.")]
router = EndpointRouter(tags=["plans"])


@router.endpoint("POST /robot/plan/named", Role.AGENT, timeout_s=20.0, **PLAN)
async def plan_named(body: PlanNamed, request: Request) -> PlanAnswer:
    """Plan a motion to a named position. Nothing moves."""
    return await _plan([body], [], body, Call(request))


@router.endpoint("POST /robot/plan/joints", Role.AGENT, timeout_s=20.0, **PLAN)
async def plan_joints(body: PlanJoints, request: Request) -> PlanAnswer:
    """Plan a motion to joint angles. Nothing moves."""
    return await _plan([body], [], body, Call(request))


@router.endpoint("POST /robot/plan/pose", Role.AGENT, timeout_s=20.0, **PLAN)
async def plan_pose(body: PlanPose, request: Request) -> PlanAnswer:
    """Plan a TCP motion to a pose. Nothing moves."""
    return await _plan([body], [], body, Call(request))


@router.endpoint("POST /robot/plan/arc", Role.AGENT, timeout_s=20.0, **PLAN)
async def plan_arc(body: PlanArc, request: Request) -> PlanAnswer:
    """Plan an arc of the TCP: a rotation by an angle about an axis. Nothing moves."""
    return await _plan([body], [], body, Call(request))


@router.endpoint("POST /robot/plan/path", Role.AGENT, timeout_s=20.0, **PLAN)
async def plan_path(body: PlanPath, request: Request) -> PlanAnswer:
    """Plan straight lines of the TCP through poses. Nothing moves."""
    return await _plan([body.polyline()], [], body, Call(request))


@router.endpoint("POST /robot/plan/sequence", Role.AGENT, timeout_s=20.0, **PLAN)
async def plan_sequence(body: PlanSequence, request: Request) -> PlanAnswer:
    """Plan several motions as one, with blends between them. Nothing moves."""
    return await _plan(body.motions, body.radii, body, Call(request))


@router.endpoint("POST /robot/plan/gripper", Role.AGENT, timeout_s=20.0, **PLAN)
async def plan_gripper(body: PlanGripper, request: Request) -> PlanAnswer:
    """Plan a gripper command, which a person can approve. Nothing moves."""
    call = Call(request)
    try:
        asked = GripperRequest.of(body.gripper)
        call.services.gripper.check(asked.command)
    except InputError as exc:
        raise InputError(f"gripper.{exc}") from exc
    return _report_plan(await call.services.plans.make_gripper(asked, body.samples, call.timeout_s), call)


EXECUTE: dict[str, Any] = {
    "timeout_s": 60.0,
    "control": True,
    "keyed": True,
    "response_model": MoveAnswer,
    "responses": responses(404, 409, 501, 503) | ACCEPTED,
}


@router.endpoint("POST /robot/execute", Role.OPERATOR, **EXECUTE)
async def execute(body: Execute, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Run a plan, if the robot's state has not changed since planning. Returns when the arm has settled."""
    return await _execute(body.plan_id, request, gone, how)


@router.endpoint(
    "POST /robot/plans/{plan}/execute",
    Role.OPERATOR,
    **EXECUTE | {"responses": responses(422) | EXECUTE["responses"]},
)
async def execute_plan(plan: PlanOfPath, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    """Run a plan, as POST /robot/execute does. Takes no body."""
    return await _execute(plan, request, gone, how)


async def _execute(plan_id: str, request: Request, gone: Gone, how: How) -> MoveAnswer | Response:
    call = Call(request)
    plans = call.services.plans
    caller = call.caller(gone, JobKind.EXECUTE, plan_id, wait=how.wait and not how.queue)
    check_queueing(how)
    if not how.queue:
        return await call.answer_end(caller, plans.execute(plan_id, caller), answer)
    job = caller.job
    assert job is not None
    queued = plans.queue_request(plan_id, job, how.blend_radius)
    return call.answer_accepted(await call.services.jobs.enqueue(job, queued, caller))


@router.endpoint("GET /robot/motion", Role.OBSERVER, timeout_s=1.5, responses=responses(422))
async def running_motion(query: Annotated[MotionQuery, Query()], request: Request) -> MotionAnswer:
    """Return the planned path of the current motion, of any client. It is empty without a motion.

    A streaming session has no path. If a motion is blended with the next one of the queue, the path is that
    of both.
    """
    found = Call(request).services.ownership.motion
    if found is None:
        return MotionAnswer(motion_id=None, duration_s=0.0, note="", path=[])
    motion_id, trajectory = found
    times_s = np.linspace(0.0, trajectory.duration_s, query.samples)
    points = zip(times_s.tolist(), trajectory.sample(times_s).tolist(), strict=True)
    return MotionAnswer(
        motion_id=motion_id,
        duration_s=trajectory.duration_s,
        note=trajectory.note,
        path=[MotionPoint(time_s=time_s, joints=joints) for time_s, joints in points],
    )


@router.endpoint("GET /robot/plans", Role.OBSERVER, timeout_s=1.5, responses=responses(422, 503))
async def kept_plans(request: Request, limit: Limit = None, after: After = None) -> list[KeptPlan]:
    """Return the plans that can be run, the oldest first. Each has the client that has approved it for an
    agent.
    """
    services = Call(request).services
    found = page_of(services.plans.list_valid(), lambda each: each.plan_id, limit, after)
    return [_kept(plan, services) for plan in found]


@router.endpoint(
    "GET /robot/plans/{plan}",
    Role.OBSERVER,
    timeout_s=1.5,
    costly=True,
    response_model=PlanAnswer,
    responses=responses(404, 422),
)
async def kept_plan(plan: PlanOfPath, request: Request) -> Response:
    """Return a plan that can be run, with its path, as in the response that made it."""
    plans = Call(request).services.plans
    found = plans.get(plan)
    content = _shown(found, plans.expires_in_s(found)).model_dump_json()
    return Response(content, media_type="application/json")


@router.endpoint(
    "POST /robot/plans/{plan}/rehearse", Role.AGENT, timeout_s=20.0, responses=responses(404, 409, 422, 503)
)
async def rehearse(plan: PlanOfPath, request: Request, gone: Gone) -> RehearsalAnswer:
    """Run a plan on a simulated copy of the robot, with the code of the real-time cycle. The robot itself
    does not move.
    """
    call = Call(request)
    return rehearsal(*await call.services.plans.rehearse(plan, gone, call.timeout_s))


@router.endpoint(
    "POST /robot/plans/{plan}/improve", Role.AGENT, timeout_s=20.0, responses=responses(404, 409, 422, 503)
)
async def improve(plan: PlanOfPath, body: Improve, request: Request) -> PlanAnswer:
    """Find a faster plan with the same start and goal. The given plan does not change, and it is the answer
    if no faster one is found. Nothing moves.
    """
    call = Call(request)
    found = await call.services.plans.improve(plan, body.budget_s, body.samples, call.timeout_s)
    if found.plan_id == plan:
        return _shown(found, call.services.plans.expires_in_s(found))
    return _report_plan(found, call)


@router.endpoint("POST /robot/approve", Role.OPERATOR, timeout_s=1.5, responses=responses(404, 503))
async def approve(body: Approve, request: Request) -> KeptPlan:
    """Allow an agent to run a plan once, or withdraw the approval. Look at the plan first."""
    return _approve(body.plan_id, request, approved=body.approved)


@router.endpoint(
    "POST /robot/plans/{plan}/approve", Role.OPERATOR, timeout_s=1.5, responses=responses(404, 422, 503)
)
async def approve_plan(
    plan: PlanOfPath,
    request: Request,
    approved: Annotated[bool, Query(description="false: withdraw the approval.")] = True,
) -> KeptPlan:
    """Allow an agent to run a plan, as POST /robot/approve does. Takes no body."""
    return _approve(plan, request, approved=approved)


def _approve(plan_id: str, request: Request, *, approved: bool) -> KeptPlan:
    services = Call(request).services
    approvals = services.approvals
    by = identity_of(request).name
    plan = approvals.approve(plan_id, by) if approved else approvals.withdraw(plan_id)
    what = "approved" if approved else "withdrawn"
    services.link.events.publish("plan", what=what, plan=plan.plan_id, by=by)
    return _kept(plan, services)


def rehearsal(plan: Plan, found: Rehearsal | None) -> RehearsalAnswer:
    """Return the answer to a dry run.

    Args:
        found: the result; None for a plan without a motion, whose forecast then has the values instead.
    """
    forecast, flaw = plan.forecast, None if found is None else found.flaw
    closest = forecast if found is None else found
    torque = forecast.utilisation["torque"]
    return RehearsalAnswer(
        plan_id=plan.plan_id,
        runs_through=flaw is None,
        duration_s=0.0 if found is None else found.run.duration_s,
        planned_duration_s=0.0 if forecast.trajectory is None else forecast.trajectory.duration_s,
        effort=(torque if found is None else found.run.effort).tolist(),
        off=(0.0 * torque if found is None else found.run.off_rad).tolist(),
        problem=None if flaw is None else _problem(flaw),
        closest_self=_distance(closest.closest_self),
        closest_environment=_distance(closest.closest_environment),
    )


def _problem(flaw: Flaw) -> RehearsalFlaw:
    told = {"time_s": flaw.time_s, "joint": flaw.joint, "says": flaw.says, **flaw.says.fields()}
    return RehearsalFlaw.model_validate(told)


def _kept(plan: Plan, services: Services) -> KeptPlan:
    trajectory = plan.forecast.trajectory
    return KeptPlan(
        plan_id=plan.plan_id,
        by=plan.by,
        planners=sorted(plan.planners),
        duration_s=0.0 if trajectory is None else trajectory.duration_s,
        signals=list(plan.words),
        expires_in_s=services.plans.expires_in_s(plan),
        approved_by=services.approvals.approved_by(plan.plan_id),
    )


async def _plan(
    motions: Sequence[AnyMotion], radii: Sequence[float], asked: Planning, call: Call
) -> PlanAnswer:
    plans = call.services.plans
    goals = [goal_of(motion, call.services, checked=False) for motion in motions]
    options = PlanOptions(asked.start, asked.samples, asked.explain)
    try:
        plan = await plans.make(goals, radii, options, call.timeout_s)
    except CobotError as exc:
        if exc.explanation is not None:
            base_frame = call.services.robot.base_frame
            tell(call.request, explained(exc, exc.explanation, motions, goals, base_frame))
        raise
    return _report_plan(plan, call)


def _report_plan(plan: Plan, call: Call) -> PlanAnswer:
    """Report a new plan, and return it as JSON."""
    kept = _kept(plan, call.services)
    events = call.services.link.events
    events.publish(
        "plan", what="made", plan=plan.plan_id, by=plan.by, planners=kept.planners, duration_s=kept.duration_s
    )
    return _shown(plan, call.services.plans.lifetime_s)


def _shown(plan: Plan, expires_in_s: float) -> PlanAnswer:
    found, planned = plan.forecast, plan.planned
    trajectory = found.trajectory
    return PlanAnswer(
        plan_id=plan.plan_id,
        expires_in_s=expires_in_s,
        duration_s=0.0 if trajectory is None else trajectory.duration_s,
        planning_time_s=plan.planning_s,
        planning=None if planned is None else PlanningAnswer.model_validate(asdict(planned)),
        note="" if trajectory is None else trajectory.note,
        notices=[
            NoticeAnswer(kind=each.kind, values=dict(each.values))
            for each in (() if trajectory is None else trajectory.notices)
        ],
        path=_path(found),
        utilisation={
            name: PlanUse(peak=peak.tolist(), share=found.utilisation[name].tolist())
            for name, peak in found.peaks.items()
        },
        closest_self=_distance(found.closest_self),
        closest_environment=_distance(found.closest_environment),
        signals=list(plan.words),
    )


def _path(found: Forecast) -> list[PlanPoint]:
    trajectory, joints = found.trajectory, found.joints
    velocities = 0.0 * joints if trajectory is None else trajectory.sample(found.times_s, 1)
    columns = (found.times_s, joints, velocities, found.poses)
    return [
        PlanPoint(
            time_s=time_s, joints=place, velocities=rates, position=pose[:3], quaternion=[*pose[4:], pose[3]]
        )
        for time_s, place, rates, pose in zip(*(each.tolist() for each in columns), strict=True)
    ]


def _distance(closest: Closest | None) -> PlanDistance | None:
    if closest is None:
        return None
    return PlanDistance(**DistanceAnswer.of(closest).model_dump(), share=closest.share)
