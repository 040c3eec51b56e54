"""What a streaming client asks of rtloop through shared memory."""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import Ack
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import RobotMemory, encoded


class Inbox:
    """A block that somebody else writes, read when it has changed. Real-time safe.

    Attributes:
        readable: whether `data` is what somebody has written; if not, it is tried again in the next cycle.
        torn_reads: how often it was not consistent.
    """

    def __init__(self, block: Block) -> None:
        self._block = block
        self._sequence = -1
        self.readable = True
        self.torn_reads = 0

    @property
    def data(self) -> np.ndarray:
        return self._block.data

    def changed(self) -> bool:
        """Whether there is news, which is then in `data`."""
        sequence = self._block.sequence
        if sequence == self._sequence:
            return False
        self.readable = self._block.try_read()
        if not self.readable:
            self.torn_reads += 1
            return False
        self._sequence = sequence
        return True


class StreamInbox:
    """The blocks of the streaming client. Real-time safe.

    Attributes:
        session, setpoint, chunk: what it wants, see `cobot.ipc.layout`.
        session_seen: number of the session that was answered last.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self.session = Inbox(memory.session)
        self.setpoint = Inbox(memory.setpoint)
        self.chunk = Inbox(memory.chunk)
        self._requests = Inbox(memory.stream_requests)
        self._ack = memory.session_ack
        self._estops = int(memory.stream_requests.salvage()["estops"])
        # A session that is open already was meant for the rtloop that has died.
        self.session_seen = int(memory.session.salvage()["number"])

    @property
    def torn_reads(self) -> int:
        inboxes = (self.session, self.setpoint, self.chunk, self._requests)
        return sum(inbox.torn_reads for inbox in inboxes)

    def asks(self) -> bool:
        """Whether a client asks for a new session, described in `session`."""
        return bool(
            self.session.changed()
            and self.session.data["open"] == 1
            and self.session.data["number"] != self.session_seen
        )

    def wants(self, number: int) -> bool:
        """Whether the client still wants this session, as far as one can read."""
        data = self.session.data
        return not self.session.readable or bool(data["open"] in (1, 2) and data["number"] == number)

    @property
    def finishes(self) -> bool:
        """Whether the session is to end when its points do."""
        return self.session.readable and int(self.session.data["open"]) == 2

    def estop_requested(self) -> bool:
        """Whether an e-stop was requested since the last call."""
        if not self._requests.changed():
            return False
        estops = int(self._requests.data["estops"])
        asked = estops != self._estops
        self._estops = estops
        return asked

    def answer(self, result: Ack, message: str = "") -> None:
        """Answer the session that asks."""
        self.session_seen = int(self.session.data["number"])
        self._ack.data["session"] = self.session_seen
        self._ack.data["result"] = result
        self._ack.data["message"] = encoded(message)
        self._ack.publish()
