"""The service's end of the robot's shared memory.

Only one may send commands: every one of them, and its acknowledgement, is here.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import AsyncIterator, Callable
from typing import Any

import numpy as np

from app.services.events.ring import Events, RobotEvents
from app.services.motion.lease import CLIENT
from app.services.state.robot_state import RobotState
from cobot.addresses import address
from cobot.clock import SYSTEM, Clock
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    NotReadyError,
    TornReadError,
    UnavailableError,
)
from cobot.ipc.layout import LOADED_SEGMENTS, RING, SLOTS, Ack, Command, MotionResult, record_of, text
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.tool_record import fill
from cobot.motions.fence import Fence
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import LoopMode

HEARTBEAT_S = 0.05
POLL_S = 0.002
ACKNOWLEDGE_S = 3.0
"""rtloop verifies the largest trajectory in about a second."""
STATE_TRIES = 3
"""So often a state is read that rtloop may be writing just now."""
ENDS = {
    MotionResult.ARRIVED: "finished",
    MotionResult.STOPPED: "stopped",
    MotionResult.STOPPED_ASIDE: "stopped",
    MotionResult.FAILED: "failed",
}
"""What an event says of each."""
IN_THREAD_SEGMENTS = 2000
"""A longer trajectory is copied in a thread, so that nobody else waits."""
PAUSE_S = 1.0
"""A service without a sign of life for so long stood still; rtloop has stopped the arm by then."""
CATCH_UP_S = 0.25
"""In so much time after that it has read what came meanwhile."""

log = logging.getLogger("cobot.service")


class RobotLink:
    """Reads the state, sends commands. Nothing in here waits on a lock.

    Attributes:
        clock: of the service; its moments and those in shared memory can be compared.
        label: what log lines about this robot begin with; "" if it is the only one.
        on_outside_stop: called when somebody has stopped the arm through shared memory, as `cobot stop` does.
        ended: how many motions have ended in which way. None is missed: a motion begins only after somebody
            has seen how the one before it ended.
        events: where what happens to this robot is told.

    Raises (constructor):
        UnavailableError: there is no such robot.
        ConflictError: another service serves it.
        LayoutError: its shared memory is another version's.
    """

    def __init__(
        self,
        robot: str,
        stale_after_s: float,
        label: str = "",
        clock: Clock = SYSTEM,
        events: Events | None = None,
    ) -> None:
        self.events = RobotEvents(Events(clock) if events is None else events, robot)
        self.memory = RobotMemory.attach(robot, MemoryRole.SERVICE)
        self.label = label
        self.clock = clock
        self._stale_after_s = stale_after_s
        self.ended = dict.fromkeys(ENDS, 0)
        self._last_ended = 0
        self._take_over()
        self.on_outside_stop: Callable[[], None] | None = None
        self._command_turn = asyncio.Lock()
        self._last_motion = 0
        self._slot = 0
        self.handed_over: tuple[int, Trajectory] | None = None
        self._beginning: dict[str, Any] = {}  # what there is to tell of a motion that is being started
        self._beaten_s: float | None = None
        self._paused_s, self._resumed_s = 0.0, float("-inf")

    def close(self) -> None:
        self.memory.close()

    def _take_over(self) -> None:
        """Count on from where the last service stopped; where that cannot be read, from what rtloop saw."""
        memory = self.memory
        seen = memory.state.data if memory.state.try_read() else None
        if seen is not None and seen["motion_result"] != MotionResult.RUNNING:
            self._last_ended = int(seen["motion_id"])
        if not memory.requests.try_read() and seen is not None:  # what rtloop saw is of both counters
            outside = np.uint64(memory.outside_stops.value), np.uint64(memory.outside_estops.value)
            memory.requests.data["stops"] = seen["stops_seen"] - outside[0]
            memory.requests.data["estops"] = seen["estops_seen"] - outside[1]
        if not memory.head.try_read() and seen is not None:
            memory.head.data["id"] = seen["command_seen"]

    @contextlib.asynccontextmanager
    async def heartbeat(self) -> AsyncIterator[None]:
        """Tell rtloop that the service is alive, from the event loop itself: a stuck one is a dead one."""
        task = asyncio.create_task(self._beat(), name="heartbeat")
        try:
            yield
        finally:
            task.cancel()

    async def _beat(self) -> None:
        block = self.memory.heartbeat
        block.data["pid"] = os.getpid()
        outside = self.memory.outside_stops.value
        while True:
            if (newest := self.memory.outside_stops.value) != outside:
                outside = newest
                if self.on_outside_stop is not None:
                    self.on_outside_stop()
            if self._beaten_s is not None:
                self._note_pause()
                self._beaten_s = self.clock.now_s()
            block.data["monotonic_ns"] = self.clock.now_ns()
            block.publish()
            await asyncio.sleep(HEARTBEAT_S)

    def watch_for_pauses(self) -> None:
        """The service has started, which may take long and is no pause; from now on `require_awake` tells."""
        self._beaten_s = self.clock.now_s()

    def _note_pause(self) -> None:
        """See whether this process has just gone on after a pause."""
        now_s = self.clock.now_s()
        if self._beaten_s is not None and now_s - self._beaten_s > PAUSE_S:
            self._paused_s, self._resumed_s = now_s - self._beaten_s, now_s
            self._beaten_s = now_s
            log.warning("%sthe service stood still for %.1f s", self.label, self._paused_s)

    def require_awake(self) -> None:
        """See that what has been asked for can be new: while this process stands still, requests wait.

        Raises:
            UnavailableError: it stood still until just now.
        """
        self._note_pause()
        if self.clock.now_s() - self._resumed_s < CATCH_UP_S:
            raise UnavailableError(
                f"the service stood still for {self._paused_s:.1f} s until just now: what was asked for "
                "meanwhile moves nothing; ask again"
            )

    def state(self) -> RobotState:
        """The newest state, however old.

        Raises:
            UnavailableError: rtloop has never published one, or died while it did.
        """
        try:
            record = self.memory.state.read()
        except TornReadError as exc:
            raise UnavailableError(str(exc)) from exc
        if self.memory.state.sequence == 0:
            raise UnavailableError("rtloop has not started yet")
        state = RobotState(record, self.clock.now_ns())
        if state.motion_id != self._last_ended and state.motion_result in self.ended:
            self._last_ended = state.motion_id
            self.ended[state.motion_result] += 1
            self._tell_end(state)
        return state

    def _tell_begun(self) -> None:
        if self._beginning:
            self.events.publish("motion", what="begun", **self._beginning)
            self._beginning = {}

    def _tell_end(self, state: RobotState) -> None:
        if state.motion_id == self._beginning.get("motion"):  # it was short: `start` has not noticed yet
            self._tell_begun()
        result = state.motion_result
        self.events.publish(
            "motion",
            what=ENDS[result],
            motion=state.motion_id,
            reason="" if result is MotionResult.ARRIVED else state.reason,
            path_time_s=state.path_time_s,
            duration_s=state.path_duration_s,
        )

    def record_since(self, publication: int) -> tuple[int, np.ndarray | None]:
        """The newest publication's number, and a copy of all of it if it is newer than this one."""
        block = self.memory.state
        for _ in range(STATE_TRIES):
            newest = block.sequence
            if newest == publication:
                break
            if block.try_read() and block.sequence == newest:  # or it is a later one, which would come twice
                return newest, record_of(block.data.tobytes(), block.data.dtype)
        return publication, None

    def streamer(self) -> str | None:
        """Who streams to the arm, for people: the process that has opened the session."""
        process = self.streaming_process()
        if process is None:
            return None
        return f"a streaming client (process {process})" if process else "a streaming client"

    def streaming_process(self) -> int | None:
        """The process that has opened the session; 0 if that cannot be read, None if there is no session."""
        try:
            state = self.state()
            if state.session == 0 or state.age_s > self._stale_after_s:
                return None
            return int(self.memory.session.read()["pid"])
        except UnavailableError:
            return None
        except TornReadError:
            return 0

    def sessions(self) -> int | None:
        """How many streaming sessions have been asked for; None if that cannot be read."""
        try:
            return int(self.memory.session.read()["number"])
        except TornReadError:
            return None

    def statistics(self) -> np.ndarray:
        """A copy of rtloop's statistics block.

        Raises:
            UnavailableError: it cannot be read.
        """
        try:
            return self.memory.statistics.read().copy()
        except TornReadError as exc:
            raise UnavailableError(str(exc)) from exc

    async def fresh_state(self, timeout_s: float) -> RobotState:
        """The newest state, if rtloop is alive; waits for it to become so.

        Raises:
            UnavailableError: nothing fresh within the timeout, with how rtloop stands.
        """
        deadline_s = self.clock.now_s() + timeout_s
        while True:
            try:
                state = self.state()
                if state.age_s <= self._stale_after_s:
                    return state
                problem = f"rtloop (pid {self._rtloop_pid()}) has published nothing for {state.age_s:.1f} s"
            except UnavailableError as exc:
                problem = str(exc)
            if self.clock.now_s() > deadline_s:
                raise UnavailableError(f"{problem}; cobot run restarts it if it has died")
            await asyncio.sleep(0.01)

    async def measured_state(self, timeout_s: float) -> RobotState:
        """A fresh state with fresh measurements.

        Raises:
            UnavailableError: see `fresh_state`; or the robot cannot be read, with the reason.
        """
        state = await self.fresh_state(timeout_s)
        if state.measured_age_s > self._stale_after_s:
            raise UnavailableError(f"not measured for {state.measured_age_s:.1f} s: {state.reason}")
        return state

    async def measured_record(self, timeout_s: float) -> np.ndarray:
        """A copy of all that rtloop publishes, `cobot.ipc.layout.state_dtype`; raises as `measured_state`."""
        return (await self.measured_state(timeout_s)).record

    async def ready_state(self, timeout_s: float) -> RobotState:
        """A fresh state in which motion is permitted.

        Raises:
            UnavailableError: see `fresh_state`.
            NotReadyError: ESTOP or FAULT, with the reason and the way out.
        """
        state = await self.fresh_state(timeout_s)
        if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            reset = f"{address('', self.memory.robot)}/reset" if self.label else "/robot/reset"
            raise NotReadyError(
                f"the robot is in mode {state.mode.name}: {state.reason}; see to the cause, then POST {reset}"
            )
        return state

    @property
    def stops(self) -> int:
        """How many stops have been requested so far: a motion started with an older count is refused."""
        return int(self.memory.requests.data["stops"]) + self.memory.outside_stops.value

    def request_stop(self) -> None:
        """Have rtloop bring the arm to rest on its path. Takes effect in its next cycle."""
        self.memory.requests.data["stops"] += 1
        self.memory.requests.publish()

    def request_estop(self) -> None:
        """The same, latched until a reset."""
        self.memory.requests.data["estops"] += 1
        self.memory.requests.publish()
        self.events.publish("estop", what="asked for", by=str(CLIENT.get()))

    async def start(
        self, trajectory: Trajectory, stops: int, tool: int = 0, fence: Fence | None = None
    ) -> int:
        """Hand a motion over and have it started.

        Args:
            stops: `stops` as it was when the motion was asked for.
            tool: the version of the tool that it was planned with.
            fence: that the TCP may not leave.

        Returns:
            The motion's number.

        Raises:
            ExecutionError: rtloop refuses it, with its reason.
            UnavailableError: rtloop does not answer, or see `require_awake`.
            InputError: the motion is larger than a slot.
        """
        async with self._command_turn:
            # The state may be of the cycle before the last acknowledgement.
            self._last_motion = max(self._last_motion, self.state().motion_id) + 1
            motion_id, number = self._last_motion, self._last_motion % SLOTS
            self._slot, self.handed_over = number, (motion_id, trajectory)
            self._beginning = {
                "motion": motion_id,
                "duration_s": trajectory.duration_s,
                "by": str(CLIENT.get()),
            }
            await self._write(number, motion_id, trajectory, fence)
            try:
                self.require_awake()
                await self._send(
                    Command.START,
                    slot=number,
                    motion_id=motion_id,
                    stops=stops,
                    tool=tool,
                    timeout_s=ACKNOWLEDGE_S + loading_s(trajectory.segments, self.memory.period_s),
                )
            except CobotError:
                self.handed_over = None
                self._beginning = {}
                raise
            self._tell_begun()
        return motion_id

    async def replace(self, trajectory: Trajectory, offset_s: float, stops: int, tool: int = 0) -> None:
        """Have the motion under way go on with another trajectory, as the same motion, within the same fence.

        Args:
            trajectory: the same as the one under way up to where the arm is when rtloop has read it.
            offset_s: the path time of the one under way at which it begins.
            stops, tool: see `start`.

        Raises:
            ExecutionError: rtloop refuses it, with its reason; the motion goes on as it was.
            UnavailableError, InputError: see `start`.
        """
        async with self._command_turn:
            number = (self._slot + 1) % SLOTS
            await self._write(number, self._last_motion, trajectory)
            self.require_awake()
            await self._send(
                Command.REPLACE,
                slot=number,
                motion_id=self._last_motion,
                stops=stops,
                value=offset_s,
                tool=tool,
                timeout_s=ACKNOWLEDGE_S + loading_s(trajectory.segments, self.memory.period_s),
            )
            self._slot, self.handed_over = number, (self._last_motion, trajectory)

    async def _write(
        self, number: int, motion_id: int, trajectory: Trajectory, fence: Fence | None = None
    ) -> None:
        slot = self.memory.slots[number]
        if trajectory.segments > IN_THREAD_SEGMENTS:
            await asyncio.to_thread(slot.write, motion_id, trajectory, fence)
        else:
            slot.write(motion_id, trajectory, fence)

    async def set_rate(self, rate: float) -> None:
        """Go over to another path time per clock time, 0 (pause) to 1, of the motion that runs.

        Raises:
            ExecutionError: no motion is running.
            UnavailableError: rtloop does not answer.
        """
        async with self._command_turn:
            await self._send(Command.SET_RATE, stops=self.stops, value=rate)

    async def set_tool(self, tool: Tool, scene_version: int) -> None:
        """Have rtloop, and the simulation, carry this tool from now on, and read the scene's file.

        Raises:
            ExecutionError: rtloop refuses it, with its reason: the arm moves.
            UnavailableError: rtloop does not answer.
        """
        async with self._command_turn:
            fill(self.memory.tool.data, tool)
            self.memory.tool.publish()
            await self._send(Command.TOOL, stops=self.stops, tool=tool.version, scene=scene_version)

    async def read_scene(self, version: int) -> None:
        """Have rtloop read the scene's file, before the next stream begins.

        Raises:
            ExecutionError: rtloop refuses it, with its reason: somebody streams.
            UnavailableError: rtloop does not answer.
        """
        async with self._command_turn:
            await self._send(Command.SCENE, stops=self.stops, scene=version)

    @property
    def tool_version(self) -> int | None:
        """Of the tool that rtloop carries; None if that cannot be read."""
        return self._version("tool_version")

    @property
    def scene_version(self) -> int | None:
        """Of the scene that rtloop was told of last; None if that cannot be read."""
        return self._version("scene_version")

    def _version(self, name: str) -> int | None:
        if self.memory.info.sequence == 0 or not self.memory.info.try_read():
            return None
        return int(self.memory.info.data[name])

    async def reset(self, timeout_s: float) -> None:
        """Leave ESTOP or FAULT. What was asked for before, and waits for something, moves nothing any more.

        Raises:
            ConflictError: the arm moves, so there is nothing to reset.
            NotReadyError: the cause persists, with rtloop's reason.
            UnavailableError: rtloop does not answer.
        """
        state = await self.fresh_state(timeout_s)
        if state.mode in (LoopMode.TRAJECTORY, LoopMode.STOPPING):
            raise ConflictError(f"motion {state.motion_id} is {state.mode.name}: there is nothing to reset")
        if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            self.request_stop()
        async with self._command_turn:
            try:
                await self._send(Command.RESET, stops=self.stops, timeout_s=timeout_s)
            except ExecutionError as exc:
                raise NotReadyError(str(exc)) from exc

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
        number = int(self.memory.head.data["id"]) + 1
        command = self.memory.commands[number % RING]
        command.data["id"] = number
        command.data["kind"] = kind
        command.data["slot"] = slot
        command.data["motion_id"] = motion_id
        command.data["stops"] = stops
        command.data["value"] = value
        command.data["tool"] = tool
        command.data["scene"] = scene
        command.publish()
        self.memory.head.data["id"] = number
        self.memory.head.publish()
        ack = self.memory.acks[number % RING]
        deadline_s = self.clock.now_s() + timeout_s
        answered = False
        try:
            while not (answered := ack.try_read() and int(ack.data["id"]) == number):
                if self.clock.now_s() > deadline_s:
                    rtloop = f"rtloop (pid {self._rtloop_pid()})"
                    raise UnavailableError(f"{rtloop} has not answered a {kind.name} for {timeout_s:.2g} s")
                await asyncio.sleep(POLL_S / 2)
        finally:
            if not answered:
                self.request_stop()
        if int(ack.data["result"]) != Ack.ACCEPTED:
            raise ExecutionError(text(ack.data["message"]))

    def _rtloop_pid(self) -> int:
        return int(self.statistics()["pid"])


def loading_s(segments: int, period_s: float) -> float:
    """How long rtloop may take to load a motion: a busy computer may miss as many cycles again."""
    return 2.0 * period_s * segments / LOADED_SEGMENTS
