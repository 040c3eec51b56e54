"""The scene: objects around the arm, attached objects, and named frames."""

from __future__ import annotations

import asyncio
from functools import partial

from fastapi import Request

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.scene import (
    ChangedAnswer,
    ChangeScene,
    FrameAnswer,
    ObjectAnswer,
    Place,
    PutObject,
    SceneAnswer,
)
from app.api.solids import solid_of
from app.services.motion.scene import Changed, SceneService
from app.services.motion.scene_edits import Edit, clear, detach, remove_frame, remove_object
from cobot.access.roles import Role
from cobot.robot.scene import COMPOUND
from cobot.types import Numbers7, Pose

router = EndpointRouter(tags=["scene"])


@router.endpoint("GET /scene", Role.OBSERVER, timeout_s=1.5)
async def scene(request: Request) -> SceneAnswer:
    """Return the whole scene, with its version."""
    found = Call(request).services.scene.scene
    return SceneAnswer(
        version=found.version,
        objects=[ObjectAnswer.of(name, each) for name, each in found.objects.items()],
        frames=[
            FrameAnswer(name=name, position=list(pose[:3]), quaternion=_xyzw(pose))
            for name, pose in found.frames.items()
        ],
        allowed=[list(pair) for pair in found.allowed],
    )


@router.endpoint(
    "POST /scene", Role.OPERATOR, timeout_s=10.0, control=True, responses=responses(404, 409, 503)
)
async def change_scene(body: ChangeScene, request: Request) -> ChangedAnswer:
    """Change the scene. Either all changes are made, or none.

    After the response, every planned motion keeps `planning.collision_margin_m` from the objects. The current
    motion is stopped if its remaining path would come closer than that. The scene is kept across restarts.
    While the arm is moving, nothing can be attached or detached, and the carried load cannot change.
    """
    call = Call(request)
    service = call.services.scene
    edits: list[Edit] = [clear] if body.clear else []
    edits += [detach(name) for name in body.detach]
    for name, place in body.frames.items():
        edits.append(
            remove_frame(name) if place is None else service.put_frame(name, _pose(place), place.frame_id)
        )
    for name, solid in body.objects.items():
        edits.append(remove_object(name) if solid is None else await _put(service, name, solid))
    edits += [service.move_object(name, _pose(place), place.frame_id) for name, place in body.move.items()]
    edits += [service.attach(name, touch) for name, touch in body.attach.items()]
    if body.allowed is not None:
        edits.append(service.allow([(first, second) for first, second in body.allowed]))
    return _answer(await service.change(edits, moves_hand=bool(body.attach or body.detach), name=call.name))


async def _put(service: SceneService, name: str, solid: PutObject) -> Edit:
    make = partial(solid_of, f"objects.{name}", solid, by_voxels=True)
    item = await asyncio.to_thread(make) if solid.shape in COMPOUND else make()
    return service.put_object(name, item, solid.frame_id)


def _answer(changed: Changed) -> ChangedAnswer:
    return ChangedAnswer(
        version=changed.scene.version,
        stopped=changed.stopped,
        contacts=[str(each) for each in changed.contacts],
    )


def _pose(place: Place) -> Numbers7:
    return Pose.from_abc(place.x, place.y, place.z, place.a, place.b, place.c).numbers


def _xyzw(pose: Numbers7) -> list[float]:
    return [*pose[4:], pose[3]]
