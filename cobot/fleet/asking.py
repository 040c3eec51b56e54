"""Requests that `cobot fleet` sends to the hub."""

from __future__ import annotations

import argparse
import getpass
import os
from typing import Any
from urllib.parse import quote

import httpx2

from cobot.addresses import CLIENT_NAME, check_url
from cobot.client.tls import advice, tls_context, token_header
from cobot.errors import BY_CODE, CobotError, UnavailableError

URL_VARIABLE = "COBOT_FLEET"
DEFAULT_URL = "http://127.0.0.1:8070"
TIMEOUT_S = 5.0


def ask(
    chosen: argparse.Namespace, method: str, path: str, body: object = None, timeout_s: float = TIMEOUT_S
) -> dict[str, Any]:
    """The hub's answer as JSON. See `get`."""
    return _decoded(get(chosen, method, path, body, timeout_s))


def get(
    chosen: argparse.Namespace, method: str, path: str, body: object = None, timeout_s: float = TIMEOUT_S
) -> httpx2.Response:
    """The hub's answer.

    Raises:
        CobotError: the hub does not answer, or answers with an error.
    """
    check_url(chosen.url)
    try:
        response = httpx2.request(
            method,
            chosen.url.rstrip("/") + path,
            json=None if isinstance(body, bytes) else body,
            content=body if isinstance(body, bytes) else None,
            headers=headers(chosen),
            timeout=timeout_s,
            verify=tls_context(True),
            trust_env=False,  # a stop must not go through the web proxy that the environment names
        )
    except httpx2.HTTPError as exc:
        reason = str(exc) or type(exc).__name__
        raise UnavailableError(
            f"the hub at {chosen.url} does not answer: {reason}{advice(exc)}; start it with "
            f"`cobot fleet serve`, or set its URL with {URL_VARIABLE} or --url"
        ) from exc
    if response.status_code == 200:
        return response
    answer = _decoded(response)
    kind = BY_CODE.get(str(answer.get("code")), CobotError)
    raise kind(str(answer.get("detail", response.status_code)))


def _decoded(response: httpx2.Response) -> dict[str, Any]:
    """Decode the JSON object in an answer.

    Raises:
        UnavailableError: the answer is not from a hub.
    """
    try:
        answer = response.json()
    except ValueError:
        answer = None
    if not isinstance(answer, dict):
        raise UnavailableError(
            f"{response.url}: status {response.status_code}, the answer does not come from a hub of cobot; "
            f"check the URL in {URL_VARIABLE} or --url"
        )
    return answer


def headers(chosen: argparse.Namespace) -> dict[str, str]:
    """Headers with the name and token of the person who runs the command."""
    return {CLIENT_NAME: quote(_user(), safe="")} | token_header(chosen.token)


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # this user number has no name
        return str(os.getuid())
