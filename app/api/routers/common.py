"""Stop and health of one robot or of all robots."""

from __future__ import annotations

import asyncio
import os
from dataclasses import asdict
from typing import Annotated

from fastapi import Query, Request
from starlette.datastructures import State

from app.api.dependencies import Call, addressed
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.robot import StopAnswer
from app.api.schemas.service import HealthAnswer, ReadyAnswer
from app.services.rights.stopping import HELD, together
from cobot import audit, logs
from cobot.access.roles import Role
from cobot.errors import NotReadyError

router = EndpointRouter(tags=["common"])


Category = Annotated[
    int,
    Query(
        ge=1,
        le=2,
        description="Stop category of IEC 60204-1. 2: at rest on the path, held by the drives. 1: at rest as "
        "fast as the limits permit, then the drives go off, until POST /robot/reset. Category 0 is the "
        "robot's own emergency stop.",
    ),
]


@router.endpoint("POST /stop", Role.OBSERVER, timeout_s=10.0, responses=responses(422))
async def stop(request: Request, category: Category = HELD) -> StopAnswer:
    """End the sequence, the planning and the motion. The arm stops on its path.

    Without the name of a robot it stops all robots and reports on all of them. It takes no body, needs no
    control, and may be repeated. It is not an emergency stop: it neither removes power nor replaces the
    robot's own safety system.
    """
    call = Call(request)
    robots = addressed(request)
    stopped = await asyncio.gather(
        *(each.stopping.stop(call.timeout_s, category=category) for each in robots.values())
    )
    stop = together(dict(zip(robots, stopped, strict=True)))
    audit.add_details(message=stop.message)
    return StopAnswer.model_validate(asdict(stop) | {"confirmed_by": stop.confirmed_by})


@router.endpoint("GET /health/ready", Role.PUBLIC, timeout_s=1.5, responses=responses(503))
async def ready(request: Request) -> ReadyAnswer:
    """Report whether the robot would execute motions. If not, the answer is a 503 with the reasons.

    Ready means that the real-time process is running and reads its robot, that the planners have started, and
    that no e-stop or fault is latched. A moving robot is ready. Without a robot name, all robots must be
    ready.
    """
    robots = {name: services.health.obstacles() for name, services in addressed(request).items()}
    obstacles = [f"{name}: {each}" for name, found in robots.items() for each in found]
    if obstacles:
        raise NotReadyError("; ".join(obstacles))
    return ReadyAnswer(status="ready", robots=list(robots))


@router.endpoint("GET /health", Role.OBSERVER, timeout_s=1.5)
async def health(request: Request) -> HealthAnswer:
    """Return the state of the processes, cycle times, interventions of the safety layer, and versions.

    Without a robot name, `robots` has the health of each; the other fields are those of the default robot.
    """
    robots = {name: asdict(services.health.health()) for name, services in addressed(request).items()}
    written, problems = _written(request.app.state)
    for each in robots.values():
        each["service"] |= written
        each["problems"] += problems
    for name, services in addressed(request).items():
        kept = (services.jobs.book.problem, services.positions.problem, services.gripper.problem)
        robots[name]["problems"] += filter(None, kept)
    for each in robots.values():
        each["status"] = "degraded" if each["problems"] else "ok"
    first = next(iter(robots.values()))
    return HealthAnswer.model_validate({**first, "robots": robots})


def _written(state: State) -> tuple[dict[str, object], list[str]]:
    """Return the numbers of lost log and audit lines, and the reasons why nothing can be written now."""
    file, terminal, error = state.losses.read()
    lost = {"service": logs.dropped(), "file": file, "terminal": terminal, "audit": state.audit.dropped}
    problems = [f"the log file cannot be written: {os.strerror(error)}"] if error else []
    if state.audit.problem:
        problems.append(f"the audit: {state.audit.problem}")
    return {"lost_lines": lost}, problems
