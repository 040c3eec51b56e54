"""Changes to a scene that do not need the robot. Each function returns an `Edit`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

from cobot.errors import ConflictError, LimitError, NotFoundError
from cobot.robot.geometry.cells import MAX_VOXELS, boxes_of
from cobot.robot.geometry.solids import MAX_SOLIDS
from cobot.robot.scene import Scene, SceneObject
from cobot.strict import shown
from cobot.types import Numbers6, Pose

Edit = Callable[[Scene, Pose], Scene]
"""Type of a function that takes a scene and the pose of the TCP, and returns the edited scene."""


def clear(scene: Scene, hand: Pose) -> Scene:
    """Remove all objects, frames and allowed pairs."""
    return Scene(version=scene.version, loads=scene.loads)


def remove_object(name: str) -> Edit:
    """Remove a solid, whether it is attached or not."""

    def edit(scene: Scene, hand: Pose) -> Scene:
        named(scene, name)
        return replace(scene, objects={other: each for other, each in scene.objects.items() if other != name})

    return edit


def remove_frame(name: str) -> Edit:
    """Remove a named frame."""

    def edit(scene: Scene, hand: Pose) -> Scene:
        if name not in scene.frames:
            there = ", ".join(scene.frames) or "none"
            raise NotFoundError(f"there is no frame {shown(name)}; valid names: {there}")
        return replace(scene, frames={other: each for other, each in scene.frames.items() if other != name})

    return edit


def detach(name: str) -> Edit:
    """Detach an object. It then stays at its current pose."""

    def edit(scene: Scene, hand: Pose) -> Scene:
        item = named(scene, name)
        if not item.attached:
            raise ConflictError(f"the object {shown(name)} is not attached")
        pose = (hand @ Pose.from_numbers(item.pose)).numbers
        left = replace(item, pose=pose, attached=False, touch=())
        return replace(scene, objects={**scene.objects, name: left})

    return edit


def with_room(objects: dict[str, SceneObject]) -> dict[str, SceneObject]:
    """Return the objects, with each point cloud divided into boxes that enclose its voxels. There are no more
    boxes than a stream can check in addition to the other solids. For large clouds, this takes tens of
    milliseconds.

    Raises:
        LimitError: there are more solids or voxels than allowed.
    """
    voxels = sum(each.voxels for each in objects.values())
    if voxels > MAX_VOXELS:
        raise LimitError(
            f"objects: their point clouds have {voxels} voxels together, allowed: {MAX_VOXELS}: remove a "
            "cloud, or use a larger voxel"
        )
    clouds = {name: each for name, each in objects.items() if each.cells and not each.attached}
    others = sum(each.solids for name, each in objects.items() if name not in clouds)
    if others + len(clouds) > MAX_SOLIDS:
        counts = {name: 1 if name in clouds else each.solids for name, each in objects.items()}
        held = ", ".join(f"{name} of {counts[name]}" for name in sorted(counts, key=lambda n: -counts[n])[:3])
        raise LimitError(
            f"objects: they consist of {others + len(clouds)} solids ({held}), allowed: {MAX_SOLIDS}: remove "
            f"an object, or make one coarser"
        )
    left, fitted = MAX_SOLIDS - others, {}
    fewest = {name: len(boxes_of(each.cells, each.voxel)[0]) for name, each in clouds.items()}
    for number, name in enumerate(sorted(clouds, key=lambda name: (fewest[name], name))):
        each = clouds[name]
        boxes, beyond_m = boxes_of(each.cells, each.voxel, left // (len(clouds) - number))
        rows = cast(tuple[Numbers6, ...], tuple(tuple(box) for box in boxes.tolist()))
        fitted[name] = replace(each, boxes=rows, tolerance=beyond_m)
        left -= len(rows)
    return {name: fitted.get(name, each) for name, each in objects.items()}


def named(scene: Scene, name: str) -> SceneObject:
    """Return the object with the given name. Raises NotFoundError, which lists the existing objects."""
    if name not in scene.objects:
        there = ", ".join(scene.objects) or "none"
        raise NotFoundError(f"there is no object {shown(name)}; valid names: {there}")
    return scene.objects[name]
