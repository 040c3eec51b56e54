"""Who did what."""

from __future__ import annotations

import asyncio
from typing import Annotated, cast

from fastapi import APIRouter, Query, Request

from app.api.errors import responses
from app.api.schemas import AuditAnswer, AuditQuery
from cobot.audit import Audit

router = APIRouter(tags=["audit"])


@router.get("/audit", responses=responses(422))
async def audit(query: Annotated[AuditQuery, Query()], request: Request) -> AuditAnswer:
    """What was asked for that changes something, by whom, and what became of it; the newest first."""
    kept = cast(Audit, request.app.state.audit)
    entries = await asyncio.to_thread(kept.newest, query.limit, query.since)
    return AuditAnswer.model_validate({"entries": entries, "lost": kept.dropped, "problem": kept.problem})
