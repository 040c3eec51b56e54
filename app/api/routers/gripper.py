"""The gripper: its state and its commands."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import Request, Response
from pydantic import BaseModel, Field

from app.api.dependencies import Call, Gone
from app.api.errors import ErrorCode, responses
from app.api.route import EndpointRouter
from app.api.schemas.explain import Details
from app.api.schemas.jobs import ACCEPTED, Wait
from app.services.gripping.commands import GripperOutcome, GripperReport
from app.services.rights.job import JobKind
from cobot import audit
from cobot.access.roles import Role
from cobot.grippers import GripperState, HeldObject, PowerLoss
from cobot.motions.fields import example
from cobot.motions.gripper_bodies import (
    AnyGripperCommand,
    GripperGrasp,
    GripperHome,
    GripperMove,
    GripperRelease,
)

COMMAND_S = 30.0
DONE = "The gripper has done it"


class GripperValues(BaseModel):
    """Values that the gripper reports; null for a value that it does not report."""

    width: float | None = Field(description="Width between the fingers, m.")
    commanded_width: float | None = Field(description="Width of the last command, m.")
    force: float | None = Field(description="Force at the fingers, N.")
    moving: bool = Field(description="Whether a command is in progress.")
    object: HeldObject | None = Field(
        description="none; held_inside (between the fingers), held_outside (the fingers are inside the "
        "object), lost (the object is gone without a release); null: the gripper does not "
        "detect objects."
    )
    temperature: float | None = Field(description="°C")
    fault: str = Field(description='Problem of the device; "" if there is none.')
    ages_s: dict[str, float] = Field(
        description="Age of each value that is older than the others, by name, s."
    )

    @classmethod
    def of(cls, state: GripperState) -> GripperValues:
        return cls(
            width=state.width,
            commanded_width=state.commanded_width,
            force=state.force,
            moving=state.moving,
            object=state.object,
            temperature=state.temperature,
            fault=state.fault,
            ages_s=dict(state.ages_s),
        )


class GripperAble(BaseModel):
    """Capabilities of the gripper. A range consists of the smallest and the largest value."""

    width_m: tuple[float, float] | None = Field(
        description="Width between the fingers, m; null: the gripper has no width, for example a suction cup."
    )
    force_n: tuple[float, float] | None = Field(description="Force, N; null: the force is fixed.")
    speed_m_s: tuple[float, float] | None = Field(description="Speed, m/s; null: the speed is fixed.")
    object_detection: bool = Field(description="Whether the gripper detects objects (`object`).")
    continuous: bool = Field(description="true: any width can be commanded; false: only the two ends.")
    on_power_loss: PowerLoss = Field(description="What the fingers do without power.")
    hardware: bool = Field(description="true: a real gripper; false: a simulated one.")


class GripperReportAnswer(BaseModel):
    """Gripper state."""

    type: str = Field(description="The setting robot.gripper.")
    connected: bool = Field(description="Whether the state is current.")
    problem: str = Field(description='Reason why the state is not current; "" if it is.')
    state: GripperValues | None = Field(description="The last reading; null before the first one.")
    age_s: float = Field(description="Age of the state, s.")
    command: str = Field(description='The command in progress; "" for none.')
    held: str | None = Field(description="Name of the scene object that is attached to the gripper.")
    capabilities: GripperAble = Field(description="Capabilities of the gripper.")

    @classmethod
    def of(cls, report: GripperReport) -> GripperReportAnswer:
        return cls(
            type=report.type,
            connected=not report.problem,
            problem=report.problem,
            state=None if report.state is None else GripperValues.of(report.state),
            age_s=report.age_s,
            command=report.command,
            held=report.held,
            capabilities=GripperAble.model_validate(asdict(report.capabilities)),
        )


class GripperAnswer(GripperValues):
    """Result of a command, and the state of the gripper after it."""

    model_config = example(
        {
            "success": True,
            "message": DONE,
            "code": None,
            "held": "part",
            "width": 0.041,
            "commanded_width": 0.035,
            "force": 40.0,
            "moving": False,
            "object": "held_inside",
            "temperature": None,
            "fault": "",
            "ages_s": {},
        }
    )

    success: bool = Field(
        description="Whether the command reached its goal. Also true if the request does not require it."
    )
    message: str = Field(description="The reason, if `success` is false.")
    code: ErrorCode | None = Field(description="A stable word for the reason, null on success.")
    held: str | None = Field(description="Name of the scene object that is attached now.")
    details: Details = None


COMMAND: dict[str, Any] = {
    "keyed": True,
    "response_model": GripperAnswer,
    "responses": responses(409, 501, 503) | ACCEPTED,
}
Answer = GripperAnswer | Response

router = EndpointRouter(tags=["gripper"])


@router.endpoint("GET /robot/gripper", Role.OBSERVER, timeout_s=1.5, responses=responses(501))
async def gripper(request: Request) -> GripperReportAnswer:
    """Return the state of the gripper, and its capabilities."""
    return GripperReportAnswer.of(Call(request).services.gripper.report())


@router.endpoint("POST /robot/gripper/move", Role.OPERATOR, timeout_s=COMMAND_S, control=True, **COMMAND)
async def move_gripper(body: GripperMove, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Move the fingers to a width. Every new command ends the current one."""
    return await _run("move", body, request, gone, wait)


@router.endpoint("POST /robot/gripper/grasp", Role.OPERATOR, timeout_s=COMMAND_S, control=True, **COMMAND)
async def grasp(body: GripperGrasp, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Close the fingers on an object and hold it. If an object of the scene is at the TCP, it is attached to
    the arm.
    """
    return await _run("grasp", body, request, gone, wait)


@router.endpoint("POST /robot/gripper/release", Role.OPERATOR, timeout_s=COMMAND_S, control=True, **COMMAND)
async def release(body: GripperRelease, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Open the fingers and release the object, which is detached at its current position. This also works
    after an e-stop or a fault.
    """
    return await _run("release", body, request, gone, wait)


@router.endpoint("POST /robot/gripper/home", Role.OPERATOR, timeout_s=COMMAND_S, control=True, **COMMAND)
async def home(body: GripperHome, request: Request, gone: Gone, wait: Wait = True) -> Answer:
    """Activate or home the gripper. Its fingers may close and open."""
    return await _run("home", body, request, gone, wait)


@router.endpoint("POST /robot/gripper/stop", Role.OBSERVER, timeout_s=5.0, responses=responses(501, 502))
async def stop_gripper(request: Request) -> GripperReportAnswer:
    """Stop the fingers, whichever client is moving them. A held object stays held. Takes no body."""
    return GripperReportAnswer.of(await Call(request).services.gripper.stop())


async def _run(name: str, body: AnyGripperCommand, request: Request, gone: Gone, wait: bool) -> Answer:
    call = Call(request)
    caller = call.caller(gone, JobKind.GRIPPER, body, wait=wait)
    return await call.answer_end(caller, call.services.gripper.run(name, body, caller), _answer)


def _answer(outcome: GripperOutcome) -> GripperAnswer:
    error = outcome.error
    audit.add_details(error=str(error or ""))
    return GripperAnswer(
        success=error is None,
        message=DONE if error is None else str(error),
        code=None if error is None else error.code,
        held=outcome.held,
        details=None if error is None else dict(error.details),
        **GripperValues.of(outcome.state).model_dump(),
    )
