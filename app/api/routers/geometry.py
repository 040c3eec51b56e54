"""The robot's shape, for clients that draw it."""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import zlib
from typing import Annotated, Any

import numpy as np
from fastapi import Path, Query, Request, Response
from pydantic import BaseModel, Field

from app.api.costly import costly_turn
from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.plan_answers import ClearanceAnswer, DistanceAnswer
from app.robot_services import Services
from cobot.access.roles import Role
from cobot.pose import Pose
from cobot.robot.geometry.bodies import Body, BodyJoint, Geometry, Shape, geometry_of, geometry_version
from cobot.robot.geometry.visuals import visuals_of
from cobot.types import Array, JointLimits, Numbers7, PictureView

PROCESS = secrets.token_hex(4)
"""Random id of this process. It makes ETags from an earlier process invalid, because after a restart
everything may look different.
"""

router = EndpointRouter(tags=["scene"])


GLB_TYPE = "model/gltf-binary"
Mesh = Annotated[int, Path(description="Number of the mesh in GET /robot/visuals, from 0.")]


GLB: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A mesh, as GLB (glTF 2.0).",
        "content": {GLB_TYPE: {"schema": {"type": "string", "format": "binary"}}},
    }
}


PNG_TYPE = "image/png"
PNG: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A picture, as PNG.",
        "content": {PNG_TYPE: {"schema": {"type": "string", "format": "binary"}}},
    }
}
PART_COLOR = (0.85, 0.51, 0.17)
"""Colour of the loose parts in a cell, the same as in the panel."""


class PoseIn(BaseModel):
    """A pose in a different frame."""

    position: list[float] = Field(description="x, y, z, m")
    quaternion: list[float] = Field(description="x, y, z, w")


class JointShown(BaseModel):
    """A joint that moves a body."""

    index: int = Field(description="Index of the joint in the robot's order.")
    slides: bool = Field(description="true: the joint slides along its axis; false: it turns about its axis.")
    axis: list[float] = Field(description="Direction of the axis in the body's frame.")
    anchor: list[float] = Field(description="A point of the axis in the body's frame, m.")
    reference: float = Field(description="Joint position that the body's pose is given for, rad or m.")


class ShapeShown(PoseIn):
    """A solid, in the frame of its body."""

    shape: str = Field(description="box, sphere, cylinder, capsule, ellipsoid, plane or mesh.")
    size: list[float] = Field(
        description="Size, m. Box: three edges. Sphere: radius. Cylinder, capsule: radius and length. "
        "Ellipsoid: three radii. Plane: edges, 0 for infinite."
    )
    rgba: list[float] = Field(description="Colour, each component from 0 to 1.")
    mesh: int | None = Field(description="Index in the list of meshes.")
    collides: bool = Field(description="False: no collision check uses it; it is only for display.")


class BodyShown(PoseIn):
    """A rigid body, in the frame of its parent, with its joints at their reference positions."""

    name: str = Field(description="Name in messages about collisions; may be empty.")
    parent: int = Field(description="Index of the parent body; the first body is the world.")
    part: str = Field(description="Where the body belongs: robot, tool or scene.")
    joints: list[JointShown] = Field(description="Joints that move it, in order.")
    shapes: list[ShapeShown] = Field(description="The solids that form the body.")


class MeshShown(BaseModel):
    """Triangles."""

    vertices: list[float] = Field(description="Coordinates of the vertices, concatenated: x, y, z, m.")
    triangles: list[int] = Field(
        description="Indices of the vertices from 0, three for each triangle, concatenated."
    )


class JointRange(BaseModel):
    """Limits of a joint."""

    name: str = Field(description="Name of the joint.")
    slides: bool = Field(description="The joint slides: positions are in m, not in rad.")
    min_position: float = Field(description="Minimum position, rad or m.")
    max_position: float = Field(description="Maximum position, rad or m.")
    max_velocity: float = Field(description="Maximum velocity, rad/s or m/s.")
    max_effort: float = Field(description="Maximum effort, N·m or N.")


class TcpShown(PoseIn):
    """The pose of the TCP in the frame of the body that carries it."""

    body: int = Field(description="Index of the body that carries the TCP.")


