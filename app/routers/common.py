"""What concerns everything: stop, and health."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter, Request

from app.dependencies import Call
from app.schemas import HealthAnswer, StopAnswer

router = APIRouter(tags=["common"])


@router.post("/stop")
async def stop(request: Request) -> StopAnswer:
    """End the sequence, the planning and the motion: the arm comes to rest on its path.

    Takes no body, asks for no ownership, and may be repeated. It is no emergency stop: it neither
    removes power nor replaces the robot's own safety system.
    """
    call = Call(request)
    return StopAnswer.model_validate(asdict(await call.services.stopping.stop(call.timeout_s)))


@router.get("/health")
async def health(request: Request) -> HealthAnswer:
    """Processes, cycle times, interventions of the safety layer, versions."""
    call = Call(request)
    return HealthAnswer.model_validate(asdict(call.services.health.health()))
