"""The scene of one robot. Changes are made completely or not at all, stored in a file, and apply at once to
all planning.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import AsyncIterator, Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

from app.services.clients import CLIENT
from app.services.motion.execution import MotionService
from app.services.motion.goals import Goals
from app.services.motion.planning import PlanningService
from app.services.motion.retarget import RetargetService, WayAround
from app.services.motion.scene_edits import Edit, clear, named, with_room
from app.services.rights.claims import Caller
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from app.services.rights.stopping import StopService
from app.services.state.link import RobotLink
from app.services.state.robot_state import RobotState
from cobot.cell import cell_of
from cobot.cell.surroundings import scene_file
from cobot.config import Settings
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    LimitError,
    NotFoundError,
)
from cobot.robot.collision import CollisionChecker, Contact, FirstContact
from cobot.robot.description import RobotDescription
from cobot.robot.geometry.solids import MAX_SOLIDS
from cobot.robot.load import carrying, check_load
from cobot.robot.scene import Scene, SceneObject, symmetric
from cobot.robot.tool import Tool, check_inertia
from cobot.strict import shown
from cobot.trajectory import Trajectory
from cobot.trajectory_parts import cut
from cobot.types import RESTING, STREAMING, Numbers7, Pose

MAX_OBJECTS = 200
MAX_FRAMES = 1000
STATE_TIMEOUT_S = 1.5
STOPS_WITHIN_S = 0.5
"""Path time within which every motion can stop, s. rtloop looks ahead by the same time to check the fence of
a motion.
"""

log = logging.getLogger("cobot.scene")

HandedOver = tuple[int, Trajectory]


@dataclass(frozen=True, slots=True)
class Changed:
    """The result of a change to the scene.

    Attributes:
        stopped: reason why the current motion was stopped; "" if it continues, or there was none.
        contacts: bodies and objects that the arm touches at its current position.
    """

    scene: Scene
    stopped: str
    contacts: list[Contact]


@dataclass(frozen=True, slots=True)
class _Remaining:
    """The part of the current motion that has not been executed yet.

    Attributes:
        since_s: time at which the arm was at the start of `left`, on the link's clock.
    """

    handed_over: HandedOver
    since_s: float
    left: Trajectory


class SceneService:
    """Keeps the scene. Changes are made one at a time. Each is written to disk, then applied, and only then
    answered.

    Attributes:
        turn: lock that is held while the data of the collision checker changes.

    Raises:
        ConfigError: the file is not a valid scene.
    """

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        goals: Goals,
        motion: MotionService,
        planning: PlanningService,
        stopping: StopService,
        ownership: Ownership,
        retargeting: RetargetService,
        settings: Settings,
    ) -> None:
        self._robot = robot
        self._link = link
        self._goals = goals
        self._motion = motion
        self._planning = planning
        self._stopping = stopping
        self._ownership = ownership
        self._retargeting = retargeting
        self._replan_within_s = settings.planning.replan_within_s
        self._max_payload_kg = settings.robot.max_payload_kg
        self._parts = () if (cell := cell_of(settings)) is None else tuple(cell.parts)
        self._file = scene_file(settings)
        self.turn = asyncio.Lock()
        self._version = (
            # the newest version number. A rejected scene's number is not used again, because planning
            # processes may have that scene
            0
        )
        self._model_names = robot.model.frame_names | {robot.base_frame, "tool"}
        scene = self._file.read()
        if scene.version:
            robot.collision.surround(scene)
            planning.scene = scene

    @property
    def scene(self) -> Scene:
        return self._robot.collision.scene

    def put_object(self, name: str, item: SceneObject, frame: str) -> Edit:
        """Add or replace a solid. `item.pose` is in `frame`."""
        self._require_own_name(name)
        if item.inertia is not None:
            check_inertia(f"objects.{name}.inertia", symmetric(item.inertia), item.mass)

        def edit(scene: Scene, hand: Pose) -> Scene:
            if name not in scene.objects and len(scene.objects) >= MAX_OBJECTS:
                raise LimitError(
                    f"objects: there are already {MAX_OBJECTS}, which is the maximum; remove one first"
                )
            placed = replace(item, pose=self._placed(scene, item.pose, frame))
            return replace(scene, objects={**scene.objects, name: placed})

        return edit

    def move_object(self, name: str, pose: Numbers7, frame: str) -> Edit:
        """Move an object to `pose` in `frame`. The object's shape, size and mass stay the same."""

        def edit(scene: Scene, hand: Pose) -> Scene:
            item = named(scene, name)
            if item.attached:
                raise ConflictError(f"the object {shown(name)} is attached: detach it before it is moved")
            moved = replace(item, pose=self._placed(scene, pose, frame))
            return replace(scene, objects={**scene.objects, name: moved})

        return edit

    def put_frame(self, name: str, pose: Numbers7, frame: str) -> Edit:
        """Add or move a named frame. `pose` is its pose relative to `frame` now. If `frame` is moved later,
        the named frame stays where it is.
        """
        self._require_own_name(name)

        def edit(scene: Scene, hand: Pose) -> Scene:
            if name not in scene.frames and len(scene.frames) >= MAX_FRAMES:
                raise LimitError(
                    f"frames: there are already {MAX_FRAMES}, which is the maximum; remove one first"
                )
            return replace(scene, frames={**scene.frames, name: self._placed(scene, pose, frame)})

        return edit

    def allow(self, pairs: list[tuple[str, str]]) -> Edit:
        """Allow these pairs of bodies or objects to touch, and no others."""

        def edit(scene: Scene, hand: Pose) -> Scene:
            for pair in pairs:
                self._require_known(scene, pair)
            return replace(scene, allowed=tuple(pairs))

        return edit

    def attach(self, name: str, touch: list[str]) -> Edit:
        """Attach an object, which then keeps its current pose relative to the TCP."""

        def edit(scene: Scene, hand: Pose) -> Scene:
            item = named(scene, name)
            if item.attached:
                raise ConflictError(f"the object {shown(name)} is already attached")
            self._require_known(scene, touch)
            if item.cells and item.tolerance > 0.0:
                raise LimitError(
                    f"the object {shown(name)} is a point cloud whose voxels make more than {MAX_SOLIDS} "
                    "boxes together with the other objects, so it cannot be attached: put it again with a "
                    "larger voxel"
                )
            pose = (hand.inverse() @ Pose.from_numbers(item.pose)).numbers
            held = replace(item, pose=pose, attached=True, touch=tuple(touch))
            return replace(scene, objects={**scene.objects, name: held})

        return edit

    async def change(
        self, edits: Sequence[Edit], *, moves_hand: bool, name: str = "a change of the scene"
    ) -> Changed:
        """Make all changes in order, or none of them. They are completed even if the caller is cancelled.

        Args:
            moves_hand: whether an object is attached or detached, which requires the arm at rest.
            name: displayed name of the request.

        Raises:
            InputError: the robot has a part with this name, the frame is unknown, or MuJoCo rejects the
                scene.
            LimitError: there are too many objects or solids, or the load is too heavy for the arm.
            NotFoundError: there is no such object, frame or body.
            ConflictError: another client has control, the object is already attached or not attached, the arm
                is moving, or a streaming session is active.
            UnavailableError: the file cannot be written, or the robot does not answer.
        """
        return await asyncio.shield(asyncio.create_task(self._change(edits, moves_hand, name)))

    async def _change(self, edits: Sequence[Edit], moves_hand: bool, name: str) -> Changed:
        async with self.turn:
            self._ownership.require_control()
            state = await self._link.await_fresh_state(STATE_TIMEOUT_S)
            if moves_hand and state.mode not in RESTING:
                raise ConflictError(
                    f"the arm is moving (mode {state.mode.name}); objects can be attached and detached only "
                    "while it is at rest",
                    details={"cause": "moving"},
                )
            if state.mode in STREAMING:
                raise ConflictError(
                    f"a streaming session is active (mode {state.mode.name}); change the scene before "
                    "or after the session",
                    details={"cause": "moving"},
                )
            hand = self._robot.model.forward(state.commanded_position)
            scene = self.scene
            for edit in edits:
                scene = edit(scene, hand)
            self._version = max(self._version, self.scene.version) + 1
            scene = replace(self._with_fixtures(scene, edits), version=self._version)
            scene = replace(scene, objects=await _with_room(scene.objects))
            if scene.load == self.scene.load:
                return await self._take_over(scene)
            return await self._carry(replace(scene, loads=self.scene.loads + 1), state, name)

    def _with_fixtures(self, scene: Scene, edits: Sequence[Edit]) -> Scene:
        """Return the scene with the fixtures of the cell, which stay even if the scene is cleared.

        Raises:
            ConflictError: an edit changes a fixture.
        """
        fixed = self._file.fixed
        for name, fixture in fixed.items():
            now = scene.objects.get(name)
            if now != fixture and not (now is None and clear in edits):
                raise ConflictError(f"{shown(name)} is a fixture of the cell: change it in the cell file")
        return replace(scene, objects={**scene.objects, **fixed})

    async def _carry(self, scene: Scene, state: RobotState, name: str) -> Changed:
        """Apply a scene that changes the load of the arm. Until this is done, nothing moves and nothing is
        planned.
        """
        if state.mode not in RESTING:
            raise ConflictError(
                f"the arm is moving (mode {state.mode.name}); its load can be changed only "
                "while it is at rest",
                details={"cause": "moving"},
            )
        caller = Caller(name, CLIENT.get().sequence, self._ownership.stops, math.inf, asyncio.Event())
        with self._ownership.claim(caller):
            model = self._robot.model
            check_load(
                model, self._robot.limits, model.tool, scene, state.commanded_position, self._max_payload_kg
            )
            return await self._take_over(scene)

    async def _take_over(self, scene: Scene) -> Changed:
        """Apply a scene. If an object is in the current path, a planning process searches for a path around
        the object while the scene is checked and stored. The new path is sent to the real-time loop once the
        scene is in use.
        """
        remaining, in_force, leading = self._find_remaining(), asyncio.Event(), None
        way = await self._seek_way(remaining, scene)
        staging = asyncio.create_task(asyncio.to_thread(self._file.stage, scene))
        try:
            checker, contact = await self._examine(partial(self._robot.collision.among, scene), remaining)
            if way is None:
                # the other processes follow once the scene is in use
                await self._planning.prepare(scene, processes=1)
            elif remaining is not None and contact is not None:
                leading = self._begin_way_around(way, remaining, contact, in_force)
            await self._store(scene, staging)
        except BaseException:  # also on cancellation
            staging.cancel()
            if leading is not None:
                leading.cancel()
            raise
        if scene.loads != self.scene.loads:
            self._robot.model.carry(self._robot.model.tool, scene)
        self._robot.collision.take_over(checker)
        self._planning.scene = scene
        self._motion.scene_changed_s = self._link.clock.now_s()
        self._link.events.publish("scene", version=scene.version, objects=sorted(scene.objects))
        log.info("the scene has version %d: %d objects", scene.version, len(scene.objects))
        if self._under_way() is not (None if remaining is None else remaining.handed_over):
            if leading is not None:
                leading.cancel()
            # a different motion may have begun, or this one may have ended
            remaining = self._find_remaining()
            _, contact = await self._examine(checker.twin, remaining)
        elif leading is not None:
            in_force.set()
            contact = None if await _is_led(leading) else contact
        stopped = "" if remaining is None else await self._stop_if_invalid(remaining, contact)
        await self._planning.prepare()
        return Changed(scene, stopped, self._robot.collision.contacts(self._link.state().position))

    async def _store(self, scene: Scene, staging: asyncio.Task[Callable[[], None]]) -> None:
        """Write the scene to disk and inform the real-time loop."""
        before = self.scene
        await asyncio.to_thread(await staging)
        async with restore_on_error(partial(self._file.write, before), "scene"):
            await self._tell(scene)

    async def _tell(self, scene: Scene) -> None:
        if scene.loads == self.scene.loads:
            await self._link.commands.read_scene(scene.version)
        else:
            await self.send_load(self._robot.model.tool, scene)

    async def send_load(self, tool: Tool, scene: Scene) -> None:
        """Send the load to rtloop: the tool and the attached objects of the scene. Raises the same errors as
        `Commands.set_tool`.
        """
        tcp = self._robot.model.tcp_in_flange(tool)
        load, mounted = (carrying(tool, each, tcp) for each in (scene, scene.without(self._parts)))
        await self._link.commands.set_tool(load, mounted, scene.version)

    def _under_way(self) -> HandedOver | None:
        """Return the motion that rtloop is executing or is about to begin."""
        state, handed_over = self._link.state(), self._link.commands.handed_over
        if handed_over is None or (state.mode in RESTING and state.motion_id == handed_over[0]):
            return None
        return handed_over

    def _find_remaining(self) -> _Remaining | None:
        """Find the remaining part of the current motion; None if nothing remains."""
        handed_over = self._under_way()
        if handed_over is None:
            return None
        state, since_s = self._link.state(), self._link.clock.now_s()
        motion_id, trajectory = handed_over
        time_s = max(0.0, state.path_time_s) if state.motion_id == motion_id else 0.0
        if time_s >= trajectory.duration_s:
            return None
        return _Remaining(handed_over, since_s, cut(trajectory, time_s, trajectory.duration_s))

    async def _examine(
        self, make: Callable[[], CollisionChecker], remaining: _Remaining | None
    ) -> tuple[CollisionChecker, FirstContact | None]:
        """Create a checker and find the first contact of the remaining motion. Both run in one thread."""

        def examine() -> tuple[CollisionChecker, FirstContact | None]:
            checker = make()
            return checker, None if remaining is None else checker.first_contact(remaining.left)

        return await asyncio.to_thread(examine)

    async def _stop_if_invalid(self, remaining: _Remaining, contact: FirstContact | None) -> str:
        """Stop the current motion if its remaining path collides. Return the reason, or "" if the motion
        continues.
        """
        if contact is None:
            return ""
        twin = await asyncio.to_thread(self._robot.collision.twin)
        problem = await asyncio.to_thread(twin.refusal, remaining.left, contact)
        why = (
            f"the scene has changed (version {self.scene.version}), and the remaining motion is no longer "
            f"valid: {problem}"
        )
        log.warning("motion %d is stopped: %s", remaining.handed_over[0], why)
        try:
            await self._stopping.stop_motion(StopReason(why, "scene"))
        except ExecutionError as exc:  # the scene has changed nevertheless
            return f"{why}; {exc}"
        return why

    async def _seek_way(self, remaining: _Remaining | None, scene: Scene) -> WayAround | None:
        """If the settings permit, have a planning process check whether an object of the next scene is in the
        current path, and search for a path around the object. Does not wait for the result.
        """
        within_s = self._replan_within_s
        if within_s == 0.0 or remaining is None:
            return None
        way = self._retargeting.seek_way(remaining.handed_over[1], within_s, self._free_s(remaining), scene)
        await asyncio.sleep(0.0)  # send the search before threads compete for the interpreter
        return way

    def _begin_way_around(
        self, way: WayAround, remaining: _Remaining, contact: FirstContact, in_force: asyncio.Event
    ) -> asyncio.Task[bool] | None:
        """Begin to redirect the current motion around an object in its path. Returns a task whose result is
        whether the motion was redirected. Returns None if there would be too little time left to stop after a
        failure.
        """
        # the arm has moved on in the meantime
        left_s = remaining.since_s + self._replan_within_s - self._link.clock.now_s()
        if left_s <= 0.0 or contact.free_s < self._free_s(remaining):
            return None
        return asyncio.create_task(self._retargeting.lead_around(way, left_s, in_force))

    def _free_s(self, remaining: _Remaining) -> float:
        """How much of the remaining motion must be free for a search of a path around an object, s."""
        within_s = self._replan_within_s * self._link.hurry
        return min(within_s + STOPS_WITHIN_S, remaining.left.duration_s)

    def _placed(self, scene: Scene, pose: Numbers7, frame: str) -> Numbers7:
        """Convert a pose to the base frame. `frame` may be a frame that the same change adds."""
        if frame in scene.frames:
            return (Pose.from_numbers(scene.frames[frame]) @ Pose.from_numbers(pose)).numbers
        return self._goals.placed(Pose.from_numbers(pose), frame).numbers

    def _require_own_name(self, name: str) -> None:
        if name in self._robot.collision.tool.shapes:
            raise InputError(f"name: {shown(name)} is a shape of the tool; choose another name")
        if name in self._model_names:
            raise InputError(
                f"name: {shown(name)} is a body, site or frame of the robot; choose another name"
            )

    def _require_known(self, scene: Scene, names: Collection[str]) -> None:
        bodies = self._robot.collision.body_names
        for name in names:
            if name not in bodies and name not in scene.objects:
                valid = ", ".join([*bodies, *scene.objects])
                raise NotFoundError(f"there is no body or object {shown(name)}; valid names: {valid}")


@contextlib.asynccontextmanager
async def restore_on_error(restore: Callable[[], None], what: str) -> AsyncIterator[None]:
    """Restore a file if the real-time loop does not accept its new content.

    Raises:
        ConflictError: the real-time loop has rejected the new content.
    """
    try:
        yield
    except Exception as exc:
        try:
            await asyncio.to_thread(restore)
        except CobotError as also:
            log.error("the next start of the service uses a rejected %s: %s", what, also)
        if isinstance(exc, ExecutionError):
            raise ConflictError(str(exc)) from exc
        raise


async def _with_room(objects: dict[str, SceneObject]) -> dict[str, SceneObject]:
    """See `with_room`. Without point clouds, a thread is not worth its overhead."""
    if any(each.cells for each in objects.values()):
        return await asyncio.to_thread(with_room, objects)
    return with_room(objects)


async def _is_led(leading: asyncio.Task[bool]) -> bool:
    """Wait for the path around the object, and return whether the motion follows that path. Returns False
    after an unexpected error, so that the motion is stopped.
    """
    try:
        return await leading
    except Exception:
        log.exception("the search for a way around has failed")
        return False
