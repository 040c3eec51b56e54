"""Sends commands to rtloop and waits for their acknowledgements. All commands are sent through this
module.
"""

from __future__ import annotations

import asyncio
import contextlib
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
"""Timeout for an acknowledgement, s. rtloop verifies the largest trajectory in 0.4 s."""
STATE_S = 1.5
"""Timeout for a state before a reset, s."""
POLL_S = 0.001
IN_THREAD_SEGMENTS = 2000
"""Maximum number of segments of a trajectory that is copied in the event loop. Longer ones are copied in a
thread.
"""


class Commands:
    """Sends commands one at a time, and waits for rtloop's answer to each.

    Attributes:
        handed_over: the number and the trajectory of the last motion that was sent to rtloop.
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
        """Send a motion to rtloop and start it.

        Args:
            stops: `RobotLink.stops` at the time of the request.
            tool: version of the tool that the motion was planned with.
            fence: fence that the TCP may not leave.
            signals: actions and conditions on the path.

        Returns:
            The number of the motion.

        Raises:
            ExecutionError: rtloop rejects the motion; the error gives the reason.
            UnavailableError: rtloop does not answer; or see `Heartbeat.require_awake`.
            InputError: the motion is larger than a slot.
        """
        async with self._turn:
            # Count here too, because the state may be from the cycle before the last acknowledgement.
            self._last_motion = max(self._last_motion, self._link.state().motion_id) + 1
            motion_id, number = self._last_motion, self._last_motion % SLOTS
            self._slot, self.handed_over = number, (motion_id, trajectory)
            motions = self._link.motions
            motions.prepare(motion_id, trajectory.duration_s)
            try:
                await self._write(number, motion_id, trajectory, fence, signals)
            except BaseException:  # also on cancellation, because nothing has been sent
                self.handed_over = None
                motions.forget_begin()
                raise
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
        """Continue the current motion on a new trajectory. It remains the same motion, within the same fence.

        Args:
            trajectory: the new trajectory. It must equal the current one up to the point that the arm reaches
                while rtloop reads it.
            offset_s: path time of the current trajectory at which the new one begins.
            stops, tool: see `start`.
            signals: actions and conditions, with path times of the new trajectory. Actions that have fired do
                not fire again.

        Raises:
            ExecutionError: rtloop rejects the trajectory; the error gives the reason. The motion continues
                unchanged.
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
                timeout_s=ACKNOWLEDGE_S
                + loading_s(trajectory.segments, self._memory.period_s) / min(self._link.time_factor, 1.0),
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
        """Write a trajectory into a slot. Even after an error, this returns only once its thread has stopped
        writing, so that the next command has the slot for itself.
        """
        slot = self._memory.slots[number]
        if trajectory.segments <= IN_THREAD_SEGMENTS:
            slot.write(motion_id, trajectory, fence, signals)
            return
        writing = asyncio.create_task(asyncio.to_thread(slot.write, motion_id, trajectory, fence, signals))
        try:
            await asyncio.shield(writing)
        except asyncio.CancelledError:
            while not writing.done():
                with contextlib.suppress(asyncio.CancelledError):
                    await asyncio.wait({writing})
            raise

    async def set_rate(self, rate: float) -> None:
        """Change the rate of path time per clock time for the current motion, from 0 (pause) to 1.

        Raises:
            ExecutionError: no motion is running.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.SET_RATE, stops=self._link.stops, value=rate)

    async def set_tool(self, tool: Tool, mounted: Tool, scene_version: int) -> None:
        """Make rtloop and the simulation use this tool, and make rtloop read the scene's file.

        Args:
            mounted: the tool without the parts of a simulated cell.

        Raises:
            ExecutionError: rtloop rejects the tool, for example because the arm is moving; the error gives
                the reason.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            fill(self._memory.tool.data, tool, mounted)
            self._memory.tool.publish()
            await self._send(Command.TOOL, stops=self._link.stops, tool=tool.version, scene=scene_version)

    async def set_output(self, name: str, value: float) -> None:
        """Send the value of an output to the device. The output is set when the device reports it.

        Raises:
            ExecutionError: the device rejects the value; the error gives the reason.
            UnavailableError: rtloop does not answer this command or an earlier one. The output will not be
                set later either.
        """
        try:
            async with asyncio.timeout(ACKNOWLEDGE_S):
                await self._turn.acquire()
        except TimeoutError as exc:  # a reset may take much longer than the client waits
            raise UnavailableError(
                f"{name} is not set, because rtloop has been busy with another command, for example a "
                f"reset, for {ACKNOWLEDGE_S:g} s; try again"
            ) from exc
        try:
            record = self._memory.output.data
            record["name"], record["value"] = name.encode(), value
            self._memory.output.publish()
            await self._send(Command.OUTPUT, stops=self._link.stops)
        finally:
            self._turn.release()

    async def reset_cell(self) -> None:
        """Reset the simulated cell to its initial state.

        Raises:
            ExecutionError: rtloop rejects the reset, for example because the arm is moving; the error gives
                the reason.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.RESET_CELL, stops=self._link.stops)

    async def restart(self) -> None:
        """Reset the simulated arm and its cell to their initial state.

        Raises:
            ExecutionError: rtloop rejects the reset because the arm is moving or is not simulated; the error
                gives the reason.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.RESTART, stops=self._link.stops)

    async def set_time_factor(self, factor: float) -> None:
        """Set the robot time per wall time while a planned motion of a simulated arm runs.

        Raises:
            ExecutionError: rtloop rejects the factor; the error gives the reason.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.TIME_FACTOR, stops=self._link.stops, value=factor)

    async def pull(self, link: str, point: Sequence[float] = (), target: Sequence[float] = ()) -> None:
        """Pull the simulated arm at a point of a link towards a target. If `link` is empty, release the arm.

        Raises:
            ExecutionError: rtloop rejects the pull; the error gives the reason.
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
        """Make rtloop read the scene's file, before the next streaming session begins.

        Raises:
            ExecutionError: rtloop rejects the command, because a streaming session is active.
            UnavailableError: rtloop does not answer.
        """
        async with self._turn:
            await self._send(Command.SCENE, stops=self._link.stops, scene=version)

    async def reset(self, timeout_s: float) -> None:
        """Leave ESTOP or FAULT. Pending earlier requests can no longer move the arm.

        Args:
            timeout_s: timeout for the robot to be enabled.

        Raises:
            ConflictError: the arm is moving, so there is nothing to reset.
            NotReadyError: the cause persists; the error gives rtloop's reason.
            UnavailableError: rtloop does not answer.
        """
        state = await self._link.await_fresh_state(min(timeout_s, STATE_S))
        if state.mode in (LoopMode.TRAJECTORY, LoopMode.STOPPING):
            raise ConflictError(f"motion {state.motion_id} is {state.mode.name}: there is nothing to reset")
        if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            self._link.request_stop()
        # a stop that is requested during this wait takes precedence
        asked = self._link.stops + self._link.estops
        async with self._turn:
            try:
                await self._send(Command.RESET, stops=asked, timeout_s=timeout_s)
            except ExecutionError as exc:
                raise NotReadyError(str(exc)) from exc

    async def acknowledge(self) -> None:
        """Confirm to rtloop that a person has checked the findings of the first contact against the arm.

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
        """Send a command and wait until rtloop has executed it. If rtloop does not answer in time, a stop is
        requested. The command is then never executed, because rtloop rejects commands from before a stop.
        """
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
    """Return the maximum time that rtloop needs to load a motion, s. It includes a reserve, because a busy
    computer may miss half of the cycles.
    """
    return 2.0 * period_s * segments / LOADED_SEGMENTS
