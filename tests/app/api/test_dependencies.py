"""What is polled is answered in a short way: the answers are FastAPI's all the same.

Oracle: FastAPI's own handler, of the same endpoint as a plain `APIRoute`.
"""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import httpx
import pytest
from fastapi import APIRouter, Depends, FastAPI, Query, Request, Response
from fastapi.exceptions import ResponseValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel, Field

from app.api.json_text import decoded
from app.api.route import CobotRoute
from cobot.errors import InputError, UnavailableError


class Answer(BaseModel):
    """With a name that is another one in JSON."""

    value: float = Field(alias="theValue")
    more: list[float] = []


async def model(request: Request) -> Answer:
    return Answer(theValue=float("nan"), more=[0.1, 1e-300, float("inf")])


async def several(request: Request) -> list[Answer]:
    return [Answer(theValue=1.0)]


async def fields(request: Request) -> Answer:
    return {"theValue": 2, "unknown": 1}  # type: ignore[return-value]


async def itself(request: Request) -> Answer:
    return Response("ready", 202)  # type: ignore[return-value]


async def wrong(request: Request) -> Answer:
    return {"theValue": "no"}  # type: ignore[return-value]


async def refused(request: Request) -> Answer:
    raise UnavailableError("there is none")


def answer(kind: type[APIRoute], endpoint: Any, query: str = "lines=7") -> httpx.Response:
    app = FastAPI()
    router = APIRouter(route_class=kind)
    router.add_api_route("/asked/{robot}", endpoint, methods=["GET"])
    app.router.routes.extend(router.routes)

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://robot") as client:
            return await client.get(f"/asked/left?{query}")

    return asyncio.run(ask())


def require_equal(endpoint: Any) -> None:
    ours, theirs = (answer(kind, endpoint) for kind in (CobotRoute, APIRoute))
    assert (ours.status_code, ours.content) == (theirs.status_code, theirs.content)
    assert ours.headers == theirs.headers


@pytest.mark.parametrize("endpoint", [model, several, fields, itself])
def test_an_answer_is_that_of_fastapi(endpoint: Any) -> None:
    require_equal(endpoint)


@pytest.mark.parametrize(
    ("endpoint", "error"), [(wrong, ResponseValidationError), (refused, UnavailableError)]
)
def test_what_is_wrong_is_raised(endpoint: Any, error: type[Exception]) -> None:
    for kind in (CobotRoute, APIRoute):
        with pytest.raises(error):
            answer(kind, endpoint)


async def nothing() -> None: ...


async def with_query(request: Request, lines: Annotated[int, Query(ge=1)] = 3) -> Answer:
    return Answer(theValue=lines)


async def with_dependency(request: Request, _: Annotated[None, Depends(nothing)]) -> Answer:
    return Answer(theValue=0.0)


async def with_response(request: Request, response: Response) -> Answer:
    response.headers["x-more"] = "1"
    return Answer(theValue=0.0)


def plain(request: Request) -> Answer:
    return Answer(theValue=0.0)


@pytest.mark.parametrize("endpoint", [with_query, with_dependency, with_response, plain])
def test_whoever_takes_more_than_the_request_is_given_it(endpoint: Any) -> None:
    require_equal(endpoint)
    assert answer(CobotRoute, with_query, "lines=0").status_code == 422


def test_a_number_without_end_is_refused_in_words_of_its_own() -> None:
    with pytest.raises(InputError) as refused:
        decoded(b"[" + b"1" * 4301 + b"]", "the body")
    assert str(refused.value) == "the body: a whole number has 4301 characters, allowed: 4300"
