"""Backup and restore of the user's configuration, and an archive for support."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from typing import Annotated

from fastapi import File, Request, Response, UploadFile

from app.api.errors import responses
from app.api.metrics import Metrics
from app.api.route import EndpointRouter
from app.api.routers.common import health
from app.api.routers.jobs import newest_jobs
from app.api.schemas.jobs import JobsAnswer, job_answer
from app.api.schemas.service import RestoreAnswer
from cobot import audit
from cobot.access.roles import Role
from cobot.launch.backup.backup import make_backup, read_backup, stage
from cobot.launch.backup.support import make_bundle

MEDIA_TYPE = "application/zip"
ARCHIVE = {200: {"content": {MEDIA_TYPE: {"schema": {"type": "string", "format": "binary"}}}}}
MAX_JOBS, MAX_EVENTS = 200, 1000

router = EndpointRouter(tags=["operations"])


@router.endpoint(
    "GET /admin/backup",
    Role.ADMIN,
    timeout_s=20.0,
    costly=True,
    response_class=Response,
    responses=responses(503) | ARCHIVE,
)
async def backup(request: Request) -> Response:
    """Return the settings file, tool, scene with frames, taught positions and stored programs as a ZIP
    archive.

    The archive contains no tokens, certificates, recordings or logs.
    """
    known = request.app.state.reloading
    return _archive("backup", await asyncio.to_thread(make_backup, known.settings, known.user_file))


@router.endpoint("POST /admin/restore", Role.ADMIN, timeout_s=60.0, responses=responses(413, 422, 503))
async def restore(
    request: Request, file: Annotated[UploadFile, File(description="An archive of GET /admin/backup.")]
) -> RestoreAnswer:
    """Check a backup completely, and restore it at the next start of cobot. Nothing changes before that.

    The backup must have robots with the same names and joints, and must not come from a newer cobot.
    """
    known = request.app.state.reloading
    content = await file.read()
    found = await asyncio.to_thread(read_backup, content, known.settings)
    await asyncio.to_thread(stage, known.settings, content)
    audit.add_details(created=str(found.about.get("created")), bytes=len(content))
    return RestoreAnswer(created=str(found.about.get("created")), contents=found.summary)


@router.endpoint(
    "GET /admin/support",
    Role.ADMIN,
    timeout_s=20.0,
    costly=True,
    response_class=Response,
    responses=ARCHIVE,
)
async def support(request: Request) -> Response:
    """Return settings without secrets, versions, health, logs, events, jobs and statistics as a ZIP
    archive.
    """
    state = request.app.state
    newest = state.events.since(max(0, state.events.newest - MAX_EVENTS), MAX_EVENTS)
    live = {
        "health.json": (await health(request)).model_dump_json(indent=1).encode(),
        "jobs.json": _jobs(request),
        "events.jsonl": "\n".join(each.text for each in newest).encode(),
        "metrics.txt": Metrics(state).text(),
    }
    return _archive("support", await asyncio.to_thread(make_bundle, state.reloading.settings, live))


def _jobs(request: Request) -> bytes:
    answers = [job_answer(each) for each in newest_jobs(request, MAX_JOBS)]
    return JobsAnswer(jobs=answers).model_dump_json(indent=1).encode()


def _archive(kind: str, content: bytes) -> Response:
    name = f"cobot-{kind}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.zip"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(content, media_type=MEDIA_TYPE, headers=headers)
