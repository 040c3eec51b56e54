"""What the service asks of rtloop: every command, and its acknowledgement, is here."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import TYPE_CHECKING

from cobot.errors import CobotError, ConflictError, ExecutionError, NotReadyError, UnavailableError
from cobot.ipc.layout import LOADED_SEGMENTS, RING, SLOTS, Ack, Command, text
from cobot.ipc.tool_record import fill
from cobot.motions.fence import Fence
from cobot.motions.signals import NO_PLACED, Placed
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import LoopMode

if TYPE_CHECKING:
    from app.services.state.link import RobotLink

ACKNOWLEDGE_S = 3.0
"""rtloop verifies the largest trajectory in about a second."""
POLL_S = 0.001
IN_THREAD_SEGMENTS = 2000
"""Maximum number of segments that are copied in the event loop. A thread copies a longer trajectory."""


class Commands:
    """Sends commands, one after the other, and waits for what rtloop says to each.

    Attributes:
        handed_over: the number of the motion that rtloop was given last, and its trajectory.
    """

    def __init__(self, link: RobotLink) -> None:
        self._link = link
        self._memory = link.memory
        self._turn = asyncio.Lock()
        self._last_motion = 0
        self._slot = 0
        self.handed_over: tuple[int, Trajectory] | None = None

    async def start(
        self,
        trajectory: Trajectory,
        stops: int,
        tool: int = 0,
        fence: Fence | None = None,
        signals: Placed = NO_PLACED,
    ) -> int:
        """Hand a motion over and have it started.

        Args:
            stops: `RobotLink.stops` as it was when the motion was asked for.
            tool: the version of the tool that it was planned with.
            fence: that the TCP may not leave.
            signals: actions and conditions on its way.

        Returns:
            The motion's number.

        Raises:
            ExecutionError: rtloop refuses it, with its reason.
            UnavailableError: rtloop does not answer, or see `Heartbeat.require_awake`.
            InputError: the motion is larger than a slot.
        """
        async with self._turn:
            # The state may be of the cycle before the last acknowledgement.
            self._last_motion = max(self._last_motion, self._link.state().motion_id) + 1
            motion_id, number = self._last_motion, self._last_motion % SLOTS
            self._slot, self.handed_over = number, (motion_id, trajectory)
            motions = self._link.motions
            motions.prepare(motion_id, trajectory.duration_s)
            await self._write(number, motion_id, trajectory, fence, signals)
            try:
                self._link.heartbeat.require_awake()
                await self._send(
                    Command.START,
                    slot=number,
                    motion_id=motion_id,
                    stops=stops,
                    tool=tool,
                    timeout_s=ACKNOWLEDGE_S + loading_s(trajectory.segments, self._memory.period_s),
                )
            except CobotError:
                self.handed_over = None
                motions.forget_begin()
                raise
            motions.publish_begin()
        return motion_id

    async def replace(
        self,
        trajectory: Trajectory,
        offset_s: float,
        stops: int,
        tool: int = 0,
        signals: Placed = NO_PLACED,
    ) -> None:
        """Continue the present motion with another trajectory, as the same motion and within the same fence.

        Args:
            trajectory: equal to the present one up to the place of the arm when rtloop has read it.
            offset_s: the path time of the present trajectory at which it begins.
            stops, tool: see `start`.
            signals: actions and conditions on its way, at its own path times; those that have fired do not
                fire again.

        Raises:
            ExecutionError: rtloop refuses it, with its reason; the motion continues unchanged.
            UnavailableError, InputError: see `start`.
        """
        async with self._turn:
            number = (self._slot + 1) % SLOTS
            await self._write(number, self._last_motion, trajectory, signals=signals)
            self._link.heartbeat.require_awake()
            await self._send(
                Command.REPLACE,
                slot=number,
                motion_id=self._last_motion,
                stops=stops,
                value=offset_s,
                tool=tool,
                timeout_s=ACKNOWLEDGE_S + loading_s(trajectory.segments, self._memory.period_s),
            )
            self._slot, self.handed_over = number, (self._last_motion, trajectory)

    async def _write(
        self,
        number: int,
        motion_id: int,
        trajectory: Trajectory,
        fence: Fence | None = None,
        signals: Placed = NO_PLACED,
    ) -> None:
        slot = self._memory.slots[number]
        if trajectory.segments > IN_THREAD_SEGMENTS:
            await asyncio.to_thread(slot.write, motion_id, trajectory, fence, signals)
        else:
            slot.write(motion_id, trajectory, fence, signals)

    async def set_rate(self, rate: float) -> None:
        """Go over to another path time per clock time, 0 (pause) to 1, of the motion that runs.

        Raises:
            ExecutionError: no motion is running.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.SET_RATE, stops=self._link.stops, value=rate)

    async def set_tool(self, tool: Tool, mounted: Tool, scene_version: int) -> None:
        """Have rtloop, and the simulation, carry this tool from now on, and read the scene's file.

        Args:
            mounted: the tool without the parts of a simulated cell.

        Raises:
            ExecutionError: rtloop refuses it, with its reason: the arm moves.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            fill(self._memory.tool.data, tool, mounted)
            self._memory.tool.publish()
            await self._send(Command.TOOL, stops=self._link.stops, tool=tool.version, scene=scene_version)

    async def set_output(self, name: str, value: float) -> None:
        """Hand an output to the device; it is set when the device reports it.

        Raises:
            ExecutionError: the device does not take it, with why.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            record = self._memory.output.data
            record["name"], record["value"] = name.encode(), value
            self._memory.output.publish()
            await self._send(Command.OUTPUT, stops=self._link.stops)

    async def reset_cell(self) -> None:
        """Put the simulated cell back to its state at the start.

        Raises:
            ExecutionError: rtloop rejects it, with its reason: the arm moves.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.RESET_CELL, stops=self._link.stops)

    async def restart(self) -> None:
        """Put the simulated arm, and its cell, back to the start.

        Raises:
            ExecutionError: rtloop rejects it, with its reason: the arm moves, or it is no simulation.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.RESTART, stops=self._link.stops)

    async def pull(self, link: str, point: Sequence[float] = (), target: Sequence[float] = ()) -> None:
        """Pull at a point of a link of the simulated arm towards a target; no link: let go.

        Raises:
            ExecutionError: rtloop rejects it, with its reason.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            record = self._memory.pull.data
            record["link"] = link.encode()[:64]
            if link:
                record["point"], record["target"] = point, target
            self._memory.pull.publish()
            await self._send(Command.PULL, stops=self._link.stops)

    async def read_scene(self, version: int) -> None:
        """Have rtloop read the scene's file, before the next stream begins.

        Raises:
            ExecutionError: rtloop refuses it, with its reason: a streaming session is active.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.SCENE, stops=self._link.stops, scene=version)

    async def reset(self, timeout_s: float) -> None:
        """Leave ESTOP or FAULT. What was asked for before, and waits for something, moves nothing any more.

        Raises:
            ConflictError: the arm moves, so there is nothing to reset.
            NotReadyError: the cause persists, with rtloop's reason.
            UnavailableError: rtloop does not answer.
        """
        state = await self._link.await_fresh_state(timeout_s)
        if state.mode in (LoopMode.TRAJECTORY, LoopMode.STOPPING):
            raise ConflictError(f"motion {state.motion_id} is {state.mode.name}: there is nothing to reset")
        if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            self._link.request_stop()
        asked = self._link.stops + self._link.estops  # a stop takes precedence while this waits
        async with self._turn:
            try:
                await self._send(Command.RESET, stops=asked, timeout_s=timeout_s)
            except ExecutionError as exc:
                raise NotReadyError(str(exc)) from exc

    async def acknowledge(self) -> None:
        """Confirm to rtloop that a person has compared the findings of the first contact with the arm.

        Raises:
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.ACKNOWLEDGE, stops=self._link.stops)

    async def _send(
        self,
        kind: Command,
        *,
        stops: int,
        slot: int = 0,
        motion_id: int = 0,
        value: float = 0.0,
        tool: int = 0,
        scene: int = 0,
        timeout_s: float = ACKNOWLEDGE_S,
    ) -> None:
        """Have a command carried out, now or never: rtloop refuses one that a stop has overtaken."""
        number = int(self._memory.head.data["id"]) + 1
        command = self._memory.commands[number % RING]
        command.data["id"] = number
        command.data["kind"] = kind
        command.data["slot"] = slot
        command.data["motion_id"] = motion_id
        command.data["stops"] = stops
        command.data["value"] = value
        command.data["tool"] = tool
        command.data["scene"] = scene
        command.publish()
        self._memory.head.data["id"] = number
        self._memory.head.publish()
        ack = self._memory.acks[number % RING]
        deadline_s = self._link.clock.now_s() + timeout_s
        answered = False
        try:
            while not (answered := ack.try_read() and int(ack.data["id"]) == number):
                if self._link.clock.now_s() > deadline_s:
                    rtloop = f"rtloop (pid {self._link.rtloop_pid()})"
                    raise UnavailableError(f"{rtloop} has not answered a {kind.name} for {timeout_s:.2g} s")
                await asyncio.sleep(POLL_S)
        finally:
            if not answered:
                self._link.request_stop()
        if int(ack.data["result"]) != Ack.ACCEPTED:
            raise ExecutionError(text(ack.data["message"]))


def loading_s(segments: int, period_s: float) -> float:
    """How long rtloop may take to load a motion: a busy computer may miss as many cycles again."""
    return 2.0 * period_s * segments / LOADED_SEGMENTS
