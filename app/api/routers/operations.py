"""Endpoints for administrators: liveness, metrics and a reload of the configuration."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import Request, Response
from prometheus_client import CONTENT_TYPE_PLAIN_0_0_4

from app.api.errors import responses
from app.api.metrics import Metrics
from app.api.route import EndpointRouter
from app.api.schemas.service import LiveAnswer, ReloadAnswer
from cobot.access.roles import Role

router = EndpointRouter(tags=["operations"])


@router.endpoint("GET /health/live", Role.PUBLIC, timeout_s=1.5)
async def live() -> LiveAnswer:
    """Report that the service is running. If there is no answer, restart it. The answer says nothing about
    the robots.
    """
    return LiveAnswer(status="live")


@router.endpoint(
    "GET /metrics",
    Role.OBSERVER,
    timeout_s=1.5,
    costly=True,
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def metrics(request: Request) -> Response:
    """Return cycle times, overruns, interventions, motions, requests, sessions and restarts, for
    Prometheus.
    """
    return Response(Metrics(request.app.state).text(), media_type=CONTENT_TYPE_PLAIN_0_0_4)


@router.endpoint(
    "POST /admin/reload", Role.ADMIN, timeout_s=60.0, control=True, responses=responses(409, 422, 503)
)
async def reload(request: Request) -> ReloadAnswer:
    """Read named positions, joint limits and web settings again. Possible only while nothing moves.

    If a file is not valid, the answer says where, and nothing changes. Takes no body. Changed limits restart
    the real-time process while the arm is at rest. This takes about a second.
    """
    return ReloadAnswer.model_validate(asdict(await request.app.state.reloading.reload()))
