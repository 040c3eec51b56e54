"""The audit log."""

from __future__ import annotations

import asyncio
from typing import Annotated, cast

from fastapi import Query, Request, Response

from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.service import AuditAnswer, AuditQuery
from cobot.access.roles import Role
from cobot.audit import Audit

router = EndpointRouter(tags=["operations"])


@router.endpoint(
    "GET /audit", Role.ADMIN, timeout_s=1.5, costly=True, response_model=AuditAnswer, responses=responses(422)
)
async def audit(query: Annotated[AuditQuery, Query()], request: Request) -> Response:
    """Return the requests that change something, with their client and result, the newest first."""
    state = request.app.state
    content = await asyncio.to_thread(_newest, cast(Audit, state.audit), query)
    return Response(content, media_type="application/json")


def _newest(kept: Audit, query: AuditQuery) -> str:
    """Return the newest entries as JSON. This reads files, so call it in a thread."""
    entries = kept.newest(query.limit, query.since, query.after)
    answer = AuditAnswer.model_validate({"entries": entries, "lost": kept.dropped, "problem": kept.problem})
    return answer.model_dump_json(by_alias=True)
