"""What is between the fingers: an object of the scene is attached when it is grasped, and detached later.

The scene's load changes only while the arm rests. If it moves, the change follows when it rests next.
"""

from __future__ import annotations

import asyncio
import contextvars
import logging

import numpy as np

from app.services.motion.scene import SceneService
from app.services.motion.scene_edits import detach
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.errors import CobotError, ConflictError, UnavailableError
from cobot.grippers import GripperState
from cobot.pose import Pose
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject
from cobot.types import RESTING, Array

REACH_M = 0.01
"""An object is between the fingers if it is no farther from the TCP, m."""
AGAIN_S = 0.02

log = logging.getLogger("cobot.gripper")


class HeldService:
    """See the module.

    Attributes:
        name: of the object in the scene that is held; None for none.
        context: of the client that has commanded the gripper last: on its behalf the scene changes.
    """

    def __init__(
        self, robot: RobotDescription, link: RobotLink, ownership: Ownership, scene: SceneService
    ) -> None:
        self._robot = robot
        self._link = link
        self._ownership = ownership
        self._scene = scene
        self._task: asyncio.Task[None] | None = None
        self.context = contextvars.copy_context()
        attached = [name for name, each in scene.scene.objects.items() if each.attached]
        self.name = self._attached = attached[0] if len(attached) == 1 else None

    def close(self) -> None:
        if self._task is not None:
            self._task.cancel()

    def forget(self) -> None:
        """The gripper holds nothing: what an earlier run of the service has attached is not in it."""
        if self._task is None:
            self.name = self._attached = None

    def grasp(self, state: GripperState) -> str | None:
        """The fingers have closed: the name of the object that is between them, which is attached."""
        if self.name is None or self.name != self._attached:
            self.name = self._between()
            self._settle()
        return self.name

    def release(self) -> str | None:
        """The fingers hold nothing any more: the name of the object that they have held."""
        before, self.name = self.name, None
        self._settle()
        return before

    def _between(self) -> str | None:
        """The nearest object at the TCP that is not attached."""
        try:
            tcp = self._robot.model.forward(self._link.state().position)
        except UnavailableError:
            return None
        distances = {
            name: distance_m(each, tcp.position)
            for name, each in self._scene.scene.objects.items()
            if not each.attached
        }
        name = min(distances, key=lambda each: distances[each], default=None)
        return None if name is None or distances[name] > REACH_M else name

    def _settle(self) -> None:
        if self._task is None and self.name != self._attached:
            self._task = asyncio.create_task(self._change(), name="held object", context=self.context)

    async def _change(self) -> None:
        """Have the scene say what is held, as soon as the arm rests."""
        try:
            while self.name != self._attached:
                if self._rests():
                    try:
                        await self._step(self._attached, self.name)
                        continue
                    except ConflictError as exc:  # something moves again, or another client has control
                        log.debug("the held object: %s", exc)
                await asyncio.sleep(AGAIN_S)
        except CobotError as exc:
            log.warning("%sgripper: the scene does not follow it: %s", self._link.label, exc)
            self.name = self._attached
        finally:
            self._task = None

    async def _step(self, old: str | None, new: str | None) -> None:
        scene = self._scene
        if old is not None:
            item = scene.scene.objects.get(old)
            if item is not None and item.attached:
                await scene.change([detach(old)], moves_hand=True, name="release")
            self._attached = None
            return
        if new is not None:
            if new not in scene.scene.objects:
                self.name = None
                return
            touch = await asyncio.to_thread(self._touched, new)
            await scene.change([scene.attach(new, touch)], moves_hand=True, name="grasp")
            self._attached = new

    def _touched(self, name: str) -> list[str]:
        """What the object touches where it is: the fingers, and what it stands on."""
        state = self._link.state()
        hand = self._robot.model.forward(state.commanded_position)
        held: Scene = self._scene.attach(name, [])(self._scene.scene, hand)
        contacts = self._robot.collision.among(held).contacts(state.commanded_position)
        pairs = [{each.first, each.second} for each in contacts]
        return sorted(set().union(*(pair for pair in pairs if name in pair)) - {name})

    def _rests(self) -> bool:
        try:
            return self._link.state().mode in RESTING and not self._ownership.in_motion
        except UnavailableError:
            return False


def distance_m(item: SceneObject, point: Array) -> float:
    """How far a point in the base frame is from an object; 0 inside. Of compound shapes: from their box."""
    local = Pose.from_numbers(item.pose).inverse().apply(point)
    x, y, z = local.tolist()
    if item.shape == "sphere":
        return max(0.0, float(np.hypot(np.hypot(x, y), z)) - item.size[0])
    if item.shape == "capsule":
        beyond = max(0.0, abs(z) - 0.5 * item.size[1])
        return max(0.0, float(np.hypot(np.hypot(x, y), beyond)) - item.size[0])
    if item.shape == "cylinder":
        beyond = max(0.0, abs(z) - 0.5 * item.size[1])
        return float(np.hypot(max(0.0, float(np.hypot(x, y)) - item.size[0]), beyond))
    outside = np.maximum(0.0, np.abs(local) - 0.5 * np.asarray(item.size))
    return float(np.linalg.norm(outside))
