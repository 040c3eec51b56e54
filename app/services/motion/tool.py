"""The tool of one robot. It is changed only while the arm is at rest, and stored in a file. Plans, the
real-time loop and the simulation use the same tool.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, replace
from functools import partial

from app.services.clients import CLIENT
from app.services.motion.planning import PlanningService
from app.services.motion.scene import SceneService, restore_on_error
from app.services.rights.claims import Caller
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.errors import CobotError, ConflictError, InputError, LimitError
from cobot.robot.collision import CollisionChecker, Contact
from cobot.robot.description import RobotDescription
from cobot.robot.geometry.solids import MAX_SOLIDS
from cobot.robot.load import check_load
from cobot.robot.tool import Tool, ToolFile, check_tool
from cobot.strict import shown
from cobot.types import RESTING, Array

MAX_SHAPES = 50
STATE_TIMEOUT_S = 1.5
LOOK_S = 0.5
"""Interval between checks that rtloop uses the same tool, s."""

Edit = Callable[[Tool], Tool]

log = logging.getLogger("cobot.tool")


@dataclass(frozen=True, slots=True)
class ToolChanged:
    """The result of a change of the tool. `contacts` lists the bodies that the arm touches at its current
    position.
    """

    tool: Tool
    contacts: list[Contact]


class ToolService:
    """Keeps the tool. During a change, this service holds the claim on the arm, so nothing moves and nothing
    is planned with a half-changed tool.

    A change is written to disk and applied in rtloop before it is answered.

    Attributes:
        on_change: function that is called after each change.

    Raises:
        ConfigError: the file is not a valid tool.
    """

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        ownership: Ownership,
        planning: PlanningService,
        scene: SceneService,
        max_payload_kg: float,
        file: ToolFile,
    ) -> None:
        self._robot = robot
        self._link = link
        self._ownership = ownership
        self._planning = planning
        self._scene = scene
        self._max_payload_kg = max_payload_kg
        self._file = file
        self.on_change: list[Callable[[], None]] = []
        tool = file.read_checked(max_payload_kg, robot.model.file_gravity)
        if tool.version or scene.scene.loads:
            self._take_over(tool, robot.collision.among(scene.scene, tool))

    @property
    def tool(self) -> Tool:
        return self._robot.model.tool

    @contextlib.asynccontextmanager
    async def in_force(self) -> AsyncIterator[None]:
        """Make sure that rtloop uses this tool and this scene. It may have others if the service crashed
        between writing the file and sending the command.
        """
        task = asyncio.create_task(self._watch(), name="tool")
        try:
            yield
        finally:
            task.cancel()

    async def change(self, edit: Edit, name: str = "a change of the tool") -> ToolChanged:
        """Change the tool. A change that has begun is completed even if the caller is cancelled. A request
        for the current tool changes nothing and always succeeds.

        Args:
            name: displayed name of the request.

        Raises:
            InputError, LimitError: the tool is invalid, or the arm could not hold it in its current pose.
            ConflictError: the arm is moving, another client is moving it, an object is attached to the TCP,
                or rtloop rejects the tool. The tool is unchanged.
            UnavailableError: rtloop does not answer, or the file cannot be written. The tool is unchanged.
        """
        if edit(self.tool) == self.tool:
            return ToolChanged(self.tool, self._robot.collision.contacts(self._link.state().position))
        return await asyncio.shield(asyncio.create_task(self._change(edit, name)))

    async def _change(self, edit: Edit, name: str) -> ToolChanged:
        token, stops = CLIENT.get().sequence, self._ownership.stops
        caller = Caller(name, token, stops, math.inf, asyncio.Event())
        async with self._scene.turn:
            with self._ownership.claim(caller):
                state = await self._link.await_fresh_state(STATE_TIMEOUT_S)
                if state.mode not in RESTING:
                    raise ConflictError(
                        f"the arm is moving (mode {state.mode.name}); the tool can be changed only while it "
                        "is at rest",
                        details={"cause": "moving"},
                    )
                tool = replace(edit(self.tool), version=self.tool.version + 1)
                self._check(tool, state.commanded_position)
                return await self._apply(tool)

    def _check(self, tool: Tool, joints: Array) -> None:
        check_tool(tool, self._max_payload_kg, self._robot.model.file_gravity)
        if len(tool.shapes) > MAX_SHAPES:
            raise LimitError(f"shapes: no more than {MAX_SHAPES} are allowed, got {len(tool.shapes)}")
        solids = sum(each.solids for each in tool.shapes.values())
        if solids > MAX_SOLIDS:
            raise LimitError(f"shapes: they consist of {solids} solids, allowed: {MAX_SOLIDS}")
        taken = self._robot.model.frame_names | set(self._scene.scene.objects) | {"tool"}
        for name in tool.shapes:
            if name in taken:
                raise InputError(
                    f"shapes: {shown(name)} is a body, site or frame of the robot, or an object of the "
                    "scene; choose another name"
                )
        model = self._robot.model
        held = [name for name, each in self._scene.scene.objects.items() if each.attached]
        if held and model.tcp_in_flange(tool) != model.tcp_in_flange():
            raise ConflictError(
                f"tcp: {', '.join(held)} would move with it, because it is attached to the TCP; "
                "detach it first"
            )
        check_load(model, self._robot.limits, tool, self._scene.scene, joints, self._max_payload_kg)

    async def _apply(self, tool: Tool) -> ToolChanged:
        checker, ours = [  # separate copies, because one is used in threads
            await asyncio.to_thread(self._robot.collision.among, self._scene.scene, tool) for _ in range(2)
        ]
        before = self.tool
        await asyncio.to_thread(self._file.write, tool)
        async with restore_on_error(partial(self._file.write, before), "tool"):
            await self._scene.send_load(tool, self._scene.scene)
        self._take_over(tool, ours)
        await self._planning.prepare()
        for tell in self.on_change:
            tell()
        self._link.events.publish("tool", version=tool.version, name=tool.name, mass=tool.mass)
        log.info("%sthe tool has version %d: %s", self._link.label, tool.version, described(tool))
        return ToolChanged(tool, checker.contacts(self._link.state().position))

    def _take_over(self, tool: Tool, checker: CollisionChecker) -> None:
        self._robot.model.carry(tool, self._scene.scene)
        self._robot.collision.take_over(checker)
        self._planning.tool = tool

    async def _watch(self) -> None:
        while True:
            await self._see_that_rtloop_knows()
            await asyncio.sleep(LOOK_S)

    async def _see_that_rtloop_knows(self) -> None:
        if self._knows() or self._ownership.in_motion:
            return
        with contextlib.suppress(CobotError):
            async with self._scene.turn:
                state = await self._link.await_fresh_state(0.0)
                if self._knows() or state.mode not in RESTING:
                    return
                had = self._link.tool_version, self._link.scene_version
                await self._scene.send_load(self.tool, self._scene.scene)
                wanted = self._robot.model.carried.version, self._scene.scene.version
                versions = f"{had[0]} and {had[1]}, not {wanted[0]} and {wanted[1]}"
                log.warning(
                    "%srtloop had another tool or another scene (versions %s); this has been corrected",
                    self._link.label,
                    versions,
                )

    def _knows(self) -> bool:
        """Whether rtloop already uses this scene, and this tool with the attached objects."""
        tool, scene = self._link.tool_version, self._link.scene_version
        wanted = self._robot.model.carried.version, self._scene.scene.version
        return tool is None or scene is None or (tool, scene) == wanted


def described(tool: Tool) -> str:
    """Describe a tool for a log line."""
    return f"{tool.name or 'no name'}, {tool.mass:g} kg, {len(tool.shapes)} shapes"
