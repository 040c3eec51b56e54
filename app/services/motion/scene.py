"""The scene of one robot: changed as a whole, kept in its file, and in force at once for all planning."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.motion.stopping import StopService
from app.services.motion.tool_and_limits import compose, inverted
from app.services.state.link import RobotLink
from cobot.errors import CollisionError, ConflictError, InputError, LimitError, NotFoundError
from cobot.robot.collision import CollisionChecker, Contact
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Numbers7, Scene, SceneFile, SceneObject, numbers
from cobot.strict import shown
from cobot.trajectory import ORDER, Trajectory
from cobot.types import RESTING, Pose

MAX_OBJECTS = 200
MAX_FRAMES = 1000
STATE_TIMEOUT_S = 1.5

Item = TypeVar("Item")

log = logging.getLogger("cobot.scene")


@dataclass(frozen=True, slots=True)
class Changed:
    """What a change has done.

    Attributes:
        stopped: why the motion under way was stopped; "" if it goes on, or there was none.
        contacts: what the arm touches where it is.
    """

    scene: Scene
    stopped: str
    contacts: list[Contact]


class SceneService:
    """Changes come one after the other. Each is on the disk before it counts, and counts before its answer.

    Raises:
        ConfigError: the file is no scene.
    """

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        motion: MotionService,
        planning: PlanningService,
        stopping: StopService,
        file: SceneFile,
    ) -> None:
        self._robot = robot
        self._link = link
        self._motion = motion
        self._planning = planning
        self._stopping = stopping
        self._file = file
        self._turn = asyncio.Lock()
        self._model_names = robot.model.frame_names | {robot.base_frame, "tool"}
        scene = file.read()
        if scene.version:
            robot.collision.surround(scene)
            planning.scene = scene

    @property
    def scene(self) -> Scene:
        return self._robot.collision.scene

    async def put_object(self, name: str, item: SceneObject, frame: str) -> Changed:
        """Add a solid, or replace it; `item.pose` is in `frame`.

        Raises:
            InputError: the name is the model's, or there is no such frame.
            LimitError: there are too many.
        """
        self._require_own_name(name)

        def edit(scene: Scene) -> Scene:
            if name not in scene.objects and len(scene.objects) >= MAX_OBJECTS:
                raise LimitError(
                    f"there are {MAX_OBJECTS} objects already, no more are allowed: remove one first"
                )
            placed = replace(item, pose=numbers(self._motion.placed(_pose(item.pose), frame)))
            return replace(scene, objects={**scene.objects, name: placed})

        return await self._change(edit)

    async def remove_object(self, name: str) -> Changed:
        """Raises NotFoundError if there is none."""
        return await self._change(
            lambda scene: replace(scene, objects=_without(scene.objects, name, "object"))
        )

    async def put_frame(self, name: str, pose: Numbers7, frame: str) -> Changed:
        """Name a place; `pose` is in `frame`, and stays where that is now."""
        self._require_own_name(name)

        def edit(scene: Scene) -> Scene:
            if name not in scene.frames and len(scene.frames) >= MAX_FRAMES:
                raise LimitError(
                    f"there are {MAX_FRAMES} frames already, no more are allowed: remove one first"
                )
            placed = numbers(self._motion.placed(_pose(pose), frame))
            return replace(scene, frames={**scene.frames, name: placed})

        return await self._change(edit)

    async def remove_frame(self, name: str) -> Changed:
        """Raises NotFoundError if there is none."""
        return await self._change(lambda scene: replace(scene, frames=_without(scene.frames, name, "frame")))

    async def allow(self, pairs: list[tuple[str, str]]) -> Changed:
        """Have these pairs of bodies or objects touch, and no others.

        Raises:
            NotFoundError: there is no such body or object.
        """

        def edit(scene: Scene) -> Scene:
            for pair in pairs:
                self._require_known(scene, pair)
            return replace(scene, allowed=tuple(pairs))

        return await self._change(edit)

    async def attach(self, name: str, touch: list[str]) -> Changed:
        """From now on it moves with the TCP, from where both are now.

        Raises:
            ConflictError: it is attached already, or the arm moves.
            NotFoundError: there is no such object, or nothing of a name in `touch`.
        """
        hand = await self._resting_hand()

        def edit(scene: Scene) -> Scene:
            item = _named(scene, name)
            if item.attached:
                raise ConflictError(f"the object {shown(name)} is attached already")
            self._require_known(scene, touch)
            pose = numbers(compose(inverted(hand), _pose(item.pose)))
            held = replace(item, pose=pose, attached=True, touch=tuple(touch))
            return replace(scene, objects={**scene.objects, name: held})

        return await self._change(edit)

    async def detach(self, name: str) -> Changed:
        """From now on it stands where it is.

        Raises:
            ConflictError: it is not attached, or the arm moves.
            NotFoundError: there is no such object.
        """
        hand = await self._resting_hand()

        def edit(scene: Scene) -> Scene:
            item = _named(scene, name)
            if not item.attached:
                raise ConflictError(f"the object {shown(name)} is not attached")
            pose = numbers(compose(hand, _pose(item.pose)))
            left = replace(item, pose=pose, attached=False, touch=())
            return replace(scene, objects={**scene.objects, name: left})

        return await self._change(edit)

    async def clear(self) -> Changed:
        """Remove all of it."""
        return await self._change(lambda scene: Scene(version=scene.version))

    async def _change(self, edit: Callable[[Scene], Scene]) -> Changed:
        async with self._turn:
            changed = edit(self.scene)
            scene = replace(changed, version=self.scene.version + 1)
            checker = await asyncio.to_thread(self._robot.collision.among, scene)
            await asyncio.to_thread(self._file.write, scene)
            self._robot.collision.surround(scene)
            self._planning.scene = scene
            self._motion.scene_changed_s = self._link.clock.now_s()
            log.info("the scene has version %d: %d objects", scene.version, len(scene.objects))
            stopped = await self._stop_if_invalid(checker)
            return Changed(scene, stopped, checker.contacts(self._link.state().position))

    async def _stop_if_invalid(self, checker: CollisionChecker) -> str:
        """Stop the motion under way if what is left of it touches something now; why."""
        state, handed_over = self._link.state(), self._link.handed_over
        if handed_over is None or (state.mode in RESTING and state.motion_id == handed_over[0]):
            return ""
        motion_id, trajectory = handed_over
        begun = state.motion_id == motion_id
        left = rest_of(trajectory, state.path_time_s) if begun else trajectory
        if left is None:
            return ""
        try:
            await asyncio.to_thread(checker.check_trajectory, left)
        except CollisionError as exc:
            why = (
                f"the scene has changed (version {checker.scene.version}): what is left of the motion: {exc}"
            )
            log.warning("motion %d is stopped: %s", motion_id, why)
            await self._stopping.stop_motion(why)
            return why
        return ""

    async def _resting_hand(self) -> Pose:
        state = await self._link.fresh_state(STATE_TIMEOUT_S)
        if state.mode not in RESTING:
            raise ConflictError(
                f"the arm moves (mode {state.mode.name}): attach and detach only while it rests"
            )
        return self._robot.model.forward(state.commanded_position)

    def _require_own_name(self, name: str) -> None:
        if name in self._model_names:
            raise InputError(f"name: {shown(name)} is a body, site or frame of the robot; take another one")

    def _require_known(self, scene: Scene, names: Collection[str]) -> None:
        bodies = self._robot.collision.body_names
        for name in names:
            if name not in bodies and name not in scene.objects:
                valid = ", ".join([*bodies, *scene.objects])
                raise NotFoundError(f"there is no body or object {shown(name)}; valid are: {valid}")


def rest_of(trajectory: Trajectory, time_s: float) -> Trajectory | None:
    """What of a motion comes after a time; None if that is nothing."""
    breakpoints = trajectory.breakpoints_s
    if time_s <= 0.0:
        return trajectory
    if time_s >= breakpoints[-1]:
        return None
    piece = int(np.searchsorted(breakpoints, time_s, side="right")) - 1
    here = trajectory.coefficients[piece]
    ahead_s = time_s - breakpoints[piece]
    shifted = np.zeros_like(here)
    for power in range(ORDER):
        for lower in range(power + 1):
            shifted[:, lower] += here[:, power] * math.comb(power, lower) * ahead_s ** (power - lower)
    times = np.concatenate([[0.0], breakpoints[piece + 1 :] - time_s])
    return Trajectory(times, np.concatenate([shifted[None], trajectory.coefficients[piece + 1 :]]))


def _named(scene: Scene, name: str) -> SceneObject:
    if name not in scene.objects:
        there = ", ".join(scene.objects) or "none"
        raise NotFoundError(f"there is no object {shown(name)}; there are: {there}")
    return scene.objects[name]


def _without(items: Mapping[str, Item], name: str, what: str) -> dict[str, Item]:
    if name not in items:
        raise NotFoundError(f"there is no {what} {shown(name)}; there are: {', '.join(items) or 'none'}")
    return {other: each for other, each in items.items() if other != name}


def _pose(seven: Numbers7) -> Pose:
    values = np.array(seven)
    return Pose(values[:3], values[3:])
