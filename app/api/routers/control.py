"""Control of the arm: reading, taking and releasing it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import Request

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.robot import ControlAnswer, TakeControl, TakenAnswer
from app.robot_services import Services
from cobot import audit
from cobot.access.roles import Role

router = EndpointRouter(tags=["robot"])
REST_S = 1.5
"""Part of an endpoint's timeout reserved for the answer, s."""


@router.endpoint("GET /robot/control", Role.OBSERVER, timeout_s=1.5)
async def control(request: Request) -> ControlAnswer:
    """Return the client that controls the robot, by a lease or by a running motion."""
    return ControlAnswer.model_validate(_state(Call(request).services))


@router.endpoint("POST /robot/control", Role.OPERATOR, timeout_s=10.0, responses=responses(409))
async def take_control(body: TakeControl, request: Request) -> TakenAnswer:
    """Take control, renew it, or take it over. After that, no other client can move the robot.

    Send the answer's `token` as the header `X-Control-Token` with each request that moves the robot. The
    lease ends when it is released, or when nothing has moved for `timeout_s`. A stop never needs control.
    """
    call = Call(request)
    taken = await call.services.control.take(
        body.timeout_s, force=body.force, stop_s=max(call.timeout_s - REST_S, 1.0)
    )
    if taken.former is not None:
        audit.note("control taken over", former=taken.former)
    state = _state(call.services)
    return TakenAnswer.model_validate({**state, "token": taken.token, "stopped": taken.stopped})


@router.endpoint("DELETE /robot/control", Role.OPERATOR, timeout_s=1.5, responses=responses(409))
async def release_control(request: Request) -> ControlAnswer:
    """Release control. A running motion continues."""
    services = Call(request).services
    services.control.release()
    return ControlAnswer.model_validate(_state(services))


def _state(services: Services) -> dict[str, Any]:
    return asdict(services.control.state())
