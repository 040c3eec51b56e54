"""Named positions: reading, teaching and deleting them."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Request
from pydantic import Field

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.paging import After, Limit, page_of
from app.api.route import EndpointRouter
from app.api.schemas.names import Label, Name
from app.api.schemas.robot import NamedPositionAnswer
from app.services.motion.positions import TAUGHT
from cobot.access.roles import Role
from cobot.loose_lists import RequestModel
from cobot.motions.fields import HOME, Finite, example
from cobot.types import NamedPosition

router = EndpointRouter(tags=["robot"])


class TeachPosition(RequestModel):
    """A position to store under a name."""

    model_config = example({"name": "aside", "joints": [0.3, *HOME[1:]], "description": "next to home"})

    name: Name
    joints: list[Finite] | None = Field(
        None,
        min_length=1,
        max_length=64,
        description="Joint positions, rad. Default: the current ones.",
    )
    label: Label | None = Field(None, description="Displayed name, in any language. Default: `name`.")
    description: str = Field("", max_length=200, description="Description for people.")


@router.endpoint("GET /robot/positions", Role.OBSERVER, timeout_s=1.5, responses=responses(422))
async def positions(request: Request, limit: Limit = None, after: After = None) -> list[NamedPositionAnswer]:
    """Return the named positions, both those from the SRDF and the taught ones."""
    found = Call(request).services.positions.all()
    return [_answer(each) for each in page_of(found, lambda each: each.name, limit, after)]


@router.endpoint(
    "POST /robot/positions", Role.OPERATOR, timeout_s=5.0, control=True, responses=responses(409, 503)
)
async def teach_position(body: TeachPosition, request: Request) -> NamedPositionAnswer:
    """Store a position under a name, for motions to named positions. It is kept across restarts."""
    services = Call(request).services
    return _answer(await services.positions.teach(body.name, body.joints, body.description, body.label or ""))


@router.endpoint(
    "DELETE /robot/positions/{name}",
    Role.OPERATOR,
    timeout_s=5.0,
    control=True,
    responses=responses(404, 409, 422, 503),
)
async def forget_position(
    name: Annotated[str, Path(max_length=200, description="Name of a taught position.")], request: Request
) -> list[NamedPositionAnswer]:
    """Delete a taught position. Returns the remaining ones."""
    services = Call(request).services
    service = services.positions
    await service.forget(name)
    return [_answer(position) for position in service.all()]


def _answer(position: NamedPosition) -> NamedPositionAnswer:
    return NamedPositionAnswer(
        name=position.name,
        label=position.label or position.name,
        group=position.group,
        description=position.description,
        joints=list(position.joints),
        taught=position.group == TAUGHT,
    )
