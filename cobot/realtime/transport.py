"""How a `Robot` reaches its rtloop: on the same computer through shared memory."""

from __future__ import annotations

import os
import time
from typing import Protocol

import numpy as np

from cobot.errors import ExecutionError, TornReadError, UnavailableError
from cobot.layout import Ack
from cobot.shm import FOLDER, RobotMemory, Role, text

STALE_S = 0.25
"""A state older than this is none."""
ANSWER_S = 2.0
POLL_S = 0.001


class Transport(Protocol):
    """The way to a robot. Methods of one session may be called from several threads.

    Attributes:
        robot: its name.
        url: of its service, "" if it has none.
        dof: number of joints.
        info: record of `cobot.layout.info_dtype`.
    """

    robot: str
    url: str
    dof: int
    info: np.ndarray

    def state(self) -> np.ndarray:
        """The newest state, a record of `cobot.layout.state_dtype`, which is the caller's to keep.

        Raises:
            UnavailableError: there is none that is fresh.
        """
        ...

    def open_session(self, wish: np.ndarray) -> int:
        """Begin to stream.

        Args:
            wish: record of `cobot.layout.session_dtype`; number, process and count of stops are filled in.

        Returns:
            The session's number.

        Raises:
            ConflictError: somebody else streams.
            ExecutionError: rtloop refuses, with its reason.
            UnavailableError: it does not answer.
        """
        ...

    def send_setpoint(self, setpoint: np.ndarray) -> None:
        """Give what is wanted now, a record of `cobot.layout.setpoint_dtype`."""
        ...

    def send_chunk(self, chunk: np.ndarray) -> None:
        """Give timed targets, a record of `cobot.layout.chunk_dtype`."""
        ...

    def request_estop(self) -> None:
        """At once; waits for nothing and nobody. Only who has a session may."""
        ...

    def end_session(self) -> None:
        """Stop streaming; the arm comes to rest. Nothing happens if there is no session."""
        ...

    def close(self) -> None:
        """End the session and let go of the robot."""
        ...


class SharedMemoryTransport:
    """The `Transport` on the robot's own computer."""

    def __init__(self, robot: str) -> None:
        try:
            self._memory = RobotMemory.attach(robot, Role.READER)
        except UnavailableError as exc:
            running = ", ".join(sorted(path.name.removeprefix("cobot-") for path in FOLDER.glob("cobot-*")))
            raise UnavailableError(f"{exc}; robots that run here: {running or 'none'}") from exc
        self.robot, self.url, self.dof = robot, self._memory.url, self._memory.dof
        self._streaming = False
        self.info = self._read_info()

    def state(self) -> np.ndarray:
        memory = self._memory
        try:
            record = memory.state.read()
        except TornReadError as exc:
            raise UnavailableError(f"robot {self.robot!r}: {exc}") from exc
        age_s = (time.monotonic_ns() - int(record["monotonic_ns"])) * 1e-9
        if memory.state.sequence == 0 or age_s > STALE_S:
            raise UnavailableError(f"robot {self.robot!r}: rtloop has published nothing for {age_s:.1f} s")
        return record.copy()

    def open_session(self, wish: np.ndarray) -> int:
        memory = self._memory
        state = self.state()
        memory.take(Role.STREAM)
        number = int(memory.session.salvage()["number"]) + 1
        wish["number"], wish["open"], wish["pid"], wish["stops"] = number, 1, os.getpid(), state["stops_seen"]
        memory.stream_requests.salvage()
        memory.session.data[...] = wish
        memory.session.publish()
        try:
            self._await_answer(number)
        except (ExecutionError, UnavailableError):
            memory.session.data["open"] = 0
            memory.session.publish()
            memory.release(Role.STREAM)
            raise
        self._streaming = True
        return number

    def send_setpoint(self, setpoint: np.ndarray) -> None:
        block = self._memory.setpoint
        block.data[...] = setpoint
        block.publish()

    def send_chunk(self, chunk: np.ndarray) -> None:
        block = self._memory.chunk
        block.data[...] = chunk
        block.publish()

    def request_estop(self) -> None:
        block = self._memory.stream_requests
        block.data["estops"] += 1
        block.publish()

    def end_session(self) -> None:
        if self._streaming:
            self._streaming = False
            self._memory.session.data["open"] = 0
            self._memory.session.publish()
            self._memory.release(Role.STREAM)

    def close(self) -> None:
        self.end_session()
        self._memory.close()

    def _read_info(self) -> np.ndarray:
        """rtloop describes its robot before its first cycle."""
        self.state()
        try:
            return self._memory.info.read().copy()
        except TornReadError as exc:
            raise UnavailableError(f"robot {self.robot!r}: {exc}") from exc

    def _await_answer(self, number: int) -> None:
        ack = self._memory.session_ack
        deadline_s = time.monotonic() + ANSWER_S
        while not (ack.try_read() and int(ack.data["session"]) == number):
            if time.monotonic() > deadline_s:
                raise UnavailableError(f"robot {self.robot!r}: rtloop has not answered for {ANSWER_S:g} s")
            time.sleep(POLL_S)
        if int(ack.data["result"]) != Ack.ACCEPTED:
            raise ExecutionError(text(ack.data["message"]))
