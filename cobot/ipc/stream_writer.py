"""The blocks of the streaming client in shared memory. All sessions begin and end here."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from cobot.ipc.layout import POINTS, Ack, text
from cobot.ipc.shm import MemoryRole, RobotMemory


def _after(number: int) -> int:
    """The next session number. It has 64 bits and is never 0, which means no session."""
    return number % (2**64 - 1) + 1


class StreamWriter:
    """Writes the blocks of one session after the other. No call blocks.

    Args:
        memory: memory that is mapped in any role. `MemoryRole.STREAM` is added during a session.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self._memory = memory

    def begin(self, request: np.ndarray, stops: int) -> int:
        """Request a session from rtloop. Read the result with `answer`, and always call `release` afterwards.

        Args:
            request: record of `cobot.ipc.layout.session_dtype`; this method fills in the number, the process
                and the count of stops.
            stops: stops requested so far; rtloop rejects the session if there are more by then.

        Returns:
            Session number.

        Raises:
            ConflictError: another process is streaming.
        """
        memory = self._memory
        memory.take(MemoryRole.STREAM)
        number = _after(int(memory.session.salvage()["number"]))
        if number == int(memory.session_ack.salvage()["session"]):
            number = _after(number)  # the block was damaged, and this number is already answered
        request["number"], request["open"], request["pid"], request["stops"] = number, 1, os.getpid(), stops
        memory.stream_requests.salvage()
        memory.session.data[...] = request
        memory.session.publish()
        return number

    def answer(self, number: int) -> str | None:
        """The reason why rtloop rejects this session; "" if the session is accepted; None if there is no
        answer yet.
        """
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
        """End the session, which stops the arm."""
        self._memory.session.data["open"] = 0
        self._memory.session.publish()

    def finish(self) -> None:
        """End a servo session when its points have been executed, or shortly after."""
        self._memory.session.data["open"] = 2
        self._memory.session.publish()

    def release(self) -> None:
        """Allow other processes to stream."""
        self._memory.release(MemoryRole.STREAM)


class PointWriter:
    """Writes the points of servo sessions into the ring. No call blocks.

    Args:
        memory: must have `MemoryRole.STREAM` while writing.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self._memory = memory
        self._session = self._seen = self.number = 0

    def begin(self, session: int) -> None:
        """Write points of this session from now on. rtloop's state must already show the session."""
        self._session, self._seen, self.number = session, 0, 0

    def put(self, joints: Sequence[float], time_s: float, lookahead_s: float, gain: float) -> bool:
        """Write a servo point, in rad and s. Returns False if the ring is full because rtloop has not read
        enough points.
        """
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
        """Update the number of points that rtloop has read."""
        state = self._memory.state
        if state.try_read() and int(state.data["session"]) == self._session:
            self._seen = int(state.data["point_seen"])
