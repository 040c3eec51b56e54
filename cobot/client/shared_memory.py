"""Connection of a `Robot` to the rtloop on the same computer, through Linux shared memory."""

from __future__ import annotations

import threading

import numpy as np

from cobot.clock import SYSTEM, Clock
from cobot.errors import ConflictError, ExecutionError, InputError, TornReadError, UnavailableError
from cobot.ipc.first_target import FirstTarget
from cobot.ipc.layout import Stream, record_of, text
from cobot.ipc.memory_file import robots_running
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.stream_writer import StreamWriter
from cobot.types import LoopMode

STALE_S = 0.25
"""Maximum age of a usable state, in seconds. rtloop publishes a thousand states per second."""
ANSWER_S = 2.0
POLL_S = 0.001


class SharedMemoryTransport:
    """The `Transport` that is used on the robot's computer."""

    def __init__(self, robot: str, clock: Clock = SYSTEM) -> None:
        self.clock = clock
        try:
            self._memory = RobotMemory.attach(robot, MemoryRole.READER)
        except UnavailableError as exc:
            running = ", ".join(robots_running()) or "none"
            raise UnavailableError(f"{exc}; robots that run here: {running}") from exc
        self.robot, self.url, self.dof = robot, self._memory.url, self._memory.dof
        self._writer = StreamWriter(self._memory)
        self._turn = threading.Lock()
        self._streaming = False
        self._session = 0
        self._first: FirstTarget | None = None
        self.state()  # rtloop describes its robot before its first cycle

    @property
    def info(self) -> np.ndarray:
        with self._turn:
            try:
                return self._memory.info.read().copy()
            except TornReadError as exc:
                raise UnavailableError(f"robot {self.robot!r}: {exc}") from exc

    def state(self) -> np.ndarray:
        block = self._memory.state
        with self._turn:
            try:
                record = record_of(block.read().tobytes(), block.data.dtype)
            except TornReadError as exc:
                raise UnavailableError(f"robot {self.robot!r}: {exc}") from exc
        age_s = (self.clock.now_ns() - int(record["monotonic_ns"])) * 1e-9
        if block.sequence == 0 or age_s > STALE_S:
            raise UnavailableError(f"robot {self.robot!r}: rtloop has published nothing for {age_s:.1f} s")
        return record

    def open_session(self, request: np.ndarray) -> int:
        state = self.state()
        if state["session"]:
            raise ConflictError(
                f"the arm is in mode {LoopMode(int(state['mode'])).name}: another client is already streaming"
            )
        number = self._writer.begin(request, int(state["stops_seen"]))
        try:
            self._await_session(number)
        except (ExecutionError, UnavailableError):
            self._writer.end()
            self._writer.release()
            raise
        self._streaming = True
        names = [text(name) for name in self.info["joint_names"]]
        self._session = number
        self._first = FirstTarget(Stream(int(request["stream"])), names, self.state())
        return number

    def send_setpoint(self, setpoint: np.ndarray) -> None:
        refusal = self._first.refusal(self._session, self.state()) if self._first is not None else ""
        if refusal:
            raise InputError(refusal)
        self._writer.setpoint(setpoint)
        if self._first is not None:
            self._first.note(setpoint)

    def send_chunk(self, chunk: np.ndarray) -> None:
        self._writer.chunk(chunk)

    def request_estop(self) -> None:
        self._writer.estop()

    def end_session(self) -> None:
        if self._streaming:
            self._streaming = False
            self._writer.end()
            self._writer.release()

    def close(self) -> None:
        self.end_session()
        self._memory.close()

    def _await_session(self, number: int) -> None:
        """Wait for rtloop's answer, and for the first state in which the session is active."""
        deadline_s = self.clock.now_s() + ANSWER_S
        while (refusal := self._writer.answer(number)) is None:
            if self.clock.now_s() > deadline_s:
                raise UnavailableError(f"robot {self.robot!r}: rtloop has not answered for {ANSWER_S:g} s")
            self.clock.sleep(POLL_S)
        if refusal:
            raise ExecutionError(refusal)
        while int(self.state()["session"]) != number and self.clock.now_s() < deadline_s:
            self.clock.sleep(POLL_S)