class GeometryAnswer(BaseModel):
    """The bodies as a tree, each with its joints and shapes. Tool and scene are included."""

    bodies: list[BodyShown] = Field(description="The bodies; each comes after its parent.")
    base: int = Field(description="Index of the body in whose frame all poses are.")
    tcp: TcpShown = Field(description="Body and pose of the TCP.")
    joints: list[JointRange] = Field(description="The joints, in the robot's order.")
    meshes: list[MeshShown] = Field(description="The triangles of the shapes that are meshes.")


class VisualShown(PoseIn):
    """One `<visual>` of the robot's file, in the frame of its link."""

    link: str = Field(description="Name of the body in /robot/geometry.")
    shape: str = Field(description="box, sphere, cylinder, capsule or mesh.")
    size: list[float] = Field(
        description="Size, m. Box: edges. Sphere: radius. Cylinder, capsule: radius and length. Mesh: its "
        "scale along x, y, z."
    )
    rgba: list[float] | None = Field(
        description="Colour, each component from 0 to 1; null: the colours of the mesh."
    )
    mesh: int | None = Field(description="Number of the mesh: GET /robot/visuals/{mesh}, as GLB, in metres.")


class VisualsAnswer(BaseModel):
    """The appearance of the links. Collision checks do not use it."""

    visuals: list[VisualShown] = Field(description="The visuals; empty if the robot's file has none.")


@router.endpoint(
    "GET /robot/visuals", Role.OBSERVER, timeout_s=1.5, response_model=VisualsAnswer, responses=responses(503)
)
async def visuals(request: Request) -> Response:
    """Return the appearance of the arm's links, with colours, so that clients can draw it.

    The answer has an `ETag`. With a matching `If-None-Match` the answer is 304.
    """
    found = await asyncio.to_thread(visuals_of, Call(request).services.robot.model_file)
    answer = VisualsAnswer(
        visuals=[
            VisualShown(
                link=each.link,
                shape=each.shape,
                size=each.sizes(),
                position=each.position,
                quaternion=[*each.quaternion[1:], each.quaternion[0]],
                rgba=each.color,
                mesh=found.number(each),
            )
            for each in found.visuals
        ]
    )
    return tagged(request, answer.model_dump_json().encode(), "application/json")


@router.endpoint(
    "GET /robot/visuals/{mesh}",
    Role.OBSERVER,
    timeout_s=5.0,
    response_class=Response,
    responses=responses(404, 422, 503) | GLB,
)
async def visual_mesh(request: Request, mesh: Mesh) -> Response:
    """Return a mesh of /robot/visuals as GLB, with an `ETag`."""
    found = await asyncio.to_thread(visuals_of, Call(request).services.robot.model_file)
    return tagged(request, await asyncio.to_thread(found.read_mesh, mesh), GLB_TYPE)


