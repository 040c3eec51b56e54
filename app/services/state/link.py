"""The service's access to the robot's shared memory."""

from __future__ import annotations

import asyncio

import numpy as np

from app.services.clients import CLIENT
from app.services.events.ring import Events, RobotEvents
from app.services.state.commands import Commands
from app.services.state.heartbeat import Heartbeat
from app.services.state.motion_events import MotionEvents
from app.services.state.robot_state import RobotState
from cobot.addresses import address
from cobot.clock import SYSTEM, Clock
from cobot.errors import (
    NotReadyError,
    TornReadError,
    UnavailableError,
)
from cobot.grippers import GripperState
from cobot.ipc.device_record import DeviceReport, device_of
from cobot.ipc.gripper_record import fill_gripper
from cobot.ipc.io_record import IoReport, report_of
from cobot.ipc.layout import CELL_PARTS, MotionResult, record_of, text
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.signal_record import SignalReport, signal_report
from cobot.launch.process import is_gone
from cobot.types import LoopMode, Numbers7

POLL_S = 0.002
STATE_TRIES = 3
"""Number of attempts to read a state, because rtloop may be writing it."""


class RobotLink:
    """Reads the data that rtloop publishes, and requests stops. It never waits for a lock.

    Attributes:
        clock: clock of the service. Shared memory contains times on the same clock.
        label: prefix of log lines about this robot; "" if it is the only one.
        events: publisher for the events of this robot.
        motions: publisher for the beginning and the end of motions.
        heartbeat: heartbeat of the service.
        commands: sends all other commands to rtloop. Only one service at a time may send them.

    The constructor raises UnavailableError if the robot's shared memory does not exist, ConflictError if
    another service uses it, and LayoutError if it is of a different version.
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
        self.motions = MotionEvents(self.events)
        self._take_over()
        self.heartbeat = Heartbeat(self.memory, clock, label)
        self.commands = Commands(self)

    def close(self) -> None:
        self.memory.close()

    def _take_over(self) -> None:
        """Continue the counters of the previous service, and end its motion. If the counters cannot be read,
        continue with the values that rtloop read last.
        """
        memory = self.memory
        seen = memory.state.data if memory.state.try_read() else None
        if seen is not None and seen["motion_result"] != MotionResult.RUNNING:
            self.motions.last_ended = int(seen["motion_id"])
        if not memory.requests.try_read() and seen is not None:
            # Subtract the stops from outside the service, which rtloop's numbers include.
            outside = np.uint64(memory.outside_stops.value), np.uint64(memory.outside_estops.value)
            memory.requests.data["stops"] = seen["stops_seen"] - outside[0]
            memory.requests.data["estops"] = seen["estops_seen"] - outside[1]
            memory.requests.data["fast_stops"] = 0
            memory.requests.publish()  # rtloop must have this before the first command
        if not memory.head.try_read() and seen is not None:
            memory.head.data["id"] = seen["command_seen"]
        if seen is not None and seen["motion_result"] == MotionResult.RUNNING:
            # The service that began the motion has ended, so no client is waiting for it.
            self.request_stop()

    def state(self) -> RobotState:
        """Return the newest state, regardless of its age.

        Raises:
            UnavailableError: rtloop has never published a state, or died while writing one.
        """
        try:
            record = self.memory.state.read()
        except TornReadError as exc:
            raise UnavailableError(str(exc)) from exc
        if self.memory.state.sequence == 0:
            raise UnavailableError("rtloop has not started yet")
        state = RobotState(record, self.clock.now_ns())
        self.motions.look(state)
        return state

    @property
    def time_factor(self) -> float:
        """Robot time per wall time while a planned motion runs; 1 if rtloop's state cannot be read."""
        try:
            return self.state().time_factor
        except UnavailableError:
            return 1.0

    @property
    def hurry(self) -> float:
        """The maximum path time that passes per second in which a motion is planned: 1, or the time factor of
        a simulation that is faster than real time.
        """
        return max(self.time_factor, 1.0)

    def silence(self, state: RobotState) -> str:
        """Return the reason why this state is out of date; "" while rtloop is alive.

        Also checks the process, because a state that was published just before rtloop died is still fresh.
        """
        pid = self.rtloop_pid()
        if state.age_s > self._stale_after_s:
            return f"rtloop (pid {pid}) has published nothing for {state.age_s:.1f} s"
        return f"rtloop (pid {pid}) has ended" if is_gone(pid) else ""

    def record_since(self, publication: int) -> tuple[int, np.ndarray | None]:
        """Return the number of the newest publication, and a copy of the publication if it is newer than the
        given number.
        """
        block = self.memory.state
        for _ in range(STATE_TRIES):
            newest = block.sequence
            if newest == publication:
                break
            # otherwise the record is a later state, which would be returned again next time
            if block.try_read() and block.sequence == newest:
                return newest, record_of(block.data.tobytes(), block.data.dtype)
        return publication, None

    def streamer(self) -> str | None:
        """Describe the streaming process; None if there is no session."""
        process = self.streaming_process()
        if process is None:
            return None
        return f"a streaming client (process {process})" if process else "a streaming client"

    def streaming_process(self) -> int | None:
        """Return the id of the process that has opened the session; 0 if it cannot be read, None if there is
        no session.
        """
        try:
            state = self.state()
            if state.session == 0 or self.silence(state):
                return None
            return int(self.memory.session.read()["pid"])
        except UnavailableError:
            return None
        except TornReadError:
            return 0

    def sessions(self) -> int | None:
        """Return the number of streaming sessions that were requested so far; None if rtloop's state cannot
        be read.
        """
        try:
            return int(self.memory.session.read()["number"])
        except TornReadError:
            return None

    def statistics(self) -> np.ndarray:
        """Return a copy of rtloop's statistics block.

        Raises:
            UnavailableError: the block cannot be read.
        """
        try:
            return self.memory.statistics.read().copy()
        except TornReadError as exc:
            raise UnavailableError(str(exc)) from exc

    async def await_fresh_state(self, timeout_s: float) -> RobotState:
        """Wait for a fresh state from rtloop and return it.

        Raises:
            UnavailableError: there is no fresh state within the timeout; the error gives rtloop's status.
        """
        deadline_s = self.clock.now_s() + timeout_s
        while True:
            try:
                state = self.state()
                problem = self.silence(state)
                if not problem:
                    return state
            except UnavailableError as exc:
                problem = str(exc)
            if self.clock.now_s() > deadline_s:
                raise UnavailableError(f"{problem}; cobot run restarts it if it has died")
            await asyncio.sleep(0.01)

    async def await_measured_state(self, timeout_s: float) -> RobotState:
        """Wait for a fresh state with fresh measurements, and return it.

        Raises:
            UnavailableError: see `await_fresh_state`; or the robot cannot be read, and the error gives the
                reason.
        """
        state = await self.await_fresh_state(timeout_s)
        if state.measured_age_s > self._stale_after_s:
            raise UnavailableError(
                f"the arm has not been measured for {state.measured_age_s:.1f} s: {state.reason}"
            )
        return state

    async def await_measured_record(self, timeout_s: float) -> np.ndarray:
        """Return a copy of the state block, see `state_dtype`. Raises the same errors as
        `await_measured_state`.
        """
        return (await self.await_measured_state(timeout_s)).record

    async def await_ready_state(self, timeout_s: float) -> RobotState:
        """Wait for a fresh state in which motion is permitted and return it.

        Raises:
            UnavailableError: see `await_fresh_state`.
            NotReadyError: the mode is ESTOP or FAULT; the error gives the reason and what to do.
        """
        state = await self.await_fresh_state(timeout_s)
        if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            reset = f"{address('', self.memory.robot)}/reset" if self.label else "/robot/reset"
            raise NotReadyError(
                f"the robot is in mode {state.mode.name}: {state.reason}; remove the cause, "
                f"then POST {reset}",
                details={"mode": state.mode.name},
            )
        return state

    @property
    def stops(self) -> int:
        """Number of stops that were requested so far. rtloop rejects a motion with an older count."""
        return int(self.memory.requests.data["stops"]) + self.memory.outside_stops.value

    @property
    def estops(self) -> int:
        """Number of e-stops that have been requested."""
        return int(self.memory.requests.data["estops"]) + self.memory.outside_estops.value

    def request_stop(self, *, fast: bool = False) -> None:
        """Stop the arm on its path, from rtloop's next cycle on.

        Args:
            fast: whether to stop as fast as the limits permit and then switch the drives off. This stop is
                latched until a reset.
        """
        self.memory.requests.data["stops"] += 1
        if fast:
            self.memory.requests.data["fast_stops"] += 1
        self.memory.requests.publish()

    def request_estop(self) -> None:
        """Trigger an e-stop in rtloop's next cycle. It is latched until a reset."""
        self.memory.requests.data["estops"] += 1
        self.memory.requests.publish()
        self.events.publish("estop", what="asked for", by=str(CLIENT.get()))

    def device(self) -> tuple[str, DeviceReport] | None:
        """Return the name of the backend and a description of its device; None if they cannot be read."""
        if self.memory.device.sequence == 0:
            return None
        try:
            named = text(self.memory.statistics.read()["backend"])
            return named, device_of(self.memory.device.read())
        except (TornReadError, ValueError):
            return None

    def io(self) -> IoReport | None:
        """Return the device's report of its inputs and outputs; None if the report cannot be read."""
        if self.memory.io.sequence == 0:
            return None
        try:
            return report_of(self.memory.io.read())  # `read` tries again while rtloop is writing
        except (TornReadError, ValueError):
            return None

    def publish_gripper(self, state: GripperState, read_ns: int) -> None:
        """Make rtloop publish a reading of the gripper with the arm's state, from its next cycle on."""
        fill_gripper(self.memory.gripper.data, state, read_ns)
        self.memory.gripper.publish()

    def signals(self) -> SignalReport | None:
        """Return rtloop's report of the actions and conditions of the motion; None if the report cannot be
        read.
        """
        block = self.memory.signals
        if block.sequence == 0 or not block.try_read():
            return None
        try:
            return signal_report(block.data)
        except ValueError:
            return None

    def cell(self) -> dict[str, Numbers7] | None:
        """Return the poses of the parts of a simulated cell in the base frame; None if they cannot be
        read.
        """
        if self.memory.cell.sequence == 0:
            return None
        try:
            record = self.memory.cell.read()
        except TornReadError:
            return None
        count = min(int(record["count"]), CELL_PARTS)
        names = [text(name) for name in record["names"][:count]]
        return dict(zip(names, (tuple(pose) for pose in record["poses"][:count].tolist()), strict=True))

    @property
    def tool_version(self) -> int | None:
        """Return the version of the tool that rtloop uses; None if it cannot be read."""
        return self._version("tool_version")

    @property
    def scene_version(self) -> int | None:
        """Return the version of the scene that rtloop last received; None if it cannot be read."""
        return self._version("scene_version")

    def _version(self, name: str) -> int | None:
        if self.memory.info.sequence == 0:
            return None
        try:
            return int(self.memory.info.read()[name])
        except TornReadError:
            return None

    def rtloop_pid(self) -> int:
        """Return rtloop's process id. Raises the same errors as `statistics`. This is called for each state,
        so it does not copy the whole block.
        """
        try:
            return int(self.memory.statistics.read()["pid"])
        except TornReadError as exc:
            raise UnavailableError(str(exc)) from exc
