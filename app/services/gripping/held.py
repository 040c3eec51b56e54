"""The held object. A scene object is attached when the gripper grasps it, and detached when the gripper
releases it. A part of a simulated cell is in the scene only while it is held, and may then touch the fixtures
of the cell.

The load in the scene changes only while the arm is at rest. If the arm is moving, the change is made when it
is next at rest.
"""

from __future__ import annotations

import asyncio
import contextvars
import logging
from collections.abc import Sequence

import numpy as np

from app.services.motion.scene import SceneService
from app.services.motion.scene_edits import Edit, detach, remove_object
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.cell import Cell
from cobot.cell.surroundings import part_in_scene
from cobot.errors import CobotError, ConflictError, UnavailableError
from cobot.grippers import GripperState
from cobot.pose import Pose
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject
from cobot.types import RESTING, Array

REACH_M = 0.01
"""An object is between the fingers if its distance from the TCP is at most this, m."""
AGAIN_S = 0.02

log = logging.getLogger("cobot.gripper")


class HeldService:
    """Attaches and detaches the held object of one gripper; see the module.

    Args:
        cell: the simulated cell; None for a robot without a simulated cell.

    Attributes:
        name: name of the held object or part; None if nothing is held.
        context: context of the client that sent the last gripper command. Changes of the scene are attributed
            to this client.
    """

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        ownership: Ownership,
        scene: SceneService,
        cell: Cell | None,
    ) -> None:
        self._robot = robot
        self._link = link
        self._ownership = ownership
        self._scene = scene
        self._parts = {} if cell is None else cell.parts
        self._fixtures = [] if cell is None else [name for name, _ in cell.solids()]
        self._task: asyncio.Task[None] | None = None
        self._postponed = self._changing = False
        self.context = contextvars.copy_context()
        ownership.before_motion = self.settle
        attached = [name for name, each in scene.scene.objects.items() if each.attached]
        self.name = self._attached = attached[0] if len(attached) == 1 else None

    def close(self) -> None:
        if self._task is not None:
            self._task.cancel()

    def forget(self) -> None:
        """Detach an object that an earlier run of the service has attached, because the gripper holds
        nothing.
        """
        if self._attached in self._parts:  # the cell was reset meanwhile
            self.release()
        elif self._task is None:
            self.name = self._attached = None

    def grasp(self, state: GripperState) -> str | None:
        """Attach the object between the closed fingers. Returns its name."""
        if self.name is None or self.name != self._attached:
            self.name = self._between()
            self._settle()
        return self.name

    def release(self) -> str | None:
        """Detach the object, because the fingers no longer hold it. Returns its name."""
        before, self.name = self.name, None
        self._settle()
        return before

    async def follow(self) -> None:
        """Wait until the scene contains the change of the held object. Return at once if the change is
        postponed until the arm is at rest.

        Without this wait, the client's next motion would be rejected, because the robot is busy with the
        change.
        """
        while self._task is not None and not self._postponed:
            await asyncio.wait({self._task}, timeout=AGAIN_S)

    async def settle(self) -> None:
        """Make a postponed change now, because a motion is about to begin."""
        if self._task is not None and (self._changing or self._arm_rests()):
            self._postponed = False
            await self.follow()

    def _between(self) -> str | None:
        """Find the nearest object or part at the TCP that is not attached. A fixture of the cell is not held,
        even if the fingers press against it.
        """
        try:
            tcp = self._robot.model.forward(self._link.state().position)
        except UnavailableError:
            return None
        distances = {
            name: distance_m(each, tcp.position)
            for name, each in {**self._scene.scene.objects, **self._parts_where_they_are()}.items()
            if not each.attached and name not in self._fixtures
        }
        name = min(distances, key=lambda each: distances[each], default=None)
        return None if name is None or distances[name] > REACH_M else name

    def _parts_where_they_are(self) -> dict[str, SceneObject]:
        """Return the parts of the cell at their current poses."""
        poses = self._link.cell() or {}
        return {
            name: part_in_scene(self._parts[name], pose)
            for name, pose in poses.items()
            if name in self._parts
        }

    def _settle(self) -> None:
        if self._task is None and self.name != self._attached:
            self._postponed = False
            self._task = asyncio.create_task(self._change(), name="held object", context=self.context)

    async def _change(self) -> None:
        """Update the held object in the scene as soon as the arm is at rest."""
        try:
            while self.name != self._attached:
                if self._arm_rests():
                    self._changing = True
                    try:
                        await self._step(self._attached, self.name)
                        continue
                    except ConflictError as exc:  # the arm is moving again, or another client has control
                        log.debug("the held object: %s", exc)
                    finally:
                        self._changing = False
                self._postponed = True
                await asyncio.sleep(AGAIN_S)
        except CobotError as exc:
            log.warning("%sgripper: the scene does not have the held object: %s", self._link.label, exc)
            self.name = self._attached
        finally:
            self._task = None

    async def _step(self, old: str | None, new: str | None) -> None:
        scene = self._scene
        if old is not None:
            item = scene.scene.objects.get(old)
            if item is not None and item.attached:
                edit = remove_object(old) if old in self._parts else detach(old)
                await scene.change([edit], moves_hand=True, name="release")
            self._attached = None
            return
        if new is not None:
            part = self._parts_where_they_are().get(new)
            if part is None and new not in scene.scene.objects:
                self.name = None
                return
            put = [] if part is None else [scene.put_object(new, part, self._robot.base_frame)]
            touch = await asyncio.to_thread(self._touched, new, put)
            if put:  # the part may touch fixtures, because it will be placed on one
                touch = sorted({*touch, *self._fixtures})
            await scene.change([*put, scene.attach(new, touch)], moves_hand=True, name="grasp")
            self._attached = new

    def _touched(self, name: str, put: Sequence[Edit]) -> list[str]:
        """List the bodies that the object touches at its current pose: the fingers and its support.

        Args:
            put: the changes that add the object to the scene.
        """
        state = self._link.state()
        hand = self._robot.model.forward(state.commanded_position)
        held: Scene = self._scene.scene
        for edit in (*put, self._scene.attach(name, [])):
            held = edit(held, hand)
        contacts = self._robot.collision.among(held).contacts(state.commanded_position)
        pairs = [{each.first, each.second} for each in contacts]
        return sorted(set().union(*(pair for pair in pairs if name in pair)) - {name})

    def _arm_rests(self) -> bool:
        try:
            return self._link.state().mode in RESTING and not self._ownership.in_motion
        except UnavailableError:
            return False


def distance_m(item: SceneObject, point: Array) -> float:
    """Return the distance of a point in the base frame from an object, m; 0 inside the object. For compound
    shapes: the distance from the bounding box.
    """
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
