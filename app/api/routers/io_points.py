"""Inputs and outputs of the device, by name."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Request
from pydantic import BaseModel, Field

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.device import IoAnswer
from cobot import audit
from cobot.access.roles import Role
from cobot.loose_lists import RequestModel
from cobot.motions.fields import Finite, example

router = EndpointRouter(tags=["robot"])


class SetOutput(RequestModel):
    """The new value of an output."""

    model_config = example({"value": True})

    value: bool | int | Finite = Field(
        description="boolean: true or false; digital: a whole number from 0 on; analog: a number."
    )


class IoListAnswer(BaseModel):
    """All inputs and outputs of the device."""

    backend: str = Field(description="The setting robot.backend.")
    supported: bool = Field(description="Whether this backend can have inputs and outputs.")
    points: list[IoAnswer] = Field(description="The inputs and outputs, in the device's order.")


@router.endpoint("GET /robot/io", Role.OBSERVER, timeout_s=1.5, responses=responses(503))
async def inputs_and_outputs(request: Request) -> IoListAnswer:
    """Return the inputs and outputs, with the values that the device reports."""
    backend, points = Call(request).services.io.points()
    return IoListAnswer(
        backend=backend,
        supported=points is not None,
        points=[IoAnswer.of(each) for each in points or ()],
    )


@router.endpoint(
    "PUT /robot/io/{name}",
    Role.OPERATOR,
    timeout_s=1.5,
    control=True,
    responses=responses(404, 409, 502, 503, 504),
)
async def set_output(
    name: Annotated[str, Path(max_length=200, description="Name of an output.")],
    body: SetOutput,
    request: Request,
) -> IoAnswer:
    """Set an output. Returns when the device reports the value.

    Also works while the arm is moving. If the device does not report the value within the endpoint's timeout,
    the answer is a 504 with the value that it reports.
    """
    call = Call(request)
    audit.add_details(value=body.value)
    return IoAnswer.of(await call.services.io.set_output(name, body.value, call.timeout_s))
