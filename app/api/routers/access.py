"""Access tokens: list, create and delete them.

Changes need an administrator's token even if clients need no token. Otherwise any program on this computer
could create a token, and use it once tokens are required.
"""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, cast

from fastapi import Path, Query, Request, Response

from app.api.errors import responses
from app.api.middleware.access import identity_of
from app.api.route import EndpointRouter
from app.api.schemas.access import CreatedToken, CreateToken, KnownToken, TokenEntry, TokensAnswer
from cobot import audit
from cobot.access.authentication import Authenticator
from cobot.access.roles import Identity, Role
from cobot.access.tokens import Token
from cobot.errors import ConflictError
from cobot.strict import shown

FIRST = "cobot token create NAME --role admin"
CHANGE_S = 10.0
"""Timeout for a change, in seconds. A change may wait, because another program can lock the file for
`tokens.LOCKED_S`.
"""

router = EndpointRouter(tags=["operations"])


@router.endpoint("GET /access/tokens", Role.ADMIN, timeout_s=1.5, costly=True, responses=responses(503))
async def access_tokens(request: Request, response: Response) -> TokensAnswer:
    """Return the names, roles and times of all access tokens, but never the tokens or their hashes."""
    response.headers["Cache-Control"] = "no-store"
    found = await asyncio.to_thread(_tokens_of(request).file.read)
    return _listed(request, found)


@router.endpoint(
    "POST /access/tokens",
    Role.ADMIN,
    timeout_s=CHANGE_S,
    responses=responses(403, 409, 503),
)
async def create_access_token(body: CreateToken, request: Request, response: Response) -> CreatedToken:
    """Create an access token, which is valid at once. Only this answer contains the token itself.

    The request must use a token of an administrator.
    """
    audit.add_details(token=body.name, role=body.role)
    by, tokens = _administrator(request), _tokens_of(request)
    lifetime = None if body.days is None else timedelta(days=body.days)
    role = Role[body.role.upper()]
    made, token = await asyncio.to_thread(tokens.file.create_entry, body.name, role, lifetime, by=by)
    tokens.notice_change()
    response.headers["Cache-Control"] = "no-store"
    return CreatedToken(**_facts(made), token=token)


@router.endpoint(
    "DELETE /access/tokens/{name}",
    Role.ADMIN,
    timeout_s=CHANGE_S,
    responses=responses(403, 404, 409, 422, 503),
)
async def delete_access_token(
    name: Annotated[str, Path(description="Name of the token.")],
    request: Request,
    own: Annotated[bool, Query(description="true: delete the token even if this request uses it.")] = False,
) -> TokenEntry:
    """Delete an access token. It is invalid at once, its open WebSockets are closed, and its control ends.

    The last token of an administrator cannot be deleted. The request must use a token of an administrator.
    """
    audit.add_details(token=shown(name))
    by, tokens = _administrator(request), _tokens_of(request)
    gone = await asyncio.to_thread(tokens.file.revoke, name, by=by, own=own)
    tokens.notice_change()
    for services in request.app.state.robots.values():
        services.control.end_if_revoked()
    return TokenEntry(**_facts(gone))


def _tokens_of(request: Request) -> Authenticator:
    return cast(Authenticator, request.app.state.tokens)


def _administrator(request: Request) -> str:
    """Return the name of the token that the request uses.

    Raises:
        ConflictError: the request has no token, or one that the service has granted to a program.
    """
    identity = identity_of(request)
    if not identity.stored:
        raise ConflictError(_hint(request, identity))
    return identity.name


def _listed(request: Request, found: tuple[Token, ...]) -> TokensAnswer:
    identity, tokens = identity_of(request), _tokens_of(request)
    return TokensAnswer(
        tokens=[
            KnownToken(
                **_facts(each),
                last_used=_moment(tokens.last_used_ns(each.sha256)),
                own=identity.stored and each.name == identity.name,
            )
            for each in found
        ],
        required=request.app.state.tokens_required,
        hint="" if identity.stored else _hint(request, identity),
    )


def _hint(request: Request, identity: Identity) -> str:
    """Describe what a client without a token from the token file must do first."""
    if request.app.state.tokens_required:
        return f"{identity.name} has no token in the token file; use an administrator's token: {FIRST}"
    setting = request.app.state.web.authentication
    return (
        f"this service needs no tokens (web.authentication: {setting}); create the first one on the robot's "
        f"computer with `{FIRST}`, set web.authentication: required, and start cobot again"
    )


def _facts(token: Token) -> dict[str, Any]:
    expires = None if token.expires is None else token.expires.isoformat()
    return {
        "name": token.name,
        "role": token.role,
        "created": token.created.isoformat(),
        "expires": expires,
    }


def _moment(time_ns: int | None) -> str | None:
    return None if time_ns is None else datetime.fromtimestamp(time_ns // 10**9, UTC).isoformat()
