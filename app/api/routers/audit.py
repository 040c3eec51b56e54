"""Who did what."""

from __future__ import annotations

import asyncio
from typing import Annotated, cast

from fastapi import APIRouter, Query, Request, Response

from app.api.costly import Costly
from app.api.errors import responses
from app.api.schemas import AuditAnswer, AuditQuery
from cobot.audit import Audit

router = APIRouter(tags=["operations"])


@router.get("/audit", response_model=AuditAnswer, responses=responses(422))
async def audit(query: Annotated[AuditQuery, Query()], request: Request) -> Response:
    """What was asked for that changes something, by whom, and what became of it; the newest first."""
    state = request.app.state
    async with cast(Costly, state.costly).turn():
        content = await asyncio.to_thread(_newest, cast(Audit, state.audit), query)
    return Response(content, media_type="application/json")


def _newest(kept: Audit, query: AuditQuery) -> str:
    """As JSON. Reads files: for a thread."""
    entries = kept.newest(query.limit, query.since)
    answer = AuditAnswer.model_validate({"entries": entries, "lost": kept.dropped, "problem": kept.problem})
    return answer.model_dump_json(by_alias=True)
