"""The simulation: its cell with parts and switches, its restart, and its time factor."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Annotated, Self

from fastapi import Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from app.api.costly import costly_turn
from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.device import IoAnswer
from app.api.schemas.robot import ResetAnswer
from app.services.state.cell import CellService
from cobot.access.roles import Role
from cobot.cell import CellPart
from cobot.loose_lists import RequestModel
from cobot.types import TIME_FACTORS

router = EndpointRouter(tags=["cell"])


class MeshAnswer(BaseModel):
    """The mesh of a part, around the middle of its bounding box."""

    vertices: list[float] = Field(description="Coordinates of the vertices, concatenated: x, y, z, m.")
    triangles: list[int] = Field(
        description="Indices of the vertices from 0, three for each triangle, concatenated."
    )


class PartAnswer(BaseModel):
    """One of the cell's loose parts."""

    name: str = Field(description="Name from the cell file.")
    shape: str = Field(description="box, cylinder, sphere or mesh.")
    size_m: list[float] = Field(
        description="Box: edges along x, y and z. Cylinder: radius and length. Sphere: radius. Mesh: edges "
        "of its bounding box."
    )
    mesh: MeshAnswer | None = Field(
        description="The triangles of a mesh, with `meshes=true`; otherwise null."
    )
    mass_kg: float = Field(description="kg")
    position: list[float] = Field(description="Position of the part's centre in the base frame: x, y, z, m.")
    quaternion: list[float] = Field(description="Orientation in the base frame: x, y, z, w.")


class TimeFactorBody(RequestModel):
    """A new time factor."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"factor": 0.5}]})

    factor: float = Field(
        ge=TIME_FACTORS[0],
        le=TIME_FACTORS[1],
        allow_inf_nan=False,
        description="Robot time per wall time while a planned motion runs: 0.5 is slow motion.",
    )


class TimeFactorAnswer(BaseModel):
    """The time factor of the simulation."""

    factor: float = Field(
        description="Robot time per wall time while a planned motion runs. A real robot has 1."
    )


class CellAnswer(BaseModel):
    """The current state of the cell."""

    parts: list[PartAnswer] = Field(description="The parts, in the order of the cell file.")
    switches: list[IoAnswer] = Field(
        description="Values by input: one for each switch, and NAME.count for its counter."
    )

    @classmethod
    def of(cls, service: CellService) -> Self:
        parts, poses = service.require().parts, service.parts()
        return cls(
            parts=[
                PartAnswer(
                    name=name,
                    shape=parts[name].shape,
                    size_m=list(parts[name].bounds_m),
                    mesh=None,
                    mass_kg=parts[name].mass_kg,
                    position=list(pose[:3]),
                    quaternion=[*pose[4:], pose[3]],
                )
                for name, pose in poses.items()
                if name in parts
            ],
            switches=[IoAnswer.of(each) for each in service.switches()],
        )


def _with_meshes(answer: CellAnswer, parts: Mapping[str, CellPart]) -> bytes:
    for shown in answer.parts:
        if shown.shape == "mesh":
            mesh = parts[shown.name].mesh
            shown.mesh = MeshAnswer(vertices=list(mesh.vertices), triangles=list(mesh.triangles))
    return answer.model_dump_json().encode()


@router.endpoint(
    "GET /cell", Role.OBSERVER, timeout_s=1.5, response_model=CellAnswer, responses=responses(404, 422, 503)
)
async def cell(
    request: Request,
    meshes: Annotated[
        bool, Query(description="Whether the response has the triangles of parts that are meshes.")
    ] = False,
) -> Response:
    """Return the positions of the parts in the simulated cell, and the values of its switches.

    A robot without a cell answers 404.
    """
    service = Call(request).services.cell
    answer = CellAnswer.of(service)
    if not meshes:
        return Response(answer.model_dump_json(), media_type="application/json")
    async with costly_turn(request):  # the answer may contain millions of numbers
        content = await asyncio.to_thread(_with_meshes, answer, service.require().parts)
    return Response(content, media_type="application/json")


@router.endpoint(
    "POST /cell/reset", Role.OPERATOR, timeout_s=2.0, control=True, responses=responses(404, 409, 503)
)
async def reset_cell(request: Request) -> CellAnswer:
    """Reset the parts, the hand, the outputs and the counters to their initial state. The arm stays where it
    is.

    Rejected with 409 while the arm is moving.
    """
    service = Call(request).services.cell
    await service.reset()
    return CellAnswer.of(service)


@router.endpoint(
    "POST /robot/simulation/reset",
    Role.OPERATOR,
    timeout_s=5.0,
    control=True,
    responses=responses(409, 501, 503),
)
async def reset_simulation(request: Request) -> ResetAnswer:
    """Restart the simulation: clear an e-stop or a fault, and return the arm and the cell to their initial
    state.

    Scene, tool and positions stay. Rejected with 409 while the arm is moving or a program is running, and
    with 501 on a real robot.
    """
    await Call(request).services.simulation.reset()
    return ResetAnswer(success=True, message="the simulation restarts")


@router.endpoint("GET /robot/simulation/time_factor", Role.OBSERVER, timeout_s=1.5, responses=responses(503))
async def time_factor(request: Request) -> TimeFactorAnswer:
    """The time factor of the simulation: how much faster than real time planned motions run."""
    return TimeFactorAnswer(factor=Call(request).services.link.state().time_factor)


@router.endpoint(
    "POST /robot/simulation/time_factor",
    Role.OPERATOR,
    timeout_s=5.0,
    control=True,
    responses=responses(409, 501, 503),
)
async def set_time_factor(body: TimeFactorBody, request: Request) -> TimeFactorAnswer:
    """Set the time factor of the simulation, for the current motion and all later ones.

    Only the time between two cycles changes, not the commands to the arm. At rest, during a stop and in
    streaming sessions the simulation runs in real time. Rejected with 409 while another client is moving the
    arm or has control, and with 501 on a real robot.
    """
    await Call(request).services.simulation.set_time_factor(body.factor)
    return TimeFactorAnswer(factor=body.factor)
