"""Freedrive: the arm is guided by hand."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import Request
from pydantic import Field

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.reason_fields import ReasonFields
from app.services.streaming.freedrive import TIMEOUT_S, TIMEOUTS_S, FreedriveService
from cobot.access.roles import Role
from cobot.loose_lists import RequestModel
from cobot.motions.fields import Finite, example

router = EndpointRouter(tags=["robot"])


class Freedrive(RequestModel):
    """Starts or renews freedrive."""

    model_config = example({"timeout_s": 3.0})

    timeout_s: Finite = Field(
        TIMEOUT_S,
        ge=TIMEOUTS_S[0],
        le=TIMEOUTS_S[1],
        description="Time without a renewal after which freedrive ends, s.",
    )
    session: int | None = Field(
        None,
        ge=1,
        description="Session from the response: renews that session. Without it, freedrive starts.",
    )


class FreedriveAnswer(ReasonFields):
    """State of freedrive. The code and the values belong to `limited_by` or, if that is empty, to `ended`."""

    session: int | None = Field(description="Number of the current session; null while freedrive is off.")
    left_s: float = Field(description="Time until freedrive ends without a renewal, s.")
    limited_by: str = Field(description='Reason why the arm does not follow the hand; "" if it follows.')
    ended: str = Field(description='Reason for the last end of freedrive; "" if it has never ended.')


@router.endpoint("GET /robot/freedrive", Role.OBSERVER, timeout_s=1.5)
async def freedrive(request: Request) -> FreedriveAnswer:
    """Report whether the arm can be moved by hand now."""
    return _answer(Call(request).services.freedrive)


@router.endpoint(
    "POST /robot/freedrive", Role.OPERATOR, timeout_s=2.0, control=True, responses=responses(409, 501, 503)
)
async def begin_freedrive(body: Freedrive, request: Request) -> FreedriveAnswer:
    """Let a person move the arm by hand: it moves where it is pushed and stays where it is released.

    Freedrive ends by DELETE, by a stop, or if it is not renewed within `timeout_s` with the `session` of the
    answer. A joint slows down before its limit, and the arm before an obstacle, unless the device releases
    its arm itself. If the backend does not support freedrive, the answer is a 501 with its name.
    """
    call = Call(request)
    service = call.services.freedrive
    if body.session is not None:
        service.renew(body.session, body.timeout_s)
    else:
        await service.begin(call.name, body.timeout_s, call.timeout_s)
    return _answer(service)


@router.endpoint("DELETE /robot/freedrive", Role.OPERATOR, timeout_s=5.0, responses=responses(503))
async def end_freedrive(request: Request) -> FreedriveAnswer:
    """End freedrive of any client. Returns when the arm is at rest."""
    service = Call(request).services.freedrive
    await service.end()
    return _answer(service)


def _answer(service: FreedriveService) -> FreedriveAnswer:
    state = service.state
    reason = state.ended if state.session is None else state.limited_by
    return FreedriveAnswer.model_validate({**asdict(state), **reason.fields()})
