"""The streaming client's blocks in shared memory, and the one way in which a session begins and ends."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from cobot.ipc.layout import POINTS, Ack, text
from cobot.ipc.shm import MemoryRole, RobotMemory


def _after(number: int) -> int:
    """The next number of a session: 64 bits, and never 0, which is none."""
    return number % (2**64 - 1) + 1


class StreamWriter:
    """Writes for one session after the other. Waits for nothing.

    Args:
        memory: mapped in any role; `MemoryRole.STREAM` is taken on top for the time of a session.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self._memory = memory

    def begin(self, request: np.ndarray, stops: int) -> int:
        """Ask rtloop for a session; then `answer` tells, and `release` is due in any case.

        Args:
            request: `cobot.ipc.layout.session_dtype`; its number, process and count of stops are filled in.
            stops: requested so far: rtloop refuses a session that a stop has overtaken.

        Returns:
            The session's number.

        Raises:
            ConflictError: another process streams.
        """
        memory = self._memory
        memory.take(MemoryRole.STREAM)
        number = _after(int(memory.session.salvage()["number"]))
        if number == int(memory.session_ack.salvage()["session"]):
            number = _after(number)  # the block was spoilt, and this one has been answered before
        request["number"], request["open"], request["pid"], request["stops"] = number, 1, os.getpid(), stops
        memory.stream_requests.salvage()
        memory.session.data[...] = request
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

    def finish(self) -> None:
        """Have a servo session end after the points that it has, or soon."""
        self._memory.session.data["open"] = 2
        self._memory.session.publish()

    def release(self) -> None:
        """Let somebody else stream."""
        self._memory.release(MemoryRole.STREAM)


class PointWriter:
    """Puts the points of servo sessions into the ring. Waits for nothing.

    Args:
        memory: of a process that has `MemoryRole.STREAM` while it writes.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self._memory = memory
        self._session = self._seen = self.number = 0

    def begin(self, session: int) -> None:
        """Points are of this session from now on; a state shows it already."""
        self._session, self._seen, self.number = session, 0, 0

    def put(self, joints: Sequence[float], time_s: float, lookahead_s: float, gain: float) -> bool:
        """One more point, rad and s; False if rtloop has not read enough yet to make room for it."""
        if self.number - self._seen >= POINTS:
            self._look()
            if self.number - self._seen >= POINTS:
                return False
        memory, number = self._memory, self.number + 1
        block = memory.points[number % POINTS]
        point = block.data
        point["number"], point["time_s"] = number, time_s
        point["lookahead_s"], point["gain"], point["joints"] = lookahead_s, gain, joints
        block.publish()
        memory.point_head.data["session"], memory.point_head.data["number"] = self._session, number
        memory.point_head.publish()
        self.number = number
        return True

    def _look(self) -> None:
        """How far rtloop has read."""
        state = self._memory.state
        if state.try_read() and int(state.data["session"]) == self._session:
            self._seen = int(state.data["point_seen"])
