"""The streaming client's blocks in shared memory, and the one way in which a session begins and ends."""

from __future__ import annotations

import os

import numpy as np

from cobot.layout import Ack
from cobot.shm import RobotMemory, Role, text


class StreamWriter:
    """Writes for one session after the other. Waits for nothing.

    Args:
        memory: mapped in any role; `Role.STREAM` is taken on top for the time of a session.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self._memory = memory

    def begin(self, wish: np.ndarray, stops: int) -> int:
        """Ask rtloop for a session; then `answer` tells, and `release` is due in any case.

        Args:
            wish: `cobot.layout.session_dtype`; its number, process and count of stops are filled in.
            stops: requested so far: rtloop refuses a session that a stop has overtaken.

        Returns:
            The session's number.

        Raises:
            ConflictError: another process streams.
        """
        memory = self._memory
        memory.take(Role.STREAM)
        number = int(memory.session.salvage()["number"]) + 1
        wish["number"], wish["open"], wish["pid"], wish["stops"] = number, 1, os.getpid(), stops
        memory.stream_requests.salvage()
        memory.session.data[...] = wish
        memory.session.publish()
        return number

    def answer(self, number: int) -> str | None:
        """Why rtloop refuses this session, "" if it does not; None as long as it has not answered."""
        ack = self._memory.session_ack
        if not ack.try_read() or int(ack.data["session"]) != number:
            return None
        return "" if int(ack.data["result"]) == Ack.ACCEPTED else text(ack.data["message"])

    def setpoint(self, setpoint: np.ndarray) -> None:
        self._memory.setpoint.data[...] = setpoint
        self._memory.setpoint.publish()

    def chunk(self, chunk: np.ndarray) -> None:
        self._memory.chunk.data[...] = chunk
        self._memory.chunk.publish()

    def estop(self) -> None:
        self._memory.stream_requests.data["estops"] += 1
        self._memory.stream_requests.publish()

    def end(self) -> None:
        """Have the session end: the arm comes to rest."""
        self._memory.session.data["open"] = 0
        self._memory.session.publish()

    def release(self) -> None:
        """Let somebody else stream."""
        self._memory.release(Role.STREAM)
