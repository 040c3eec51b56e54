"""Changes of a scene that do not need the robot. Each function makes an `Edit`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from cobot.errors import ConflictError, LimitError, NotFoundError
from cobot.robot.geometry.solids import MAX_SOLIDS
from cobot.robot.scene import Scene, SceneObject
from cobot.strict import shown
from cobot.types import Pose

Edit = Callable[[Scene, Pose], Scene]
"""A function that takes a scene and the pose of the TCP, and returns the edited scene."""


def clear(scene: Scene, hand: Pose) -> Scene:
    """Remove all objects, frames and allowed pairs."""
    return Scene(version=scene.version, loads=scene.loads)


def remove_object(name: str) -> Edit:
    """Remove a solid, attached or not."""

    def edit(scene: Scene, hand: Pose) -> Scene:
        named(scene, name)
        return replace(scene, objects={other: each for other, each in scene.objects.items() if other != name})

    return edit


def remove_frame(name: str) -> Edit:
    """Remove a named frame."""

    def edit(scene: Scene, hand: Pose) -> Scene:
        if name not in scene.frames:
            there = ", ".join(scene.frames) or "none"
            raise NotFoundError(f"there is no frame {shown(name)}; valid are: {there}")
        return replace(scene, frames={other: each for other, each in scene.frames.items() if other != name})

    return edit


def detach(name: str) -> Edit:
    """Detach an object, which then stays where it is."""

    def edit(scene: Scene, hand: Pose) -> Scene:
        item = named(scene, name)
        if not item.attached:
            raise ConflictError(f"the object {shown(name)} is not attached")
        pose = (hand @ Pose.from_numbers(item.pose)).numbers
        left = replace(item, pose=pose, attached=False, touch=())
        return replace(scene, objects={**scene.objects, name: left})

    return edit


def require_room(objects: dict[str, SceneObject]) -> None:
    """Reject a scene with more solids than allowed."""
    count = sum(each.solids for each in objects.values())
    if count > MAX_SOLIDS:
        largest = sorted(objects, key=lambda name: -objects[name].solids)[:3]
        held = ", ".join(f"{name} of {objects[name].solids}" for name in largest)
        raise LimitError(
            f"objects: they consist of {count} solids ({held}), allowed: {MAX_SOLIDS}: remove an object, "
            f"or make one coarser"
        )


def named(scene: Scene, name: str) -> SceneObject:
    """The object with this name. NotFoundError lists the existing ones."""
    if name not in scene.objects:
        there = ", ".join(scene.objects) or "none"
        raise NotFoundError(f"there is no object {shown(name)}; valid are: {there}")
    return scene.objects[name]
