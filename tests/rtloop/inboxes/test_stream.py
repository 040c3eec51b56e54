"""What the streaming client asks for, as compiled code reads it.

Oracle: the same rules in plain Python, on a mapping of its own, after each of many operations of a writer.
"""

from __future__ import annotations

import numpy as np
from sample_counts import samples
from wild_writer import Writer

from cobot.ipc.seqlock import Block
from cobot.ipc.shm import RobotMemory
from rtloop.inboxes.stream import Inbox, StreamInbox
from rtloop.results import ACCEPTED

OPERATIONS = samples(100_000)


class PlainInbox:
    def __init__(self, block: Block) -> None:
        self.block = block
        self._sequence = -1
        self.readable = True
        self.torn_reads = 0

    def take_news(self) -> bool:
        sequence = self.block.sequence
        if sequence == self._sequence:
            return False
        self.readable = self.block.try_read()
        if not self.readable:
            self.torn_reads += 1
            return False
        self._sequence = sequence
        return True


class PlainStreamInbox:
    def __init__(self, memory: RobotMemory) -> None:
        self.session = PlainInbox(memory.session)
        self._requests = PlainInbox(memory.stream_requests)
        self._estops = int(memory.stream_requests.salvage()["estops"])
        self.session_seen = int(memory.session.salvage()["number"])

    @property
    def torn_reads(self) -> int:
        return self.session.torn_reads + self._requests.torn_reads

    def asks(self) -> bool:
        data = self.session.block.data
        return bool(self.session.take_news() and data["open"] == 1 and data["number"] != self.session_seen)

    def wants(self, number: int) -> bool:
        data = self.session.block.data
        return not self.session.readable or bool(data["open"] in (1, 2) and data["number"] == number)

    @property
    def finishes(self) -> bool:
        return self.session.readable and int(self.session.block.data["open"]) == 2

    def take_estop(self) -> bool:
        if not self._requests.take_news():
            return False
        estops = int(self._requests.block.data["estops"])
        asked, self._estops = estops != self._estops, estops
        return asked


def test_an_inbox_sees_what_the_plain_rule_sees(memories: list[RobotMemory]) -> None:
    written, *read = (memory.setpoint for memory in memories)
    random = np.random.default_rng(21)
    writer, inbox, plain = Writer(random), Inbox(read[0]), PlainInbox(read[1])
    seen = set()
    for number in range(OPERATIONS):
        match random.integers(4):
            case 0:
                written.data["number"] = number
                written.publish()
            case 1:
                writer.disturb(written)
        expected = plain.take_news()
        assert inbox.take_news() == expected
        assert (inbox.readable, inbox.torn_reads) == (plain.readable, plain.torn_reads)
        if expected:
            assert inbox.data["number"] == plain.block.data["number"]
        seen.add((expected, plain.readable))
    assert len(seen) == 3, "news, none, and what could not be read"


def test_a_clients_wishes_are_seen_as_by_the_plain_rules(memories: list[RobotMemory]) -> None:
    written = memories[0]
    random = np.random.default_rng(22)
    writer, inbox, plain = Writer(random), StreamInbox(memories[1]), PlainStreamInbox(memories[2])
    counts = np.zeros(4, int)
    for _ in range(OPERATIONS):
        match random.integers(8):
            case 0 | 1:
                session = written.session.data
                session["number"], session["open"] = random.integers(5), random.integers(4)
                written.session.publish()
            case 2:
                written.stream_requests.data["estops"] = random.integers(3)
                written.stream_requests.publish()
            case 3:
                writer.disturb(written.session if random.random() < 0.5 else written.stream_requests)
        asks, number = plain.asks(), int(random.integers(5))
        assert inbox.asks() == asks
        expected = asks, plain.wants(number), plain.finishes, plain.take_estop()
        assert (asks, inbox.wants(number), inbox.finishes, inbox.take_estop()) == expected
        assert inbox.torn_reads == plain.torn_reads
        counts += expected
        if asks:
            inbox.answer(ACCEPTED)
            plain.session_seen = inbox.session_seen
            assert inbox.session_seen == int(plain.session.block.data["number"])
    assert (counts > OPERATIONS / 1000).all()
