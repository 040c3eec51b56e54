"""Handles the header `Idempotency-Key`, with which a client can safely repeat a request that begins a job.
The repeated request begins no second job.

The second request with a key gets the answer to the first one, and waits if the first one is still in
progress. If a request was rejected and has begun nothing, its key can be used again.

Source: draft-ietf-httpapi-idempotency-key-header, which also defines the status 422 for a different request
with the same key.
"""

from __future__ import annotations

import asyncio
import hashlib
import re
from collections.abc import Callable, Coroutine
from typing import Any, cast
from urllib.parse import parse_qsl

from fastapi import Request, Response

from app.api.dependencies import JOB, JOB_ID, LARGE_BYTES
from app.api.middleware.access import identity_of
from app.api.middleware.versions import plain_path
from app.services.keys import Keys, Noted, StoredAnswer
from app.services.rights.job import Job, new_job_id
from cobot import audit
from cobot.addresses import IDEMPOTENCY_KEY
from cobot.errors import ConflictError, InputError
from cobot.strict import shown

REPLAYED = "Idempotent-Replayed"
"""Header of a replayed answer."""
MAX_KEY = 255
_KEY = re.compile(rf"[\x21-\x7e]{{1,{MAX_KEY}}}")
PARAMETER: dict[str, Any] = {
    "name": IDEMPOTENCY_KEY,
    "in": "header",
    "required": False,
    "description": "A new random value for each job, such as a UUID. For 24 hours, the same "
    "request with the same key starts nothing and gets the first answer.",
    "schema": {"type": "string", "minLength": 1, "maxLength": MAX_KEY, "pattern": "^[\\x21-\\x7e]+$"},
}
Handler = Callable[[Request], Coroutine[Any, Any, Response]]


def _key_of(request: Request) -> str:
    """Return the key of a request that has one, without the quotation marks that the draft requires.

    Raises:
        InputError: the key is empty, too long, has invalid characters, or occurs several times.
    """
    values = request.headers.getlist(IDEMPOTENCY_KEY)
    key = values[0].strip()
    if len(key) > 1 and key[0] == key[-1] == '"':
        key = key[1:-1]
    if len(values) > 1:
        raise InputError(f"{IDEMPOTENCY_KEY} occurs {len(values)} times, allowed: one")
    if len(key) > MAX_KEY:
        raise InputError(f"{IDEMPOTENCY_KEY} has {len(key)} characters, allowed: 1 to {MAX_KEY}")
    if not _KEY.fullmatch(key):
        raise InputError(
            f"{IDEMPOTENCY_KEY} is {shown(key)}, allowed: 1 to {MAX_KEY} printable ASCII characters "
            "without spaces, such as a UUID"
        )
    return key


async def answer_once(request: Request, handler: Handler) -> Response:
    """Process a request that has a key, unless a request with the same key has already been processed.

    Raises:
        InputError: the key is not valid, or is that of another request.
        ConflictError: the first request has no answer, because its client disconnected or the service was
            killed.
        UnavailableError: the key cannot be kept; nothing has begun.
        Exception: any error that the handler raises.
    """
    keys, key = cast(Keys, request.app.state.keys), _key_of(request)
    digest = hashlib.sha256(f"{identity_of(request).name}\0{key}".encode()).digest()
    body = await request.body()
    same = (
        await asyncio.to_thread(_digest, request, body) if len(body) > LARGE_BYTES else _digest(request, body)
    )
    async with keys.turn(digest):
        job = new_job_id()
        noted = await keys.note(digest, same, job)
        if noted is not None:
            return _again(noted, same, key)
        request.scope[JOB_ID] = job
        try:
            response = await handler(request)
        except Exception:
            if not _has_begun(request):
                await keys.forget(digest)
            raise
        answer = StoredAnswer(
            response.status_code,
            response.media_type or response.headers.get("content-type", ""),
            response.headers.get("location"),
            bytes(response.body),
        )
        await asyncio.shield(keys.answer(digest, answer))
        return response


def _has_begun(request: Request) -> bool:
    job: Job | None = request.scope.get(JOB)
    return job is not None and job.record().started_at is not None


def _again(noted: Noted, same: bytes, key: str) -> Response:
    if noted.request != same:
        raise InputError(
            f"{IDEMPOTENCY_KEY} {shown(key)} was used for another request in the last 24 hours: send the "
            f"same path, query and body, or use a new key"
        )
    if noted.answer is None:
        raise ConflictError(
            f"{IDEMPOTENCY_KEY} {shown(key)}: the first request with this key ended without an answer, "
            "because its client disconnected or the service ended. The request is not repeated: see "
            f"GET /jobs/{noted.job}, or GET /jobs if there is no such job. To repeat it, use a new key"
        )
    audit.add_details(replayed=True)
    headers = {REPLAYED: "true"} | ({"Location": noted.answer.location} if noted.answer.location else {})
    return Response(noted.answer.body, noted.answer.status, headers, noted.answer.type)


def _digest(request: Request, body: bytes) -> bytes:
    """Calculate a digest that identifies equal requests. It ignores the boundary of a form, which differs
    each time.
    """
    found = re.search(r'boundary="?([^";,]+)', request.headers.get("content-type", ""))
    if found is not None:
        body = body.replace(b"--" + found[1].encode("latin-1"), b"--")
    query = sorted(
        pair for pair in parse_qsl(request.url.query, keep_blank_values=True) if pair[0] != "strict"
    )
    digest = hashlib.sha256(f"{plain_path(request.scope)}\0{query}\0".encode())
    digest.update(body)
    return digest.digest()
