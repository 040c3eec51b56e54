"""What stands around the arm, what it holds, and named frames."""

from __future__ import annotations

from fastapi import APIRouter, Depends, Request

from app.api.dependencies import Call, CobotRoute, json_body
from app.api.errors import responses
from app.api.scene_schemas import (
    Allowed,
    Attach,
    ChangedAnswer,
    FrameAnswer,
    Name,
    ObjectAnswer,
    Place,
    PutObject,
    SceneAnswer,
)
from app.services.motion.scene import Changed
from cobot import audit
from cobot.robot.frames import pose_from_abc
from cobot.robot.scene import Numbers7, SceneObject, numbers

router = APIRouter(prefix="/scene", tags=["scene"], route_class=CobotRoute)
BODY = [Depends(json_body)]
WITH_BODY = responses(404, 409, 413, 415, 422, 503)
WITHOUT = responses(404, 409, 422, 503)


@router.get("")
async def scene(request: Request) -> SceneAnswer:
    """All of it, with its version."""
    found = Call(request).services.scene.scene
    return SceneAnswer(
        version=found.version,
        objects=[
            ObjectAnswer(
                name=name,
                shape=each.shape,
                size=list(each.size),
                position=list(each.pose[:3]),
                quaternion=_xyzw(each.pose),
                attached=each.attached,
                touch=list(each.touch),
            )
            for name, each in found.objects.items()
        ],
        frames=[
            FrameAnswer(name=name, position=list(pose[:3]), quaternion=_xyzw(pose))
            for name, pose in found.frames.items()
        ],
        allowed=[list(pair) for pair in found.allowed],
    )


@router.delete("", responses=WITHOUT)
async def clear_scene(request: Request) -> ChangedAnswer:
    """Remove all objects, frames and allowed pairs."""
    return _answer(await Call(request).services.scene.clear())


@router.put("/objects/{name}", responses=WITH_BODY, dependencies=BODY)
async def put_object(name: Name, body: PutObject, request: Request) -> ChangedAnswer:
    """Add a solid, or replace the one of this name.

    From the answer on, every motion keeps `planning.collision_margin_m` from it; the motion under way is
    stopped if what is left of it would not. It is kept over restarts.
    """
    item = SceneObject(shape=body.shape, size=body.numbers(), pose=_pose(body))
    return _answer(await Call(request).services.scene.put_object(name, item, body.frame_id))


@router.delete("/objects/{name}", responses=WITHOUT)
async def remove_object(name: Name, request: Request) -> ChangedAnswer:
    """Remove a solid."""
    return _answer(await Call(request).services.scene.remove_object(name))


@router.post("/objects/{name}/attach", responses=WITH_BODY, dependencies=BODY)
async def attach_object(name: Name, body: Attach, request: Request) -> ChangedAnswer:
    """The hand holds it: it moves with the TCP from where both are now. Only while the arm rests."""
    return _answer(await Call(request).services.scene.attach(name, body.touch))


@router.post("/objects/{name}/detach", responses=WITHOUT)
async def detach_object(name: Name, request: Request) -> ChangedAnswer:
    """The hand lets go: it stands where it is now. Only while the arm rests. Takes no body."""
    return _answer(await Call(request).services.scene.detach(name))


@router.put("/frames/{name}", responses=WITH_BODY, dependencies=BODY)
async def put_frame(name: Name, body: Place, request: Request) -> ChangedAnswer:
    """Name a place, for `frame_id` of motions and of the scene."""
    return _answer(await Call(request).services.scene.put_frame(name, _pose(body), body.frame_id))


@router.delete("/frames/{name}", responses=WITHOUT)
async def remove_frame(name: Name, request: Request) -> ChangedAnswer:
    """Forget a named place. What was placed in it stays where it is."""
    return _answer(await Call(request).services.scene.remove_frame(name))


@router.put("/allowed", responses=WITH_BODY, dependencies=BODY)
async def allow_collisions(body: Allowed, request: Request) -> ChangedAnswer:
    """Which pairs of bodies and objects may touch, instead of those before."""
    pairs = [(first, second) for first, second in body.pairs]
    return _answer(await Call(request).services.scene.allow(pairs))


def _answer(changed: Changed) -> ChangedAnswer:
    audit.note("scene changed", version=changed.scene.version)
    return ChangedAnswer(
        version=changed.scene.version,
        stopped=changed.stopped,
        contacts=[str(each) for each in changed.contacts],
    )


def _pose(place: Place) -> Numbers7:
    return numbers(pose_from_abc(place.x, place.y, place.z, place.a, place.b, place.c))


def _xyzw(pose: Numbers7) -> list[float]:
    return [*pose[4:], pose[3]]
