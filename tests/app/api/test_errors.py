"""The one mapping of errors to HTTP statuses.

Oracle: the tree of `cobot.errors` itself, walked class by class, and RFC 9110's classes of statuses.
"""

from __future__ import annotations

import asyncio
import json
import math
import sys

import httpx
import pytest
from fastapi import FastAPI
from folders import ROOT
from virtual_service import VirtualService

from app.api.errors import STATUS, answer_to, install, status_of
from cobot import errors
from cobot.errors import CobotError, LimitError
from cobot.findings import Finding

TREE = [each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, CobotError)]


@pytest.mark.parametrize("kind", TREE)
def test_every_error_of_the_tree_is_answered_with_its_status_code_and_sentence(
    kind: type[CobotError],
) -> None:
    app = FastAPI()
    install(app)

    @app.get("/")
    async def fail() -> None:
        raise kind("joint1 is 9 rad, allowed: -2.97 to 2.97 rad")

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://cobot") as client:
            return await client.get("/")

    answer = asyncio.run(ask())
    assert answer.status_code == status_of(kind("why"))
    assert answer.json() == {"detail": "joint1 is 9 rad, allowed: -2.97 to 2.97 rad", "code": kind.code}


PROBLEM = "application/problem+json"


@pytest.mark.parametrize(
    ("accept", "problem"),
    [
        (PROBLEM, True),
        (f"application/json, {PROBLEM.upper()};q=0.5", True),
        (f"{PROBLEM};q=0", False),
        (f"{PROBLEM}; q=0.00", False),
        ("*/*", False),
        ("application/problem+xml", False),
        (f"x{PROBLEM}", False),
    ],
)
def test_an_error_has_the_form_of_rfc_9457_for_clients_that_accept_it(
    service: VirtualService, accept: str, problem: bool
) -> None:
    """Oracle: RFC 9457, 3.1: the types of its members, and its media type."""
    for path, status in (("/jobs/none", 404), ("/nothing", 404), ("/v1/jobs?n=x", 422), ("/stop", 405)):
        answer = service.ask("GET", path, headers={"Accept": accept, "X-Request-Id": "mine"})
        plain = service.get(path).json()
        assert answer.status_code == status
        assert answer.headers["content-type"] == (PROBLEM if problem else "application/json")
        assert int(answer.headers["content-length"]) == len(answer.content)
        found = answer.json()
        assert found.items() >= plain.items()
        if problem:
            assert (found["status"], found["request_id"]) == (status, "mine")
            assert found["type"] == f"urn:cobot:error:{plain['code']}"
            assert isinstance(found["title"], str)
            page, _, place = found["manual"].removeprefix("/manual/").partition("#")
            source = (ROOT / "docs" / page).with_suffix(".md").read_text(encoding="utf-8")
            assert f"\n## {place}\n" in source.lower() or f"\n### {place}\n" in source.lower()
        else:
            assert found == plain


def test_each_code_that_is_answered_is_in_the_schema(service: VirtualService) -> None:
    models = service.get("/openapi.json").json()["components"]["schemas"]
    listed = models["ErrorAnswer"]["properties"]["code"]["enum"]
    assert set(listed) >= {kind.code for kind in TREE}
    (code,) = (each for each in models["MoveAnswer"]["properties"]["code"]["oneOf"] if "enum" in each)
    assert code["enum"] == listed


@pytest.mark.parametrize("kind", TREE)
def test_what_the_caller_can_mend_is_a_4xx_and_what_he_cannot_a_5xx(kind: type[CobotError]) -> None:
    theirs = (errors.InputError, errors.PlanningError, errors.ExecutionError, errors.ConflictError)
    bodies = (errors.PayloadError, errors.MediaTypeError)
    access = (errors.AuthenticationError, errors.PermissionDenied)
    assert status_of(kind("why")) // 100 == (4 if issubclass(kind, theirs + bodies + access) else 5)


def test_an_error_that_somebody_derives_is_answered_as_its_ancestor() -> None:
    for kind, status in STATUS.items():
        special = type("Special", (kind,), {})
        assert status_of(special("why")) == status


def test_a_number_that_has_overflowed_is_the_largest_one() -> None:
    """Oracle: the standard library's strict JSON."""
    found = Finding("limit", "velocity", -math.inf, 1.0, "rad/s", of=("joint1",))
    answer = answer_to(LimitError("joint1 would be too fast", findings=[found]))
    (check,) = json.loads(answer.body)["explain"]["checks"]
    assert check["value"] == -check["by"] == -sys.float_info.max
