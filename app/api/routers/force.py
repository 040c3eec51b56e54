"""Forces and torques that the surroundings exert on the arm."""

from __future__ import annotations

from typing import Literal

from fastapi import Request
from pydantic import BaseModel, Field

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from cobot import audit
from cobot.access.roles import Role
from cobot.motions.fields import example

router = EndpointRouter(tags=["force"])


class ForceZeroAnswer(BaseModel):
    """The zero of forces and torques."""

    model_config = example(
        {
            "success": True,
            "force": [0.1, -0.2, 1.3],
            "torque": [0.0, 0.1, 0.0],
            "joints": [0.0, 0.1, 0.0, -0.1, 0.0, 0.0, 0.0],
        }
    )

    success: Literal[True] = Field(description="Always true.")
    force: list[float] = Field(description="Force at the TCP that counts as zero, in the base frame, N.")
    torque: list[float] = Field(description="Torque at the TCP that counts as zero, in the base frame, N·m.")
    joints: list[float] = Field(description="External torque of each joint that counts as zero, N·m.")


@router.endpoint(
    "POST /robot/force/zero", Role.OPERATOR, timeout_s=5.0, control=True, responses=responses(409, 501, 503)
)
async def zero_force(request: Request) -> ForceZeroAnswer:
    """Define the force and torque that are now measured at rest as zero.

    Motions whose `until` has `relative_to: "zero"` use this zero. A new tool and a restart of the service
    make it invalid.
    """
    call = Call(request)
    zero = await call.services.motion.force_zero.make(call.timeout_s)
    audit.add_details(force=zero.wrench.tolist())
    return ForceZeroAnswer(
        success=True,
        force=zero.wrench[:3].tolist(),
        torque=zero.wrench[3:].tolist(),
        joints=zero.torques.tolist(),
    )
