"""What the service asks of rtloop through shared memory."""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import RING, Ack
from cobot.ipc.shm import RobotMemory, encoded

UNREADABLE_CYCLES = 100
"""After so many tries a command is given up: its writer died while writing it."""


class CommandInbox:
    """Reads requests, heartbeat and commands; each costs next to nothing while it does not change.

    Real-time safe. A read that is torn is counted and repeated in the next cycle.

    Attributes:
        stops, estops: the counters of requests seen so far.
        command_seen: the number of the last command taken.
        torn_reads: how often a block was not consistent.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self._requests = memory.requests
        self._heartbeat = memory.heartbeat
        self._head = memory.head
        self._commands = memory.commands
        self._acks = memory.acks
        last = memory.state.data
        self.stops = int(last["stops_seen"])
        self.estops = int(last["estops_seen"])
        self.command_seen = int(last["command_seen"])
        self.torn_reads = int(last["torn_reads"])
        self._requests_sequence = -1
        self._heartbeat_sequence = -1
        self._head_sequence = -1
        self._beat_ns = 0
        self._newest = 0
        self._unreadable = 0

    def poll_requests(self) -> tuple[bool, bool]:
        """Whether a stop, whether an e-stop was requested since the last call."""
        sequence = self._requests.sequence
        if sequence == self._requests_sequence:
            return False, False
        if not self._requests.try_read():
            self.torn_reads += 1
            return False, False
        self._requests_sequence = sequence
        stops, estops = int(self._requests.data["stops"]), int(self._requests.data["estops"])
        asked = stops != self.stops, estops != self.estops
        self.stops, self.estops = stops, estops
        return asked

    def service_silence_s(self, now_ns: int) -> float:
        """How long ago the service gave a sign of life."""
        sequence = self._heartbeat.sequence
        if sequence != self._heartbeat_sequence:
            if self._heartbeat.try_read():
                self._heartbeat_sequence = sequence
                self._beat_ns = int(self._heartbeat.data["monotonic_ns"])
            else:
                self.torn_reads += 1
        return (now_ns - self._beat_ns) * 1e-9

    def next_command(self) -> np.ndarray | None:
        """The next command, or None. It is taken when it is acknowledged."""
        sequence = self._head.sequence
        if sequence != self._head_sequence:
            if not self._head.try_read():
                self.torn_reads += 1
                return None
            self._head_sequence = sequence
            self._newest = int(self._head.data["id"])
        if self._newest <= self.command_seen:
            return None
        number = max(self.command_seen + 1, self._newest - RING + 1)
        block = self._commands[number % RING]
        if block.try_read() and int(block.data["id"]) == number:
            self._unreadable = 0
            return block.data
        self.torn_reads += 1
        self._unreadable += 1
        if self._unreadable > UNREADABLE_CYCLES:
            self._unreadable = 0
            self.acknowledge(number, Ack.REJECTED, "the command could not be read")
        return None

    def refuse_pending(self, reason: str) -> None:
        """Answer what was sent to an rtloop that has died: it was meant for where the arm was then."""
        if self._head.try_read():
            newest = int(self._head.data["id"])
            for number in range(max(self.command_seen + 1, newest - RING + 1), newest + 1):
                self.acknowledge(number, Ack.REJECTED, reason)

    def acknowledge(self, number: int, result: Ack, message: str = "") -> None:
        """Answer a command."""
        self.command_seen = number
        ack = self._acks[number % RING]
        ack.data["id"] = number
        ack.data["result"] = result
        ack.data["message"] = encoded(message)
        ack.publish()