def tagged(request: Request, content: bytes, media_type: str) -> Response:
    """Return the content with its ETag, or 304 if the client already has it."""
    tag = f'"{hashlib.blake2b(content, digest_size=8).hexdigest()}"'
    headers = {"ETag": tag, "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    return Response(content, media_type=media_type, headers=headers)


@router.endpoint(
    "GET /robot/picture",
    Role.OBSERVER,
    timeout_s=20.0,
    response_class=Response,
    responses=responses(422, 503) | PNG,
)
async def picture(
    request: Request,
    view: Annotated[
        PictureView, Query(description="Position of the camera; iso is above and to the side.")
    ] = "iso",
) -> Response:
    """Return a picture of the arm at its measured position, as PNG, 640 by 480 pixels.

    It shows the arm with its tool, the scene, and the parts of a simulated cell.
    """
    call = Call(request)
    services = call.services
    state = await services.link.await_measured_state(call.timeout_s)
    async with costly_turn(request):
        content = await asyncio.to_thread(_drawn, services, state.position, view)
    return Response(content, media_type=PNG_TYPE, headers={"Cache-Control": "no-store"})


def _drawn(services: Services, positions: Array, view: PictureView) -> bytes:
    from cobot.robot.geometry.picture import draw, solid, surface  # importing these modules takes a second

    parts = []
    cell = services.cell
    for name, pose in {} if cell.cell is None else cell.parts().items():
        part = cell.require().parts.get(name)
        if part is None:
            continue
        if part.shape == "mesh":
            vertices, triangles = (
                np.reshape(each, (-1, 3)) for each in (part.mesh.vertices, part.mesh.triangles)
            )
            facets = surface(vertices, triangles)
        else:
            facets = solid(part.shape, tuple(part.bounds_m))
        parts.append(facets.placed(Pose.from_numbers(pose), PART_COLOR))
    return draw(services.robot, positions, view, parts)


@router.endpoint("GET /robot/clearance", Role.OBSERVER, timeout_s=1.5, responses=responses(503))
async def clearance(request: Request) -> ClearanceAnswer:
    """Return the smallest distances of the arm to itself and to its surroundings.

    The distances are those at the measured position, each with its two nearest points.
    The shapes of arm, tool and scene are those of the collision checks. Distances that no joint changes are
    omitted, such as that between the first link and the floor.
    """
    call = Call(request)
    state = await call.services.link.await_measured_state(call.timeout_s)
    own, around = call.services.robot.collision.nearest.at(state.position)
    return ClearanceAnswer(
        closest_self=None if own is None else DistanceAnswer.of(own),
        closest_environment=None if around is None else DistanceAnswer.of(around),
    )


@router.endpoint("GET /robot/geometry", Role.OBSERVER, timeout_s=1.5, response_model=GeometryAnswer)
async def geometry(request: Request) -> Response:
    """Return the shapes and joints of the arm, its tool and its scene, as the collision checks use them.

    The answer has an `ETag`, which changes with the scene, the tool and the limits. With a matching
    `If-None-Match` the answer is 304.
    """
    robot = Call(request).services.robot
    tag = f'"{PROCESS}-{zlib.crc32(repr(geometry_version(robot)).encode()):08x}"'
    headers = {"ETag": tag, "Cache-Control": "no-cache"}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=headers)
    text = await asyncio.to_thread(rendered, geometry_of(robot), robot.limits)
    return Response(text, media_type="application/json", headers=headers)


def rendered(found: Geometry, limits: JointLimits) -> str:
    """Return a `GeometryAnswer` as JSON."""
    body, pose = found.tcp
    return GeometryAnswer(
        bodies=[_body(each) for each in found.bodies],
        base=found.base,
        tcp=TcpShown(body=body, position=list(pose[:3]), quaternion=_xyzw(pose)),
        joints=[
            JointRange(
                name=name,
                slides=bool(limits.slides) and limits.slides[index],
                min_position=limits.min_position[index],
                max_position=limits.max_position[index],
                max_velocity=limits.max_velocity[index],
                max_effort=limits.max_effort[index],
            )
            for index, name in enumerate(limits.names)
        ],
        meshes=[
            MeshShown(vertices=vertices.ravel().round(6).tolist(), triangles=triangles.ravel().tolist())
            for vertices, triangles in found.meshes
        ],
    ).model_dump_json()


def _body(body: Body) -> BodyShown:
    return BodyShown(
        name=body.name,
        parent=body.parent,
        part=body.part,
        position=list(body.pose[:3]),
        quaternion=_xyzw(body.pose),
        joints=[_joint(each) for each in body.joints],
        shapes=[_shape(each) for each in body.shapes],
    )


def _joint(joint: BodyJoint) -> JointShown:
    return JointShown(
        index=joint.index,
        slides=joint.slides,
        axis=joint.axis,
        anchor=joint.anchor,
        reference=joint.reference,
    )


def _shape(shape: Shape) -> ShapeShown:
    return ShapeShown(
        shape=shape.kind,
        size=shape.size,
        position=list(shape.pose[:3]),
        quaternion=_xyzw(shape.pose),
        rgba=shape.rgba,
        mesh=shape.mesh,
        collides=shape.collides,
    )


def _xyzw(pose: Numbers7) -> list[float]:
    return [*pose[4:], pose[3]]
