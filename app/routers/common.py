"""What concerns everything: stop, and health."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import APIRouter

from app.dependencies import ServicesDep, Timeout
from app.schemas import HealthAnswer, StopAnswer

router = APIRouter(tags=["common"])


@router.post("/stop")
async def stop(services: ServicesDep, timeout: Timeout) -> StopAnswer:
    """End the sequence, the planning and the motion: the arm comes to rest on its path.

    Takes no body, asks for no ownership, and may be repeated. It is no emergency stop: it neither
    removes power nor replaces the robot's own safety system.
    """
    return StopAnswer.model_validate(asdict(await services.stopping.stop(timeout)))


@router.get("/health")
async def health(services: ServicesDep) -> HealthAnswer:
    """Processes, cycle times, interventions of the safety layer, versions."""
    return HealthAnswer.model_validate(asdict(services.health.health()))
