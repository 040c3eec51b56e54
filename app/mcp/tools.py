"""The tools, with the descriptions that agents read."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import asdict
from http import HTTPStatus
from typing import Annotated, Any

from mcp.server.mcpserver import Context, Image
from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import ToolAnnotations
from pydantic import FailFast, Field
from pydantic_core import to_jsonable_python
from starlette.requests import Request

from app.api.dependencies import BEGUN_S
from app.api.endpoints import Endpoint
from app.api.middleware.access import IDENTITY
from app.api.middleware.clients import client_of
from app.api.routers.gripper import GripperReportAnswer
from app.api.routers.plans import rehearsal
from app.api.schemas.plans import PlanArc, PlanId, PlanPath, PlanPose
from app.api.schemas.robot import LogLines
from app.mcp.arguments import takes_fields_of
from app.mcp.departures import GONE
from app.mcp.endpoint import STOPPED
from app.mcp.own_rest import OwnRest
from app.services.clients import CLIENT
from app.services.rights.claims import Caller
from app.services.rights.job import JobKind
from cobot.access.roles import Role, acting
from cobot.errors import BY_CODE, CobotError
from cobot.motions.bodies import Joints, PositionName
from cobot.motions.fields import Angle, Coordinate, OneOf, Speed
from cobot.motions.gripper_bodies import GripperGrasp, GripperMove, GripperRelease
from cobot.motions.planners import GOAL_ALONE, summaries

Ctx = Context[Any, Request]
Robot = Annotated[str, Field(max_length=64, description="Name of the robot; empty for the default one.")]
Name = Annotated[PositionName, Field(description="Name of a position, from list_positions.")]
JointAngles = Annotated[
    Joints, FailFast(), Field(description="Joint angles, rad, one for each joint, in the order of get_state.")
]
PosePlanner = Annotated[str, OneOf(GOAL_ALONE), Field(description=summaries(GOAL_ALONE))]
LOOKS = ToolAnnotations(read_only_hint=True, open_world_hint=False)
PLANS = ToolAnnotations(read_only_hint=False, destructive_hint=False, open_world_hint=False)
MOVES = ToolAnnotations(read_only_hint=False, destructive_hint=True, open_world_hint=False)
EXECUTE = "POST /robot/execute"
REHEARSE = "POST /robot/plans/{plan}/rehearse"


class _Rest:
    """Gives a tool access to the REST API. A rejected request raises a tool error with the reason."""

    def __init__(self, ctx: Ctx, robot: str) -> None:
        request = ctx.request_context.request
        assert request is not None  # this transport uses only HTTP
        self.scope = request.scope
        try:
            self._own = OwnRest(request.scope, robot)
        except CobotError as exc:
            raise ToolError(str(exc)) from exc
        self.services = self._own.services

    async def get(self, path: str, **params: Any) -> Any:
        await asyncio.sleep(0)  # let other tasks of the event loop run
        return read_decision(await self._own.ask("GET", path, **params))

    async def post(self, path: str, body: dict[str, Any] | None = None) -> Any:
        return read_decision(await self._own.ask("POST", path, body))


def read_decision(answer: tuple[int, Any]) -> Any:
    """Return the document of an answer. Raises ToolError, with the reason in words, if the answer is not a
    success.
    """
    status, content = answer
    if status == HTTPStatus.OK:
        return content
    error = BY_CODE.get(content["code"], CobotError)(content["detail"])
    raise ToolError(f"{status}: {error}") from error


async def get_state(ctx: Ctx, robot: Robot = "") -> dict[str, Any]:
    """Return the joint angles (rad), the TCP pose (m, quaternion, in the base frame), the mode, the client
    that has control, and the health.
    """
    rest = _Rest(ctx, robot)
    return {
        "joints": await rest.get("/robot/joint_states"),
        "pose": await rest.get("/robot/pose"),
        "control": await rest.get("/robot/control"),
        "health": await rest.get("/health"),
    }


async def list_positions(ctx: Ctx, robot: Robot = "") -> Any:
    """Return the named positions for plan_to_position, with their joint angles in rad."""
    return {"positions": await _Rest(ctx, robot).get("/robot/positions")}


async def get_scene(ctx: Ctx, robot: Robot = "") -> Any:
    """Return the objects around the arm and in its hand, and the named frames. Every plan avoids these
    objects.
    """
    return await _Rest(ctx, robot).get("/scene")


async def plan_to_position(ctx: Ctx, name: Name, speed: Speed = 0.1, robot: Robot = "") -> Any:
    """Plan a motion to a named position. Nothing moves. Returns a plan_id."""
    return await _plan(ctx, robot, "named", {"name": name, "speed": speed})


async def plan_to_joints(ctx: Ctx, joints: JointAngles, speed: Speed = 0.1, robot: Robot = "") -> Any:
    """Plan a motion to joint angles in rad, in the order of get_state. Nothing moves. Returns a plan_id."""
    return await _plan(ctx, robot, "joints", {"joints": joints, "speed": speed})


# All parameters are listed separately, because agents see them.
@takes_fields_of(PlanPose, "speed", "frame_id", "free_axes", "end_joints")
async def plan_to_pose(
    ctx: Ctx,
    x: Annotated[Coordinate, Field(description="x, m, in the frame.")],
    y: Annotated[Coordinate, Field(description="y, m, in the frame.")],
    z: Annotated[Coordinate, Field(description="z, m, in the frame.")],
    a: Annotated[Angle, Field(description="KUKA angle A about z, rad.")] = 0.0,
    b: Annotated[
        Angle, Field(description="KUKA angle B about the new y, rad; 3.14159 points the tool down.")
    ] = 3.14159,
    c: Annotated[Angle, Field(description="KUKA angle C about the newest x, rad.")] = 0.0,
    planner: PosePlanner = "ptp",
    robot: Robot = "",
    **fields: Any,
) -> Any:
    """Plan a TCP motion to a pose, in m and rad. Nothing moves. Returns a plan_id."""
    body = {"x": x, "y": y, "z": z, "a": a, "b": b, "c": c, "planner": planner}
    return await _plan(ctx, robot, "pose", body | fields)


@takes_fields_of(PlanPath, "poses", "radius", "speed", "frame_id", "free_axes", "cyclic")
async def plan_path(ctx: Ctx, robot: Robot = "", **fields: Any) -> Any:
    """Plan straight lines of the TCP through poses, in m and rad. A path that leads back to its start can be
    repeated if `cyclic` is true. Nothing moves. Returns a plan_id.
    """
    return await _plan(ctx, robot, "path", fields)


@takes_fields_of(
    PlanArc, "centre", "axis", "angle", "rise", "turn_tool", "speed", "frame_id", "free_axes", "cyclic"
)
async def plan_arc(ctx: Ctx, robot: Robot = "", **fields: Any) -> Any:
    """Plan an arc, a circle or a helix of the TCP about an axis, in m and rad. Nothing moves. Returns a
    plan_id.
    """
    return await _plan(ctx, robot, "arc", fields)


async def get_gripper(ctx: Ctx, robot: Robot = "") -> Any:
    """Return the state of the gripper: width (m), force (N), whether it is moving, the object that it holds,
    and its ranges.
    """
    return await _Rest(ctx, robot).get("/robot/gripper")


@takes_fields_of(GripperMove, "width", "speed", "force")
async def plan_gripper_move(ctx: Ctx, robot: Robot = "", **fields: Any) -> Any:
    """Plan to move the fingers to a width. Nothing moves. Returns a plan_id."""
    return await _plan_gripper(ctx, robot, "move", fields)


@takes_fields_of(GripperGrasp, "width", "tolerance_inner", "tolerance_outer", "speed", "force", "if_missed")
async def plan_gripper_grasp(ctx: Ctx, robot: Robot = "", **fields: Any) -> Any:
    """Plan to close the fingers on an object and hold it. Nothing moves. Returns a plan_id."""
    return await _plan_gripper(ctx, robot, "grasp", fields)


@takes_fields_of(GripperRelease, "width")
async def plan_gripper_release(ctx: Ctx, robot: Robot = "", **fields: Any) -> Any:
    """Plan to open the fingers and release the object at the arm's current position. Nothing moves. Returns a
    plan_id.
    """
    return await _plan_gripper(ctx, robot, "release", fields)


async def plan_gripper_home(ctx: Ctx, robot: Robot = "") -> Any:
    """Plan to activate the gripper. Its fingers may then close and open, and drop a held object. Nothing
    moves. Returns a plan_id.
    """
    return await _plan_gripper(ctx, robot, "home", {})


async def stop_gripper(ctx: Ctx, robot: Robot = "") -> Any:
    """Stop the fingers where they are, no matter which client is moving them. A held object stays held.
    Always permitted; the arm continues to move.
    """
    return await _Rest(ctx, robot).post("/robot/gripper/stop")


async def preview(ctx: Ctx, plan_id: PlanId, robot: Robot = "") -> list[Any]:
    """Return a picture of a plan: the arm at its end and, faintly, at its start, and the path of the TCP in
    blue.
    """
    rest = _Rest(ctx, robot)
    try:
        png = await rest.services.plans.picture(plan_id)
    except CobotError as exc:
        raise ToolError(str(exc)) from exc
    return [Image(data=png, format="png"), f"plan {plan_id}"]


async def execute(ctx: Ctx, plan_id: PlanId, robot: Robot = "") -> dict[str, Any]:
    """Run a plan that an operator has approved, or that is within the fence of this robot's settings. Answers
    when the motion or the gripper command has ended; `success` reports whether the goal was reached. If you
    disconnect before that, the motion or the command is stopped.
    """
    rest = _Rest(ctx, robot)
    identity, scope = rest.scope[IDENTITY], rest.scope
    endpoints: dict[str, Endpoint] = scope["app"].state.endpoints
    gone: asyncio.Event = scope[GONE]
    stops = rest.services.ownership.stops_before(scope.get(BEGUN_S))
    acting.set(identity)
    CLIENT.set(client_of(scope))
    job = rest.services.ownership.new_job(JobKind.EXECUTE, f"MCP execute {plan_id}")
    gripper = None
    try:
        plan = rest.services.plans.get(plan_id)
        caller = Caller("MCP execute", None, stops, endpoints[EXECUTE].timeout_s, gone, job)
        # If this call were cancelled, the arm would keep moving.
        running = asyncio.create_task(rest.services.approvals.execute(plan_id, caller))
        try:
            outcome = await asyncio.shield(running)
        except asyncio.CancelledError:
            gone.set()
            raise
        if plan.gripper is not None:
            gripper = GripperReportAnswer.of(rest.services.gripper.report()).model_dump(mode="json")
    except CobotError as exc:
        raise ToolError(str(exc)) from exc
    return {
        "success": outcome.error is None,
        "error": "" if outcome.error is None else str(outcome.error),
        "duration_s": outcome.duration_s,
        "stopped_by": outcome.signals.stopped_by,
        "actions": [asdict(each) for each in outcome.signals.actions],
        "gripper": gripper,
    }


async def rehearse(ctx: Ctx, plan_id: PlanId, robot: Robot = "") -> Any:
    """Run a plan on a simulated copy of the robot. The robot does not move. Reports whether the plan runs to
    its end, its duration, the effort of each joint, the smallest distances, and the first problem.
    """
    rest = _Rest(ctx, robot)
    scope, plans = rest.scope, rest.services.plans
    endpoints: dict[str, Endpoint] = scope["app"].state.endpoints
    gone: asyncio.Event = scope[GONE]
    try:
        found = await plans.rehearse(plan_id, gone, endpoints[REHEARSE].timeout_s)
        return rehearsal(*found).model_dump()
    except CobotError as exc:
        raise ToolError(str(exc)) from exc


async def stop(ctx: Ctx, robot: Robot = "") -> Any:
    """Stop the arm at once, no matter which client is moving it. Always permitted."""
    rest = _Rest(ctx, robot)
    done = rest.scope.get(STOPPED)  # the result of the stop that was carried out when the request arrived
    return await rest.post("/stop") if done is None else read_decision(done)


async def list_plans(ctx: Ctx, robot: Robot = "") -> Any:
    """Return the kept plans, and the client that has approved each."""
    return {"plans": await _Rest(ctx, robot).get("/robot/plans")}


async def get_sequence(ctx: Ctx, lines: LogLines = 50, robot: Robot = "") -> Any:
    """Report whether a sequence is running or how it has ended, and the last lines of its output."""
    rest = _Rest(ctx, robot)
    return {
        "status": await rest.get("/sequences/status"),
        "log": await rest.get("/sequences/logs", n=lines),
    }


async def get_log(ctx: Ctx, lines: LogLines = 50, robot: Robot = "") -> Any:
    """Return the last log lines about motions."""
    return await _Rest(ctx, robot).get("/trajectory/logs", n=lines)


async def why_did_it_stop(ctx: Ctx, robot: Robot = "") -> dict[str, Any]:
    """Report why the arm does not move: the mode and its reason, interventions of the safety layer, and the
    last motions.
    """
    rest = _Rest(ctx, robot)
    state = rest.services.link.state()
    return {
        "mode": state.mode.name,
        "reason": state.reason,
        "last_motion": state.motion_result.name,
        "health": await rest.get("/health"),
        "log": await rest.get("/trajectory/logs", n=20),
    }


async def _plan(ctx: Ctx, robot: str, kind: str, body: dict[str, Any]) -> Any:
    fields = to_jsonable_python(body)
    return await _Rest(ctx, robot).post(f"/robot/plan/{kind}", {**fields, "samples": 20})


async def _plan_gripper(ctx: Ctx, robot: str, command: str, fields: dict[str, Any]) -> Any:
    given = {name: value for name, value in fields.items() if value is not None}
    return await _Rest(ctx, robot).post("/robot/plan/gripper", {"gripper": {"command": command, **given}})


TOOLS: tuple[tuple[Callable[..., Any], Role, ToolAnnotations], ...] = (
    (get_state, Role.OBSERVER, LOOKS),
    (list_positions, Role.OBSERVER, LOOKS),
    (get_scene, Role.OBSERVER, LOOKS),
    (get_gripper, Role.OBSERVER, LOOKS),
    (list_plans, Role.OBSERVER, LOOKS),
    (get_sequence, Role.OBSERVER, LOOKS),
    (get_log, Role.OBSERVER, LOOKS),
    (why_did_it_stop, Role.OBSERVER, LOOKS),
    (preview, Role.AGENT, LOOKS),
    (plan_to_position, Role.AGENT, PLANS),
    (plan_to_joints, Role.AGENT, PLANS),
    (plan_to_pose, Role.AGENT, PLANS),
    (plan_path, Role.AGENT, PLANS),
    (plan_arc, Role.AGENT, PLANS),
    (plan_gripper_move, Role.AGENT, PLANS),
    (plan_gripper_grasp, Role.AGENT, PLANS),
    (plan_gripper_release, Role.AGENT, PLANS),
    (plan_gripper_home, Role.AGENT, PLANS),
    (rehearse, Role.AGENT, PLANS),
    (execute, Role.AGENT, MOVES),
    (stop, Role.OBSERVER, MOVES),
    (stop_gripper, Role.OBSERVER, MOVES),
)
"""Each tool, and the role that it needs. Without the role, the arguments are not even validated."""
