"""Bodies that are made to keep the event loop: what they cost is counted, in errors and pieces, not in time.

Oracle: the bound of errors that a sentence of ten needs not exceed, and the bytes themselves.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Annotated, Any

import httpx
import pytest
from fastapi import APIRouter, FastAPI, File, UploadFile
from mcp.server.mcpserver.utilities.func_metadata import func_metadata
from pydantic import BaseModel, ValidationError

from app.api.route import PIECE_BYTES, CobotRoute, pieces
from app.api.schemas.plans import PlanPath
from app.api.schemas.scene import ChangeScene
from app.api.schemas.tool import ChangeTool
from app.api.schemas.trajectories import SendTrajectory
from app.mcp.tools import TOOLS, plan_to_joints
from cobot.motions.bodies import MoveJoints, MoveSequence

MAX_ERRORS = 5000
"""Each costs some 8 µs."""


def _through(count: int) -> dict[str, Any]:
    return {"motions": [{"through": [{}] * count}] * 50}


BOMBS: list[tuple[type[BaseModel], Callable[[], Any]]] = [
    (MoveSequence, lambda: _through(200)),
    (MoveSequence, lambda: {"motions": [{}] * 50_000}),
    (PlanPath, lambda: {"poses": [{}] * 50_000}),
    (SendTrajectory, lambda: {"points": [{}] * 50_000}),
    (
        MoveJoints,
        lambda: {"joints": [0] * 7, "constraints": {"joints": {f"j{n}": [] for n in range(50_000)}}},
    ),
    *(
        (ChangeScene, lambda name=name: {name: {f"a{n}": {} for n in range(50_000)}})
        for name in ("objects", "frames", "attach")
    ),
    *(
        (ChangeScene, lambda name=name: {"objects": {"a": {"shape": "mesh", name: [[]] * 50_000}}})
        for name in ("vertices", "triangles", "points")
    ),
    (ChangeScene, lambda: {"objects": {"a": {"shape": "height_field", "heights": [[""] * 50_000]}}}),
    (ChangeScene, lambda: {"allowed": [[]] * 50_000}),
    (ChangeScene, lambda: {"detach": [0] * 50_000}),
    (ChangeTool, lambda: {"shapes": {f"a{n}": {} for n in range(50_000)}}),
]


@pytest.mark.parametrize(("model", "body"), BOMBS)
def test_a_body_full_of_mistakes_is_not_looked_through_to_its_end(
    model: type[BaseModel], body: Callable[[], Any]
) -> None:
    with pytest.raises(ValidationError) as refused:
        model.model_validate(body())
    assert refused.value.error_count() <= MAX_ERRORS


@pytest.mark.parametrize("joints", [["x"] * 350_000, [], [0.0] * 65, '["x"' + ', "x"' * 350_000 + "]"])
def test_the_arguments_of_an_agents_tool_are_not_looked_through_to_their_end(joints: Any) -> None:
    """These kept the service for two seconds, and were answered with 78 MB."""
    metadata = func_metadata(plan_to_joints, skip_names=["ctx"])
    with pytest.raises(ValidationError) as refused:
        metadata.validate_arguments({"joints": joints, "robot": "x" * 100})
    assert refused.value.error_count() == 2, "the first of the joints, and the name"


@pytest.mark.parametrize("tool", [tool for tool, _, _ in TOOLS])
def test_no_text_that_an_agent_gives_is_without_a_bound(tool: Callable[..., Any]) -> None:
    """Texts in lists and objects too; the bounds are REST's, whose longest is that of a position's name."""
    schema = func_metadata(tool, skip_names=["ctx"]).arg_model.model_json_schema()
    for text in texts_of(schema):
        assert "enum" in text or "const" in text or 0 < text["maxLength"] <= 200, text


def texts_of(schema: Any) -> Iterator[dict[str, Any]]:
    """The schemas of all texts within a schema."""
    if isinstance(schema, dict):
        if schema.get("type") == "string":
            yield schema
        schema = list(schema.values())
    for each in schema if isinstance(schema, list) else ():
        yield from texts_of(each)


@pytest.mark.parametrize("content", [b"\r\n--B-" * 9000, b"\r" * 65536, b"\r\n0.1" * 300])
def test_what_looks_like_boundaries_is_taken_in_small_pieces(content: bytes) -> None:
    found = list(pieces(content))
    assert b"".join(found) == content
    assert max(map(len, found)) <= PIECE_BYTES


@pytest.mark.parametrize("content", [bytes(65536), b"0.1,0.2\n" * 8000, b""])
def test_all_else_is_taken_at_once(content: bytes) -> None:
    assert b"".join(pieces(content)) == content
    assert len(list(pieces(content))) <= 1


def test_an_upload_of_what_looks_like_boundaries_lets_others_have_the_loop() -> None:
    """A chunk of 64 KiB kept everybody, a stop too, for a quarter of a second."""
    router = APIRouter(route_class=CobotRoute)
    content = b"\r\n--B-" * 40_000

    @router.post("/upload")
    async def upload(file: Annotated[UploadFile, File()]) -> int:
        return len(await file.read())

    app = FastAPI()
    app.state.services = SimpleNamespace(ownership=SimpleNamespace(stops_before=lambda begun_s: 0))
    app.include_router(router)
    turns = 0

    async def others() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    async def ask() -> httpx.Response:
        task = asyncio.create_task(others())
        head = b'--B\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://h") as client:
            answer = await client.post(
                "/upload",
                content=head + content + b"\r\n--B--\r\n",
                headers={"Content-Type": "multipart/form-data; boundary=B"},
            )
        task.cancel()
        return answer

    answer = asyncio.run(ask())
    assert json.loads(answer.content) == len(content)
    assert turns > len(content) / PIECE_BYTES
